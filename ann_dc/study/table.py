"""Table of a study: a record per case, a column per setting, metric and outcome."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ann_dc.errors import PandasMissing, StudyError, UnknownNameError
from ann_dc.study.records import FAILED, LOST, OUTCOME, POINT, TIMED_OUT, Row, Value
from ann_dc.study.store import Store
from ann_dc.study.table_export import write_parquet
from ann_dc.study.yield_metrics import yield_of
from ann_dc.summaries import summarised
from ann_dc.validation import checked
from ann_dc.yields import Limit, Yield

RESIDUALS = "residuals"
"""Name of the stored residuals."""
NO_RESULT = (FAILED, TIMED_OUT, LOST)
"""Outcomes of cases without a result."""


@checked
@summarised(
    lambda self: {
        "rows": len(self),
        "columns": ", ".join(self.columns),
        **({"stopped": self.stopped} if self.stopped else {}),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Records of a study in the order of its cases.

    Attributes
    ----------
    columns : mapping of str to (rows,) array
        Numbers, nan if missing; or text, empty if missing.
    spec : mapping of metric to Limit
        Specification of the study.
    stopped : str
        Reason of an early end; empty if the last case was run.
    varied : tuple of str
        Settings that the study varies.
    trajectories : mapping of case number to arrays by name
        Stored trajectories; empty unless the study has ``curves``.

    Examples
    --------
    >>> outcomes = np.array(["settled", "settled", "failed"])
    >>> table = Table(columns={"neurons": np.full(3, 96.0), "outcome": outcomes}, spec={})
    >>> table.outcomes, print(table.yield_of())
    66.7 % (9.4 to 99.2 %, 2 of 3)
    ({'settled': 2, 'failed': 1}, None)
    """

    columns: Mapping[str, Any]
    spec: Mapping[str, Any]
    stopped: str = ""
    varied: tuple[str, ...] = ()
    trajectories: Mapping[int, Mapping[str, np.ndarray]] = field(default_factory=dict)

    @classmethod
    def of(cls, store: Store, *, stopped: str = "") -> Table:
        """Return the table with the complete content of an open store."""
        values: dict[str, list[Value]] = {name: [] for name in store.columns}
        for row in store.rows():
            for name, held in values.items():
                value = row.get(name)
                held.append(sys.intern(value) if isinstance(value, str) else value)
        columns = {name: _array(values.pop(name)) for name in [*values]}
        kept: dict[int, Mapping[str, np.ndarray]] = {}
        if store.identity.get("curves"):
            kept = {point: store.curves(point) for point in columns[POINT].tolist()}
        return cls(
            columns=columns,
            spec=store.identity.get("spec", {}),
            stopped=stopped,
            varied=tuple(name for name in store.identity.get("vary", {}) if name in columns),
            trajectories={point: arrays for point, arrays in kept.items() if arrays},
        )

    def __len__(self) -> int:
        return len(self.columns[OUTCOME])

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column; raise `UnknownNameError` if the name does not exist."""
        if column not in self.columns:
            raise UnknownNameError.of("column", column, self.columns)
        return self.columns[column]

    def rows(self) -> Iterator[Row]:
        """Return an iterator over the records."""
        for values in zip(*(column.tolist() for column in self.columns.values())):
            yield dict(zip(self.columns, values))

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of records by outcome, most frequent first."""
        return dict(Counter(self.columns[OUTCOME].tolist()).most_common())

    @property
    def is_complete(self) -> bool:
        """True if every case has a result of any outcome."""
        return not self.stopped and not np.isin(self.columns[OUTCOME].astype(str), NO_RESULT).any()

    def chosen(self, rows: np.ndarray) -> Table:
        """Return the table of the records selected by a mask (rows,) or by indices."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return replace(self, columns=columns)

    def by(self, column: str) -> dict[Any, Table]:
        """Group the records by the value of a column, in order of first occurrence."""
        values = self[column]
        return {value: self.chosen(values == value) for value in dict.fromkeys(values.tolist())}

    def yield_of(self, spec: Mapping[str, Any] | None = None) -> Yield:
        """Return the fraction of records that settled and satisfy a specification.

        By default the limits are those of the study. Raises `UnknownNameError` if a metric of the
        specification was not measured, and `StudyError` if a limit is invalid.
        """
        limits: Mapping[str, Limit] = self.spec if spec is None else spec
        for name in limits:
            self[name]
        return yield_of(self.columns, limits)

    def curves(self, name: str = RESIDUALS) -> CurveTable:
        """Return stored trajectories of all records, one row per case and time.

        The columns are the case number, the varied settings and the network time, and then
        ``constraint``, ``stationarity`` and their maximum ``residual``; for the name of a neuron
        its values by stage, ``u.a[0]``, in the user's units; nan where a case has fewer stages.

        Raises `StudyError` if the study stored no trajectories, and `UnknownNameError` for another
        name.

        Examples
        --------
        >>> import ann_dc
        >>> study = ann_dc.Study(
        ...     subject=ann_dc.plants.double_integrator(N=3), vary={"run.method": ["RK45", "BDF"]},
        ...     metrics=["settling_time"], curves=50,
        ... )
        >>> list(study.run(workers=0).curves().columns)
        ['point', 'run.method', 'time', 'constraint', 'stationarity', 'residual']
        """
        if not self.trajectories:
            raise StudyError(
                "curves: the study stored no trajectories; use curves=200, the number of "
                "states to store per case"
            )
        rows = np.flatnonzero(np.isin(self.columns[POINT], list(self.trajectories)))
        kept = [self.trajectories[int(self.columns[POINT][row])] for row in rows]
        names = [known for known in kept[0] if not known.endswith("time")]
        if name not in names:
            raise UnknownNameError.of("curve", name, names)
        own = "residual_time" if name == RESIDUALS else "time"
        counts = [len(arrays[own]) for arrays in kept]
        heads = {n: np.repeat(self.columns[n][rows], counts) for n in (POINT, *self.varied)}
        heads["time"] = np.concatenate([arrays[own] for arrays in kept])
        wide = max(arrays[name].shape[1] for arrays in kept)
        values = np.full((sum(counts), wide), np.nan)  # cases may have fewer stages
        for part, arrays in zip(np.split(values, np.cumsum(counts)[:-1]), kept):
            part[:, : arrays[name].shape[1]] = arrays[name]
        if name == RESIDUALS:
            parts = {"constraint": values[:, 0], "stationarity": values[:, 1]}
            return CurveTable(columns=heads | parts | {"residual": values.max(axis=1)})
        parts = {f"{name}[{k}]": column for k, column in enumerate(values.T)}
        return CurveTable(columns=heads | parts)

    def to_frame(self) -> Any:
        """Convert the table to a pandas data frame; raise `PandasMissing` without pandas."""
        return _frame(self.columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveTable:
    """Trajectories of a study as columns of equal length.

    Attributes
    ----------
    columns : mapping of str to (rows,) array
        Case number, varied settings, network time, and values.
    """

    columns: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.columns["time"])

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column; raise `UnknownNameError` if the name does not exist."""
        if column not in self.columns:
            raise UnknownNameError.of("column", column, self.columns)
        return self.columns[column]

    def to_frame(self) -> Any:
        """Convert the columns to a pandas data frame; raise `PandasMissing` without pandas."""
        return _frame(self.columns)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write the columns as a Parquet file.

        Raises `PyarrowMissing` if pyarrow is not installed, and `OutputError` if the file cannot be
        written; an existing file is then unchanged.
        """
        lists = [column.tolist() for column in self.columns.values()]
        kinds = {
            name: sorted({type(value).__name__ for value in values})
            for name, values in zip(self.columns, lists)
        }
        write_parquet(path, [list(map(list, zip(*lists)))], kinds, "{}")


@checked
def load_table(folder: str | os.PathLike[str]) -> Table:
    """Read the table of a study from its folder, also while the study runs.

    Parameters
    ----------
    folder : path-like
        Folder that was passed to `Study.run`, or to ``ann-dc study`` as --output.

    Returns
    -------
    Table
        Records that are stored so far, in the order of the cases.

    Raises
    ------
    StoreError
        If the folder does not contain a study.

    Examples
    --------
    >>> import ann_dc, tempfile
    >>> study = ann_dc.Study(
    ...     subject="double_integrator", vary={"nonideal.mismatch": [0.001, 0.01]}, samples=2
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = study.run(folder, workers=0)
    ...     len(load_table(folder))
    4
    """
    with Store.open(folder) as store:
        return Table.of(store)


def _frame(columns: Mapping[str, Any]) -> Any:
    try:
        import pandas
    except ImportError as error:
        raise PandasMissing(
            "to_frame: a data frame needs pandas: pip install 'ann-dc[study]'"
        ) from error
    return pandas.DataFrame(dict(columns))


def _array(values: Iterable[Value]) -> np.ndarray:
    """Return an array of integers, else of numbers, else of text."""
    listed = list(values)
    kinds = {type(value) for value in listed}
    if str in kinds:
        return np.array(["" if value is None else str(value) for value in listed], object)
    if kinds == {int}:
        return np.array(listed, np.int64)
    return np.array([np.nan if value is None else value for value in listed], float)
