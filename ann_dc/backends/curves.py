"""Curves of every neuron over time in the user's units, as a table or a file.

Each neuron of a cell has a column, for example ``q.x[3]`` for q.x of cell 3, next to time and
residuals.
"""

from __future__ import annotations

import csv
import io
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ann_dc.errors import OutputError, PandasMissing
from ann_dc.files import write_whole
from ann_dc.parquet import pyarrow_modules, write_blocks

RESIDUALS = ("constraint_residual", "stationarity_residual")
"""Column names of the relative residuals."""


class Tabulated(ABC):
    """Base class of results over time that are written as tables and files."""

    @property
    @abstractmethod
    def curves(self) -> Curves:
        """Values of every neuron over time, in the user's units."""

    def to_frame(self) -> Any:
        """Return the curves as a pandas data frame, one row per sample.

        The columns are ``time``, every existing neuron by name and cell (``q.x[3]``), and the two
        residuals. Known units of measure are in ``attrs["units"]``, by column. Raises
        `PandasMissing` if pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise PandasMissing(
                "to_frame: a data frame needs pandas, which is not installed: pip install "
                "'ann-dc[pandas]'; to_csv and to_npz do not need it"
            ) from error
        frame = pandas.DataFrame(self.curves.columns())
        frame.attrs["units"] = self.curves.column_units()
        return frame

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the curves as a CSV file, one row per sample, with all digits.

        The first line contains the column names of `to_frame`, each followed by its unit of measure
        in parentheses if known: ``q.x[3] (m)``. Raises `OutputError` if the file cannot be written;
        an existing file is then left unchanged.
        """
        columns, units = self.curves.columns(), self.curves.column_units()
        stream = io.StringIO()
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(f"{name} ({units[name]})" if name in units else name for name in columns)
        table.writerows(np.stack([*columns.values()], axis=1).tolist())
        write_whole(path, stream.getvalue().encode("utf-8"))

    def to_npz(self, path: str | os.PathLike[str]) -> None:
        """Write the curves as an ``.npz`` file for ``numpy.load(path)``.

        The arrays are ``time`` (T,), every neuron by name (T, N), ``residual_time`` (R,) and
        ``residuals`` (R, 2) of every step, and ``units``. A neuron is zero in cells that do not
        contain it. ``units`` contains pairs of a name and its unit of measure.

        Raises `OutputError` if the file cannot be written; an existing file is then left unchanged.
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

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write the columns of `to_frame` as a Parquet file.

        Known units of measure by column are in the metadata ``ann_dc.units``, as JSON. Raises
        `PyarrowMissing` if pyarrow is not installed, and `OutputError` if the file cannot be
        written; an existing file is then left unchanged.
        """
        pyarrow_modules("to_parquet", "to_csv and to_npz do not need it")
        columns = self.curves.columns()
        units = json.dumps(self.curves.column_units())
        types = dict.fromkeys(columns, "float64")
        write_blocks(path, types, [[*columns.values()]], {"ann_dc.units": units})


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves(Tabulated):
    """Values of every neuron over time, in the user's units.

    Examples
    --------
    >>> import ann_dc
    >>> solution = ann_dc.solve(ann_dc.plants.double_integrator(N=3))
    >>> curves = solution.trajectory.curves
    >>> [*curves.columns()][:3], curves.column_units()["u.a[0]"], curves.time_unit
    (['time', 'q.x[1]', 'q.x[2]'], 'm/s^2', 'unit time constants')
    """

    time: np.ndarray  # times (T,) of the samples
    time_unit: str
    neurons: Mapping[str, np.ndarray]  # values (T, N) by neuron name
    live: Mapping[str, np.ndarray]  # mask (N,) of cells in which the neuron exists and moves
    units: Mapping[str, str]  # known units of measure by neuron name
    residual_time: np.ndarray  # time (R,) of every step
    residuals: np.ndarray  # relative constraint and stationarity residuals (R, 2)

    @property
    def curves(self) -> Curves:
        """The record itself."""
        return self

    def columns(self) -> dict[str, np.ndarray]:
        """Return the values (T,) by column name; a residual is that of the preceding step."""
        last = np.searchsorted(self.residual_time, self.time, side="right") - 1
        residuals = self.residuals[np.maximum(last, 0)].T
        return {
            "time": self.time,
            **{label: self.neurons[name][:, k] for label, name, k in self._labels()},
            **dict(zip(RESIDUALS, residuals)),
        }

    def column_units(self) -> dict[str, str]:
        """Return the known units of measure by column name."""
        known = {label: self.units[n] for label, n, _ in self._labels() if n in self.units}
        return {"time": self.time_unit, **known}

    def _labels(self) -> list[tuple[str, str, int]]:
        """Return column, neuron and cell of every curve."""
        return [
            (f"{name}[{k}]", name, int(k))
            for name, live in self.live.items()
            for k in np.flatnonzero(live)
        ]


WRITERS = {
    ".csv": Tabulated.to_csv,
    ".npz": Tabulated.to_npz,
    ".parquet": Tabulated.to_parquet,
}
"""Functions that write curves, by file name extension."""


def write_curves(source: Tabulated, path: str | os.PathLike[str]) -> None:
    """Write curves in the format given by the file name extension.

    The source is a trajectory or a circuit run, and the path ends in a key of `WRITERS`. Raises
    `OutputError` if the extension is unknown or the file cannot be written, and `PyarrowMissing`
    for a Parquet file without pyarrow.

    Examples
    --------
    >>> check_curves_file("curves.xlsx")
    Traceback (most recent call last):
    ann_dc.errors.OutputError: 'curves.xlsx': expected a name that ends in .csv, .npz or .parquet
    """
    check_curves_file(path)
    WRITERS[Path(path).suffix.lower()](source, path)


def check_curves_file(path: str | os.PathLike[str]) -> None:
    """Check before a long run that curves can be written to a path.

    Raises `OutputError` if the file name extension is not a format of curves, and `PyarrowMissing`
    for a Parquet file without pyarrow.
    """
    suffix, (*first, last) = Path(path).suffix.lower(), WRITERS
    if suffix not in WRITERS:
        raise OutputError(
            f"{os.fspath(path)!r}: expected a name that ends in {', '.join(first)} or {last}"
        )
    if suffix == ".parquet":
        pyarrow_modules(repr(os.fspath(path)), ".csv and .npz do not need it")
