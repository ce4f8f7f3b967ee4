"""Decks for ngspice with answers in closed form, and a look at the processes that run them."""

import os
import sys
import time
from pathlib import Path

import pytest

R, C = 1e3, 1e-9
TAU = R * C
DISCHARGE = """RC from 1 V
R1 Out 0 1k
C1 Out 0 1n ic=1
.options reltol=1e-6
.tran 10n 5u uic
.end
"""
LOWPASS = """RC low-pass
V1 in 0 dc 2 ac 1 pulse(0 1 0 1n 1n 1 2)
R1 in out 1k
C1 out 0 1n
"""
DIVIDER = "divider\nV1 in 0 {}\nR1 in x 1k\nR2 x 0 1k\n.op\n.end\n"
ENDLESS = "no end\nV1 in 0 sin(0 1 1k)\nR1 in x 1k\nC1 x 0 1n\n.tran 1n 1000\n.end\n"
BLOW_UP = "v' = v^2\nC1 x 0 1\n.ic v(x)=1\nB1 0 x I=v(x)*v(x)\n.tran 1m 10 uic\n.end\n"
on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def working_in(folder: Path) -> list[str]:
    """Processes whose folder is this one or below it."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            place = os.readlink(process / "cwd").removesuffix(" (deleted)")
        except OSError:
            continue
        if Path(place).is_relative_to(folder):
            found.append(process.name)
    return found


def wait_for(condition):
    for _ in range(500):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("waited in vain")
