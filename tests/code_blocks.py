"""Code blocks of Markdown pages: run them and compare what they print with what the page shows.

A comment `<!-- slow -->` before a block leaves it to ``make slow``. A block `text` after a block
`python` is its output. In a block `console`, output follows its command ``$ ann-dc ...``, which
may end with ``# exit status 1``. A line `...` in an output stands for any number of lines. A block
`toml` whose first line is ``# NAME.toml`` is written to that file.
"""

import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
from typer.testing import CliRunner

from ann_dc.cli.commands.app import app

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SLOW = re.compile(r"<!-- slow -->\s*\Z")
FILE = re.compile(r"# (\S+\.toml)\n")
STATUS = re.compile(r"# exit status (\d+)")
TOKEN = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?|[^\W\d]+|[^\s\w│─┌┐└┘├┤]")
NUMBER = re.compile(r"[-+]?\d")
ELLIPSIS = "..."
LOOSE = 0.01
"""Relative difference that a number may have; the last digit may differ by one, too."""
TINY = 1e-7
"""Magnitude below which a number is a rounding error: the page and the run need only have one."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """Code block of a page, the output that the page shows below it, and its line number."""

    language: str
    text: str
    output: str | None
    is_slow: bool
    line: int


def blocks_of(page: Path) -> list[Block]:
    """Return the code blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    found = [*FENCE.finditer(text)]
    blocks = []
    for fence, after in zip(found, [*found[1:], None]):
        gap = text[fence.end() : after.start()] if after else "text"
        is_output = after is not None and after[1] == "text" and not gap.strip()
        blocks.append(
            Block(
                language=fence[1],
                text=fence[2],
                output=after[2] if is_output else None,
                is_slow=SLOW.search(text[: fence.start()]) is not None,
                line=text.count("\n", 0, fence.start()) + 1,
            )
        )
    return blocks


def commands_of(block: Block) -> Iterator[tuple[list[str], int, str | None]]:
    """Yield words, exit status and output of every ``ann-dc`` command of a block."""
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        line, _, output = part.partition("\n")
        program, *words = shlex.split(line, comments=True)
        status = STATUS.search(line)
        if program == "ann-dc":
            yield words, int(status[1]) if status else 0, output.strip() or None


def run_page(page: Path, *, languages=("python", "console", "toml"), slow: bool = False) -> dict:
    """Run the blocks of a page in their order and return the namespace of its Python blocks.

    Files are written to the working directory. Slow blocks are left out unless ``slow``.
    """
    names: dict[str, object] = {"__name__": page.stem}
    for block in blocks_of(page):
        if block.language not in languages or (block.is_slow and not slow):
            continue
        place = f"{page.name}, line {block.line}"
        if block.language == "python":
            _run_python(block, names, place)
        elif block.language == "console":
            _run_console(block, place)
        elif file := FILE.match(block.text):
            Path(file[1]).write_text(block.text, encoding="utf-8")
    return names


def _run_python(block: Block, names: dict[str, object], place: str) -> None:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(block.text, place, "exec"), names)
    plt.close("all")
    if block.output is not None:
        assert difference(block.output, printed.getvalue()) is None, _report(
            place, block.output, printed.getvalue()
        )


def _run_console(block: Block, place: str) -> None:
    plain = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    for words, status, output in commands_of(block):
        result = CliRunner().invoke(app, words, env=plain)
        assert result.exit_code == status, f"{place}: {words}\n{result.output}"
        if output is not None:
            assert difference(output, result.output) is None, _report(
                f"{place}: {words}", output, result.output
            )


def _report(place: str, shown: str, printed: str) -> str:
    return f"{place}: {difference(shown, printed)}\n--- page\n{shown}\n--- printed\n{printed}"


def difference(shown: str, printed: str) -> str | None:
    """Return the first word of a shown output that is not printed, None if there is no difference.

    Whitespace and rules of tables are ignored.
    """
    parts, actual = _parts(shown), TOKEN.findall(printed)
    begin = 0
    for index, part in enumerate(parts):
        is_last = index == len(parts) - 1
        starts = [*range(begin, len(actual) - len(part) + 1)]
        if is_last and index > 0:
            starts = starts[-1:]
        elif index == 0:
            starts = starts[:1]
        matches = (i for i in starts if all(map(_equal, part, actual[i : i + len(part)])))
        start = next(matches, None)
        if start is None:
            return _first_difference(part, actual[begin:])
        begin = start + len(part)
    return None if begin == len(actual) else f"not on the page: {' '.join(actual[begin:][:8])}"


def _parts(shown: str) -> list[list[str]]:
    """Return the words of a shown output between its lines `...`."""
    parts: list[list[str]] = [[]]
    for line in shown.splitlines():
        if line.strip() == ELLIPSIS:
            parts.append([])
        else:
            parts[-1] += TOKEN.findall(line)
    return parts


def _first_difference(part: list[str], actual: list[str]) -> str:
    for index, word in enumerate(part):
        if index >= len(actual) or not _equal(word, actual[index]):
            got = actual[index] if index < len(actual) else "the end"
            return f"expected {' '.join(part[max(0, index - 3) : index + 1])}, got {got}"
    return f"expected {' '.join(part[:8])} further up"


def _equal(shown: str, printed: str) -> bool:
    if not (NUMBER.match(shown) and NUMBER.match(printed)):
        return shown == printed
    one, other = float(shown), float(printed)
    if shown == printed or max(abs(one), abs(other)) < TINY:
        return True
    mantissa, _, exponent = shown.partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(one - other) <= max(LOOSE * abs(one), digit if digit < 1 else 0) * (1 + 1e-9)
