"""The SPICE library is found in a checkout and in an installed wheel."""

import importlib.util
import shutil
import tomllib
from pathlib import Path

import pytest

import ann_dc
from ann_dc import resources

ROOT = Path(ann_dc.__file__).parents[1]


def installed_at(site: Path):
    """The locator as it is in an installation under ``site``."""
    home = site / "ann_dc"
    home.mkdir(parents=True)
    shutil.copy(resources.__file__, home)
    spec = importlib.util.spec_from_file_location("located", home / "resources.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_in_a_checkout():
    assert (ann_dc.circuits_path() / "README.md").is_file()


def test_in_a_wheel(tmp_path):
    mapped = tomllib.loads((ROOT / "pyproject.toml").read_text())
    target = mapped["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]["circuits"]
    located = installed_at(tmp_path)
    (tmp_path / target).mkdir()
    assert located.circuits_path() == tmp_path / target


def test_an_incomplete_installation_says_so(tmp_path):
    with pytest.raises(FileNotFoundError, match="install ann_dc again"):
        installed_at(tmp_path).circuits_path()
