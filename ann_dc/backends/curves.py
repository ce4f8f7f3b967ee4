"""Curves for people: every neuron over time in the user's units, as a table or in a file.

A neuron of a cell is a column, ``q.x[3]`` for q.x of cell 3, beside the time and the residuals.
"""

from __future__ import annotations

import csv
import io
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ann_dc.atomic_files import write_whole
from ann_dc.errors import OutputError, PandasMissing

RESIDUALS = ("constraint_residual", "stationarity_residual")
"""Columns of the relative residuals."""


class Tabulated(ABC):
    """What happened over time, as tables and files."""

    @property
    @abstractmethod
    def curves(self) -> Curves:
        """Every neuron over time, in the user's units."""

    def to_frame(self) -> Any:
        """The curves as a data frame of pandas.

        A row a sample: ``time``, every neuron that is there by its name and cell (``q.x[3]``), and
        the two residuals. Units of measure are in ``attrs["units"]``, by column, where they are
        known.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        PandasMissing
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise PandasMissing(
                "to_frame: a data frame needs pandas, which is not installed: pip install "
                "'ann-dc[pandas]'; to_csv and to_npz need nothing"
            ) from error
        frame = pandas.DataFrame(self.curves.columns())
        frame.attrs["units"] = self.curves.column_units()
        return frame

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the curves as a CSV file, a row a sample, numbers with all their digits.

        The first line has the names of the columns, as `to_frame` has them, each with its unit of
        measure in parentheses where that is known: ``q.x[3] (m)``.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        OutputError
            If the file cannot be written; what was there before stays.
        """
        columns, units = self.curves.columns(), self.curves.column_units()
        stream = io.StringIO()
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(f"{name} ({units[name]})" if name in units else name for name in columns)
        table.writerows(np.stack([*columns.values()], axis=1).tolist())
        write_whole(path, stream.getvalue().encode("utf-8"))

    def to_npz(self, path: str | os.PathLike[str]) -> None:
        """Write the curves as an ``.npz`` file; read it with ``numpy.load(path)``.

        Its arrays are ``time`` (T,), every neuron by its name (T, N), at zero where a cell has
        none, ``residual_time`` (R,) and ``residuals`` (R, 2) of every step, and ``units``, pairs of
        a name and its unit of measure.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        OutputError
            If the file cannot be written; what was there before stays.
        """
        curves, stream = self.curves, io.BytesIO()
        units = [*curves.units.items(), ("time", curves.time_unit)]
        arrays: dict[str, Any] = {
            **curves.neurons,
            "time": curves.time,
            "residual_time": curves.residual_time,
            "residuals": curves.residuals,
            "units": np.array(units),
        }
        np.savez(stream, **arrays)
        write_whole(path, stream.getvalue())


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves(Tabulated):
    """Every neuron over time, in the user's units.

    Attributes
    ----------
    time : (T,) array
        Of the samples.
    time_unit : str
    neurons : mapping of str to (T, N) array
        By the neuron's name, cell by cell.
    live : mapping of str to (N,) array of bool
        In which cells it is there, and free to move.
    units : mapping of str to str
        Units of measure by the neuron's name, where they are known.
    residual_time : (R,) array
        Of every step.
    residuals : (R, 2) array
        Relative constraint and stationarity residuals.

    Examples
    --------
    >>> import ann_dc
    >>> solution = ann_dc.solve(ann_dc.plants.double_integrator(N=3))
    >>> curves = solution.trajectory.curves
    >>> [*curves.columns()][:3], curves.column_units()["u.a[0]"], curves.time_unit
    (['time', 'q.x[1]', 'q.x[2]'], 'm/s^2', 'unit time constants')
    """

    time: np.ndarray
    time_unit: str
    neurons: Mapping[str, np.ndarray]
    live: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    residual_time: np.ndarray
    residuals: np.ndarray

    @property
    def curves(self) -> Curves:
        """Themselves."""
        return self

    def columns(self) -> dict[str, np.ndarray]:
        """(T,) values by the name of their column; a residual is that of the step before."""
        last = np.searchsorted(self.residual_time, self.time, side="right") - 1
        residuals = self.residuals[np.maximum(last, 0)].T
        return {
            "time": self.time,
            **{label: self.neurons[name][:, k] for label, name, k in self._labels()},
            **dict(zip(RESIDUALS, residuals)),
        }

    def column_units(self) -> dict[str, str]:
        """Units of measure by the name of their column, where they are known."""
        known = {label: self.units[n] for label, n, _ in self._labels() if n in self.units}
        return {"time": self.time_unit, **known}

    def _labels(self) -> list[tuple[str, str, int]]:
        """Column, neuron and cell of all that is there."""
        return [
            (f"{name}[{k}]", name, int(k))
            for name, live in self.live.items()
            for k in np.flatnonzero(live)
        ]


WRITERS = {".csv": Tabulated.to_csv, ".npz": Tabulated.to_npz}
"""How curves are written, by the end of the file's name."""


def write_curves(source: Tabulated, path: str | os.PathLike[str]) -> None:
    """Write curves as the end of the file's name says.

    Parameters
    ----------
    source : Tabulated
        A trajectory, or the run of a circuit.
    path : path-like
        Ends in one of `WRITERS`.

    Raises
    ------
    OutputError
        If the name ends otherwise, or the file cannot be written.

    Examples
    --------
    >>> check_curves_file("curves.xlsx")
    Traceback (most recent call last):
    ann_dc.errors.OutputError: 'curves.xlsx': curves are written as .csv or .npz; end its name so
    """
    check_curves_file(path)
    WRITERS[Path(path).suffix.lower()](source, path)


def check_curves_file(path: str | os.PathLike[str]) -> None:
    """Refuse a file whose name does not say how curves are to be written.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    OutputError
    """
    if Path(path).suffix.lower() not in WRITERS:
        raise OutputError(
            f"{os.fspath(path)!r}: curves are written as {' or '.join(WRITERS)}; end its name so"
        )
