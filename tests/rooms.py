"""Package map, written from docstrings: ``ann_dc/README.md``.

Every package and every top-level module has the first line of its docstring.
``python tests/rooms.py --write`` renews the file.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import ann_dc

PACKAGE = Path(ann_dc.__file__).parent
README = PACKAGE / "README.md"
ORDER = (
    "conversion dataclass_pickling errors jit_cache resources si_prefixes summaries timing",
    "files jit_functions progress validation",
    "parquet scale yields",
    "network",
    "problem",
    "decomposition evaluation optimality weights",
    "analysis synthesis",
    "gain_design hardware",
    "backends lowering",
    "fidelity solution two_level",
    "diagnosis export families",
    "navigation solver",
    "paper study",
    "plotting",
    "report",
    "cli",
    "__main__",
)
"""Layers of the package, lowest first: a module imports only modules of earlier lines."""
INTRODUCTION = """# Package map of `ann_dc`

An optimal-control problem becomes one network description; every realisation is derived from it.
Packages and modules of a layer import only those of layers above them in this table, and there is
no import circle (`tests/test_architecture.py`). The reference (`make docs`) lists public names by
task. `python tests/rooms.py --write` writes this file.
"""


def first_line(file: Path) -> str:
    """First line of a module's docstring."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].replace("|", "\\|")


def rooms() -> list[Path]:
    """The folders and top-level modules of the package, lowest layer first."""
    names = " ".join(ORDER).replace("__main__", "").split()
    places = [(PACKAGE / name, PACKAGE / f"{name}.py") for name in names]
    return [folder if folder.is_dir() else file for folder, file in places]


def readme() -> str:
    """The whole file."""
    lines = [INTRODUCTION, "| layer | package or module | content |", "|---|---|---|"]
    layers = [layer.split() for layer in ORDER]
    number = {name: rank for rank, layer in enumerate(layers, 1) for name in layer}
    for room in rooms():
        line = first_line(room / "__init__.py" if room.is_dir() else room)
        shown = f"{room.name}/" if room.is_dir() else room.name
        lines.append(f"| {number[room.stem]} | [`{shown}`]({shown}) | {line} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        README.write_text(readme(), encoding="utf-8")
    else:
        print(readme())
