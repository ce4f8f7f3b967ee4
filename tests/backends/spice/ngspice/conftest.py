"""Fixtures of tests of ngspice: the one that is installed, and what may stand in for it."""

import os

import pytest

from ann_dc.backends.spice.ngspice import process as processes
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    NgspiceMissing,
)


@pytest.fixture
def ngspice():
    """A runner of the ngspice that is installed; CI must have one."""
    try:
        find_ngspice()
    except NgspiceMissing as error:
        if "CI" in os.environ:
            pytest.fail(f"CI without ngspice: {error}")
        pytest.skip(str(error))
    return Ngspice(timeout=60.0)


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Puts a shell script in ngspice's place; the raw files it may copy lie beside it."""
    home = tmp_path / "stand-in"
    home.mkdir()

    def install(script: str, **raws: bytes) -> Ngspice:
        for name, content in raws.items():
            (home / f"{name}.raw").write_bytes(content)
        program = home / "ngspice"
        program.write_text(f"#!/bin/sh\nhere={home}\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv(processes.VARIABLE, str(program))
        return Ngspice(timeout=20.0, keep=tmp_path / "kept", workers=2)

    return install
