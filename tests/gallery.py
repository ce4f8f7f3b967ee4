"""Gallery of the examples, written from their docstrings: ``demos/README.md``.

``python tests/gallery.py --write`` renews the file.
"""

from __future__ import annotations

import ast
import sys
import textwrap
from pathlib import Path

DEMOS = Path(__file__).parents[1] / "demos"
README = DEMOS / "README.md"
INTRODUCTION = """# Examples

Every example states its question, its answer and its figure, and runs on its own:
`python demos/01_paper_example.py` writes into `out/demos/`. `make demos` runs all of them
(minutes; 08 to 10, 22, 24 and 26 to 28 need ngspice). The [guide](./guide/index.md) explains terms
and methods; `tau_min` is the fastest time constant of a network. This page is written by
`python tests/gallery.py --write` from the examples themselves.
"""
WIDTH = 116


def parts_of(demo: Path) -> tuple[str, str, str]:
    """Title, question and answer of an example, from its docstring."""
    text = ast.get_docstring(ast.parse(demo.read_text(encoding="utf-8"))) or ""
    title, _, rest = text.partition("\n")
    _, question, answer, _ = (
        " ".join(part.split())
        for part in rest.replace("Answer:", "Question:")
        .replace("Figure:", "Question:")
        .split("Question:")
    )
    return title.rstrip("."), question, answer


def entry(demo: Path) -> str:
    """Heading, thumbnails, question and answer of an example."""
    title, question, answer = parts_of(demo)
    pictures = sorted((DEMOS / "pictures").glob(f"{demo.name[:2]}_*.png"))
    pictures = [DEMOS / "pictures" / "overview.png"] * demo.name.startswith("01") + pictures
    shown = [f"![{title}](pictures/{picture.name})" for picture in pictures]
    link = f"[{demo.name}](./{demo.name})"
    lines = [f"## {demo.name[:2]} {title}", f"*{question}* {link}", answer]
    return "\n\n".join(
        [textwrap.fill(line, WIDTH, break_long_words=False) for line in lines] + shown
    )


def readme() -> str:
    """The whole file."""
    demos = sorted(DEMOS.glob("[0-9]*.py"))
    return "\n".join([INTRODUCTION, "\n\n".join(entry(demo) for demo in demos), ""])


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        README.write_text(readme(), encoding="utf-8")
    else:
        print(readme())
