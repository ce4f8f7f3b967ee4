"""Inputs over time: samples with linear interpolation or zero-order hold."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import FileFormatError, NetworkError, UnknownNameError, such_as
from ann_dc.summaries import summarised
from ann_dc.validation import Finite, checked

Hold: TypeAlias = Literal["linear", "previous"]
HOLDS: dict[str, Hold] = {"linear": "linear", "previous": "previous"}
"""Interpolations by name."""


@such_as("ann_dc.Waveform(times=[0.0, 10.0], values=[1.0, 2.0])")
@checked
@summarised(
    lambda self: {
        "values": len(self.values),
        "from": f"{self.times[0]:g}",
        "to": f"{self.times[-1]:g}",
        "hold": self.hold,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Waveform(Record):
    """Input as a function of network time.

    The first value applies before the first time, and the last one after the last time.

    Attributes
    ----------
    times : (K,) array
        Increasing network times of the samples.
    values : (K,), (K, N), (K, B) or (K, B, N) array
        Values in the user's units. For a network: the same for all stages, (K,), or one per stage,
        (K, N). For B samples of `OdeBackend.run_batch`: the same for all samples, (K,), one per
        sample, (K, B), or one per sample and stage, (K, B, N).
    hold : {"linear", "previous"}
        Interpolation: linear, or the previous sample (zero-order hold). Default linear.

    Raises
    ------
    NetworkError
        If times do not increase, sizes differ, or a number is not finite.

    Examples
    --------
    >>> ramp = Waveform(times=[0.0, 10.0], values=[1.0, 3.0])
    >>> float(ramp.at(5.0)), float(ramp.at(99.0))
    (2.0, 3.0)
    """

    times: np.ndarray
    values: np.ndarray
    hold: Hold = "linear"

    def __post_init__(self) -> None:
        times, values = (np.array(given, float) for given in (self.times, self.values))
        if times.ndim != 1 or not len(times) or not (np.diff(times) > 0).all():
            raise NetworkError(f"waveform: expected increasing times (K,), got {times!r:.80}")
        if values.ndim not in (1, 2, 3) or len(values) != len(times):
            raise NetworkError(
                f"waveform: expected values ({len(times)},), ({len(times)}, N), or of a batch "
                f"({len(times)}, B) or ({len(times)}, B, N), one per time, got {values.shape}"
            )
        if not (np.isfinite(times).all() and np.isfinite(values).all()):
            raise NetworkError(
                f"waveform: a time or value is not finite: {times!r:.80}, {values!r:.80}"
            )
        for name, array in (("times", times), ("values", values)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def from_csv(
        cls, path: str | os.PathLike[str], column: str, time: str = "time", hold: Hold = "linear"
    ) -> Waveform:
        r"""Read a column of a CSV file with a header, and the column of its times.

        Parameters
        ----------
        path : path-like
            CSV file in UTF-8, whose first row has the names of the columns.
        column : str
            Name of the column of values, in the user's units of the input.
        time : str
            Name of the column of increasing network times. Default "time".
        hold : {"linear", "previous"}
            Interpolation between the samples. Default linear.

        Returns
        -------
        Waveform
            Waveform of the same value for all stages.

        Raises
        ------
        UnknownNameError
            If a column does not exist; the message lists the existing ones.
        NetworkError
            If a cell is not a finite number, or times do not increase.
        FileFormatError
            If the file cannot be read as CSV.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder, "target.csv")
        ...     _ = file.write_text("time,x\n0,1.0\n10,3.0\n")
        ...     target = Waveform.from_csv(file, "x")
        >>> float(target.at(5.0))
        2.0
        """
        try:
            with open(path, encoding="utf-8-sig", newline="") as file:
                rows = list(csv.DictReader(file))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise FileFormatError(f"{os.fspath(path)}: cannot be read as CSV: {error}") from error
        found = []
        for name in (time, column):
            if not rows or name not in rows[0]:
                raise UnknownNameError.of("column", name, list(rows[0]) if rows else [])
            try:
                found.append([float(row[name]) for row in rows])
            except (TypeError, ValueError) as error:
                raise NetworkError(f"{os.fspath(path)}, column {name}: {error}") from error
        return cls(times=np.array(found[0]), values=np.array(found[1]), hold=hold)

    @checked
    def at(self, time: Finite) -> np.ndarray:
        """Return the value at a network time: one number or an array, as ``values`` without K."""
        times, values = self.times, self.values
        last = int(np.searchsorted(times, time, side="right")) - 1
        if last < 0 or last == len(times) - 1 or self.hold == "previous":
            return values[max(last, 0)]
        share = (time - times[last]) / (times[last + 1] - times[last])
        return (1.0 - share) * values[last] + share * values[last + 1]


def check_constant(waveforms: Mapping[str, Waveform]) -> None:
    """Raise `NetworkError` if inputs of a network change over time."""
    if waveforms:
        raise NetworkError(
            f"inputs: {', '.join(waveforms)} change over time, which OdeBackend.run, "
            "OdeBackend.run_batch and SpiceBackend.run can follow; for recurrent steps, layers "
            "and two levels use the network at one time, network.at_time(0.0)"
        )
