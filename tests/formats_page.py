"""Table of formats on the guide page Export, written from the catalogue: ``--write`` renews it."""

import re
import sys
from pathlib import Path

from ann_dc.export.catalogue import FORMATS

PAGE = Path(__file__).parents[1] / "demos" / "guide" / "export.md"
HEAD = "| format | what it is | carries | loses | settings |\n|---|---|---|---|---|\n"


def table() -> str:
    rows = []
    for name, form in FORMATS.items():
        settings = ", ".join(f"`{key}={p.default}`" for key, p in form.settings.items())
        rows.append(f"| `{name}` | {form.title} | {form.carries} | {form.loses} | {settings} |")
    return HEAD + "\n".join(rows) + "\n"


def written() -> str:
    """Return the table on the page."""
    found = re.search(re.escape(HEAD) + r"(?:\|.*\n)*", PAGE.read_text("utf-8"))
    return found.group() if found else ""


if __name__ == "__main__" and sys.argv[1:] == ["--write"]:
    text = PAGE.read_text("utf-8")
    PAGE.write_text(text.replace(written() or "FORMATS\n", table()), "utf-8")
