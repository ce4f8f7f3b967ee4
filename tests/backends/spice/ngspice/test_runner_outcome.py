"""Runs that count, and runs that do not: by exit code and raw file alone."""

import re

import numpy as np
import pytest
from ngspice_runs import BLOW_UP
from raw_files import binary, ramp

from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    AnnDcError,
    EndedEarlyError,
    NgspiceMissing,
    NotFiniteError,
    OutputError,
    RawFileError,
    SpiceCrashError,
    SpiceError,
)


def test_an_abandoned_transient_tells_its_time(ngspice, tmp_path):
    """v' = v^2 from 1 is 1 / (1 - t), so nothing is there from t = 1 on."""
    with pytest.raises(
        EndedEarlyError, match=r"often the circuit is unstable.*\n.*stored as"
    ) as it:
        Ngspice(keep=tmp_path).run(BLOW_UP)
    stopped = float(re.search(r"aborted at time ([\d.]+);", str(it.value))[1])
    np.testing.assert_allclose(stopped, 1.0, atol=1e-2)
    assert not [*tmp_path.glob("*/out.raw")]


def test_ends_early(stand_in):
    ngspice = stand_in("cp $here/half.raw out.raw", half=ramp(0.5))
    assert ngspice.run("", end_time=0.5 * (1 + 0.9e-6)).time[-1] == 0.5
    with pytest.raises(EndedEarlyError, match=r"ended at 0\.5 s, expected 1 s; often"):
        ngspice.run("", end_time=1.0)
    ngspice = stand_in("cp $here/op.raw out.raw", op=binary(["v(x)"], np.ones((1, 1))))
    with pytest.raises(EndedEarlyError, match=r"expected a transient until 1 s.* add a \.tran"):
        ngspice.run("", end_time=1.0)


def test_values_that_are_no_numbers(stand_in):
    values = np.array([[0.0, 1.0], [0.5, -np.inf], [1.0, np.nan]])
    raw = binary(["time", "V(Y)"], values)
    ngspice = stand_in("cp $here/raw.raw out.raw", raw=raw)
    with pytest.raises(NotFiniteError, match=r"v\(y\) is -inf at point 1 of .*\(time 0\.5\)"):
        ngspice.run("", end_time=1.0)


@pytest.mark.parametrize(
    ("script", "kind", "meaning"),
    [
        ("kill -9 $$", SpiceCrashError, r"killed by signal 9 \(SIGKILL\); if memory"),
        ("kill -SEGV $$", SpiceCrashError, r"signal 11 \(SIGSEGV\)"),
        ("cp $here/whole.raw out.raw; exit 3", SpiceCrashError, "exit code 3"),
        (": > out.raw", RawFileError, "the raw data: it is empty"),
        ("cp $here/cut.raw out.raw", RawFileError, r"cut off or damaged: 5 points of 2 variables"),
        ("cp $here/cut.raw out.raw; exit 3", SpiceCrashError, "exit code 3"),
        ("mkdir out.raw", RawFileError, "'.*out.raw' is a folder"),
        ("mkfifo out.raw", RawFileError, "not a plain file"),
        ("exit 0", RawFileError, "ngspice wrote no raw file"),
    ],
)
def test_what_a_simulator_may_do(stand_in, script, kind, meaning):
    ngspice = stand_in(f"echo last words\n{script}", whole=ramp(), cut=ramp()[:-1])
    with pytest.raises(kind, match=meaning) as caught:
        ngspice.run("title")
    assert str(caught.value).endswith("ngspice printed last:\n  | last words")
    assert type(caught.value) is kind


def test_every_error_is_the_librarys():
    for kind in (SpiceError, NgspiceMissing, OutputError):
        assert issubclass(kind, AnnDcError)
