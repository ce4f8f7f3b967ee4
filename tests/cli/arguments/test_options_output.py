"""--timing tells where the time went, and changes nothing else."""

import re

import pytest
from command_line import SMALL, terminal


@pytest.mark.slow
def test_timing_is_told_on_stderr_whatever_becomes_of_the_command():
    code, out, err = terminal("solve", *SMALL, "--timing", "--quiet")
    assert (code, out) == (0, b"")
    rows = dict(re.findall(r"^([a-z -]+?)  +([\d.]+) +[\d.]+$", err.decode(), re.MULTILINE))
    assert {"start", "problem", "imports", "gain-scheduled run", "run", "certificate"} <= set(rows)
    spent = {name: float(ms) for name, ms in rows.items()}
    together = spent.pop("together")
    assert abs(sum(spent.values()) - together) < 0.1 * len(spent)


def test_timing_of_what_is_refused():
    code, _, err = terminal("design", "no_such_plant", "--timing")
    assert code == 2
    assert b"together" in err
    assert b"no_such_plant" in err
