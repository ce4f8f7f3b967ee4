"""The map of the package, written from its docstrings: ``ann_dc/README.md``.

Rooms with their one sentence, their modules with the first line of each, and the public names by
what one does with them. ``python tests/rooms.py --write`` renews the file.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import ann_dc

PACKAGE = Path(ann_dc.__file__).parent
README = PACKAGE / "README.md"
OUTSIDE_IN = (
    "problem",
    "decomposition",
    "network",
    "synthesis",
    "evaluation",
    "analysis",
    "gain_design",
    "optimality",
    "solution",
    "hardware",
    "backends",
    "two_level",
    "families",
    "fidelity",
    "weights",
    "export",
    "study",
    "plotting",
    "report",
    "cli",
)
"""Rooms in the order in which one meets them; others follow by name."""
VERBS = {
    "declare": ("problem", "scale"),
    "decompose, synthesize": ("decomposition", "network", "synthesis"),
    "design": ("gain_design",),
    "run": ("solver", "backends", "families", "two_level", "timing"),
    "analyse": ("analysis", "diagnosis", "evaluation", "fidelity", "plotting", "study"),
    "hardware": ("hardware", "resources"),
    "certify": ("optimality", "solution"),
    "keep": ("weights", "export", "report"),
    "know what went wrong": ("errors",),
}
"""What one does, and the rooms and modules whose names do it."""
INTRODUCTION = """# The rooms of `ann_dc`

An optimal-control problem becomes one network description, and every realisation is read off it.
Rooms stand in the order in which one meets them; imports only go up this list, never down. The API
pages say more (`make docs`). This file is written by `python tests/rooms.py --write`; a test keeps
it up to date.
"""


def first_line(file: Path) -> str:
    """First line of a module's docstring."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0]


def sentence(text: str) -> str:
    """First sentence of a docstring, on one line."""
    paragraph = inspect.cleandoc(text).partition("\n\n")[0]
    return re.split(r"(?<=\.)\s", " ".join(paragraph.split()), maxsplit=1)[0]


def rows(folder: Path, depth: int = 0) -> Iterator[tuple[str, str]]:
    """(Name, first line) of a room, its modules, and then the rooms in it."""
    yield f"{'  ' * depth}{folder.name}/", first_line(folder / "__init__.py")
    for file in sorted(folder.glob("*.py")):
        if not file.stem.startswith("__"):
            yield f"{'  ' * (depth + 1)}{file.stem}", first_line(file)
    for inner in sorted(folder.glob("*/__init__.py")):
        yield from rows(inner.parent, depth + 1)


def rooms() -> list[Path]:
    """The folders of the package, in order."""
    found = sorted(file.parent.name for file in PACKAGE.glob("*/__init__.py"))
    known = [name for name in OUTSIDE_IN if name in found]
    return [PACKAGE / name for name in (*known, *(n for n in found if n not in known))]


def drawn() -> str:
    """The rooms and their modules as text."""
    front = [(f.stem, first_line(f)) for f in sorted(PACKAGE.glob("[a-z]*.py"))]
    blocks = [front, *(list(rows(room)) for room in rooms())]
    width = 2 + max(len(name) for block in blocks for name, _ in block)
    return "\n\n".join(
        "\n".join(f"{name:{width}}{line}" for name, line in block) for block in blocks
    )


@cache
def definitions() -> dict[str, list[tuple[str, str]]]:
    """(Module, docstring) of every constant of the package, by name."""
    found: dict[str, list[tuple[str, str]]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
        body = ast.parse(file.read_text(encoding="utf-8")).body
        for node, after in zip(body, [*body[1:], None]):
            if not isinstance(node, (ast.Assign, ast.AnnAssign)):
                continue
            text = after.value.value if _is_text(after) else ""
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                found.setdefault(ast.unparse(target), []).append((".".join(parts), text))
    return found


def _is_text(node: ast.stmt | None) -> bool:
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def home_of(name: str) -> tuple[str, str]:
    """(Module that defines a name of the face, first sentence of what is said of it)."""
    value = getattr(ann_dc, name)
    if inspect.ismodule(value):
        return value.__name__, sentence(value.__doc__ or "")
    if inspect.isclass(value) or inspect.isfunction(value):
        return value.__module__, sentence(value.__doc__ or "")
    for module, text in definitions().get(name, []):
        if getattr(importlib.import_module(module), name, None) is value:
            return module, sentence(text)
    raise ValueError(f"{name}: is defined nowhere in {PACKAGE.name}/")


def verb_of(module: str) -> str:
    """What one does with the names of a module."""
    room = module.split(".")[1]
    for verb, homes in VERBS.items():
        if room in homes:
            return verb
    raise ValueError(f"{module}: no verb for the room {room}; add it to VERBS in tests/rooms.py")


def public_names() -> str:
    """A table a verb: name, where it comes from, what it is."""
    found: dict[str, list[str]] = {verb: [] for verb in VERBS}
    for name in sorted(
        set(ann_dc.__all__) - {"__version__"}, key=lambda name: (name.lower(), name)
    ):
        module, line = home_of(name)
        where = module.removeprefix("ann_dc.")
        escaped = line.replace("\\|", "|").replace("|", "\\|")
        found[verb_of(module)].append(f"| `{name}` | `{where}` | {escaped} |")
    head = "| name | in | |\n|---|---|---|\n"
    return "\n\n".join(
        f"**{verb}**\n\n{head}" + "\n".join(names) for verb, names in found.items() if names
    )


def readme() -> str:
    """The whole file."""
    return (
        f"{INTRODUCTION}\n```text\n{drawn()}\n```\n\n"
        f"## Public names, by verb\n\nAll of them as `ann_dc.<name>`.\n\n{public_names()}\n"
    )


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        README.write_text(readme(), encoding="utf-8")
    else:
        print(readme())
