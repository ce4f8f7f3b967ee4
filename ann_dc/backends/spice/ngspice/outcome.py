"""Validity of an ngspice run, judged by exit code and raw file, not by output."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np

from ann_dc.backends.spice.ngspice.folder import RAW
from ann_dc.backends.spice.ngspice.raw import MAX_BYTES, REMEDY, Raw, read_raw
from ann_dc.errors import (
    EndedEarlyError,
    FileFormatError,
    NotFiniteError,
    RawFileError,
    SpiceCrashError,
    SpiceTimeoutError,
)
from ann_dc.files import read_whole

END_SHARE = 1e-6
"""Fraction of its end time by which a transient may miss it."""

UNSTABLE = (
    "often the circuit is unstable, or a step became too small: look at the eigenvalues first, "
    "keep voltages near 1 V and times below 1 ms"
)


def checked_outcome(folder: Path, code: int | None, timeout: float) -> list[Raw]:
    """Return the plots of a run that ended by itself with exit code 0.

    The code is negative for a signal, and None after the time limit of ``timeout`` seconds. Raises
    `SpiceTimeoutError` in the latter case, `SpiceCrashError` for any code but 0, `EndedEarlyError`
    if an analysis was aborted, and `RawFileError` if the answer is missing or not readable.
    """
    if code is None:
        raise SpiceTimeoutError(
            f"ngspice was ended after {timeout:g} s; {UNSTABLE}; or ask for a shorter transient, "
            "or give a longer `timeout`"
        )
    if code < 0:
        raise SpiceCrashError(_killed(-code))
    try:
        plots = _answer(folder / RAW)
    except EndedEarlyError as error:
        raise EndedEarlyError(f"{error}; {UNSTABLE}") from None
    except RawFileError:
        if code == 0:
            raise
        plots = []
    if code > 0:
        raise SpiceCrashError(
            f"ngspice ended with exit code {code}; what it printed last often names the line "
            "of the deck or the analysis that is wrong"
        )
    return plots


def _answer(file: Path) -> list[Raw]:
    if not file.exists():
        raise RawFileError(
            "ngspice wrote no raw file; check that the deck has an analysis (.op, .tran)"
        )
    try:
        return read_raw(read_whole(file, MAX_BYTES, REMEDY))
    except FileFormatError as error:
        raise RawFileError(f"ngspice gave no answer that can be read: {error}") from None


def _killed(number: int) -> str:
    if number == signal.SIGXFSZ:
        return f"ngspice wrote more than {MAX_BYTES} bytes; {REMEDY}"
    names = {known.value: f" ({known.name})" for known in signal.Signals}
    return (
        f"ngspice was killed by signal {number}{names.get(number, '')}; if the memory was short, "
        "give fewer `workers` or save fewer nodes; if it crashed, run its deck alone"
    )


def check_end(plots: list[Raw], end_time: float | None) -> None:
    """Raise `EndedEarlyError` if a transient did not reach its end (s), or is missing."""
    if end_time is None:
        return
    transients = [raw for raw in plots if raw.names[0] == "time"]
    if not transients:
        raise EndedEarlyError(
            f"the deck has no transient, and one until {end_time:g} s is expected; add a .tran"
        )
    for raw in transients:
        if not raw.time[-1] >= end_time * (1.0 - END_SHARE):
            raise EndedEarlyError(
                f"the transient ended at {raw.time[-1]:g} s, and {end_time:g} s is expected; "
                f"{UNSTABLE}"
            )


def check_finite(plots: list[Raw]) -> None:
    """Raise `NotFiniteError` if a value is infinite or not a number."""
    for raw in plots:
        wrong = ~np.isfinite(raw.values)
        if wrong.any():
            point, column = (int(i) for i in np.argwhere(wrong)[0])
            raise NotFiniteError(
                f"{raw.names[column]} is {raw.values[point, column]} at point {point} of "
                f"{raw.plot!r} ({raw.names[0]} {raw.values[point, 0]:g}); keep divisors and the "
                "arguments of functions inside their domains"
            )
