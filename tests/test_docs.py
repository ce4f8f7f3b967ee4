"""The pages of `make docs`: complete, without warnings, and without requests to other hosts."""

import re
import subprocess
import sys
from pathlib import Path

import ann_dc

GUIDE = Path(__file__).parent.parent / "demos" / "guide"
LOADED = re.compile(r"""<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//""")
"""Parts of a page that a browser requests from another host."""


def test_pages_are_built_without_a_warning_and_load_nothing_from_other_hosts(tmp_path):
    words = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", GUIDE, tmp_path]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = [*tmp_path.rglob("*.html")]
    assert len(pages) > 15
    assert [page.name for page in pages if LOADED.search(page.read_text("utf-8"))] == []
    assert "ann_dc.solve" in (tmp_path / "reference" / "solve.html").read_text("utf-8")
    assert "--backend" in (tmp_path / "reference" / "commands.html").read_text("utf-8")
    examples = (tmp_path / "examples.html").read_text("utf-8")
    pictures = sorted(path.name for path in (GUIDE.parent / "pictures").glob("*.png"))
    assert sorted(re.findall(r'src="_images/([^"]+)"', examples)) == pictures
    assert "guide.css" in examples  # limits the width of the pictures


def test_the_reference_has_every_public_name():
    entries = "\n".join(page.read_text("utf-8") for page in GUIDE.glob("reference/*.md"))
    modules = {"errors", "levels", "nonidealities", "ode", "plants", "plotting", "presets"}
    modules |= {"report", "two_level"}
    missing = [n for n in ann_dc.__all__ if n not in modules and not n.startswith("_")]
    missing = [n for n in missing if not re.search(rf"^\.\. \S+:: {n}$", entries, re.M)]
    assert missing == []
    assert [m for m in modules if f"currentmodule:: ann_dc.{m}\n" not in entries] == []
