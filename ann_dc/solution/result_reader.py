"""JSON tables and arrays as records, read with distrust: every field by its declared type.

The types are those of the record's own annotations, so that a record which gets a field is read
with it; a field with a default may be missing, as it is in files of earlier versions. Shapes are
told here, since annotations do not.
"""

from __future__ import annotations

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields
from enum import Enum
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import FileFormatError, UnknownNameError
from ann_dc.gain_design.freeze import Candidate
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.rules.gains import Gains
from ann_dc.gain_design.scheduled_run import FirstRun
from ann_dc.network.metrics.contract import Metric
from ann_dc.network.metrics.pyramid import Pyramid
from ann_dc.network.network import Network
from ann_dc.solution.result_writer import METRICS
from ann_dc.weights.entries import Entries

SHAPES: dict[type, dict[str, str]] = {
    Trajectory: {"time": "T", "states": "T n", "residual_time": "R", "residuals": "R 2"},
    Gains: {"rho": "P", "rate": "P N"},
    Pyramid: {"gains": "* C C"},
    Spectrum: {"eigenvalues": "*"},
    FirstRun: {"state": "n"},
    Candidate: {"stray": "n"},
    Design: {"state": "n"},
}
"""Of the arrays of a record: n, P and N are those of the network, other letters agree within the
record, a star is any; none is zero."""

NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


class Reader:
    """Reads records about one network.

    Parameters
    ----------
    entries : Entries
        The arrays, each taken once.
    network : Network or None
        What stands where a record has one; None where it has none.

    Examples
    --------
    >>> Reader(None, None).value(tuple[float, ...], [1, "nan"], "run/time")
    (1.0, nan)
    """

    def __init__(self, entries: Entries, network: Network | None) -> None:
        self.entries, self.network = entries, network

    def value(self, hint: Any, given: Any, place: str) -> Any:
        """A value of a declared type.

        Parameters
        ----------
        hint : type
            As an annotation says it.
        given : JSON data
        place : str
            Where it stands; errors begin with it.

        Raises
        ------
        FileFormatError, UnknownNameError
            If it is none.
        """
        if get_origin(hint) in (types.UnionType, Union):
            (kind,) = (part for part in get_args(hint) if part is not type(None))
            return None if given is None else self.value(kind, given, place)
        if get_origin(hint) is not None:
            return self._composed(hint, given, place)
        if hint is np.ndarray:
            return self._array(given, place)
        if hint in (bool, int, float, str):
            return _plain(hint, given, place)
        if issubclass(hint, Enum):
            return _choice(hint.__members__, given, place)
        if hint is Metric:
            return self._metric(given, place)
        return self.record(hint, given, place)

    def _composed(self, hint: Any, given: Any, place: str) -> Any:
        """A tuple of one type, or a mapping of names to one type."""
        if get_origin(hint) is tuple:
            kind = get_args(hint)[0]
            parts = _checked(list, given, place)
            return tuple(self.value(kind, part, f"{place}/{i}") for i, part in enumerate(parts))
        kind = get_args(hint)[1]
        parts = _checked(dict, given, place)
        return {name: self.value(kind, part, f"{place}/{name}") for name, part in parts.items()}

    def record(self, kind: type, given: Any, place: str) -> Any:
        """A record, checked as whenever one is made.

        Parameters
        ----------
        kind : type
            A dataclass.
        given : JSON data
        place : str

        Raises
        ------
        FileFormatError, UnknownNameError
            If a field is missing, unknown, or of another type or shape.
        AnnDcError
            If the record itself refuses what it is given.
        """
        table, hints = _checked(dict, given, place), _hints(kind)
        unknown = sorted(set(table) - set(hints))
        if unknown:
            raise FileFormatError(f"{place}: unknown key {', '.join(unknown)}")
        values = {}
        for field in fields(kind):
            name, hint = field.name, hints[field.name]
            if hint is Network:
                values[name] = self.network
            elif name in table:
                values[name] = self.value(hint, table[name], f"{place}/{name}")
            elif field.default is MISSING and field.default_factory is MISSING:
                raise FileFormatError(f"{place}/{name}: missing")
        self._check_shapes(kind, values, place)
        return kind(**values)

    def _metric(self, given: Any, place: str) -> Any:
        table = dict(_checked(dict, given, place))
        kind = _choice(METRICS, table.pop("type", None), f"{place}/type")
        metric = self.record(kind, table, place)
        if self.network is not None:
            with np.errstate(over="ignore"):  # of rates, where a time constant is next to nothing
                metric.check(self.network.row)
        return metric

    def _array(self, given: Any, place: str) -> np.ndarray:
        """Of any shape, which the record it belongs to checks."""
        kind = _choice({"float": float, "complex": complex}, given, place)
        values = self.entries.numbers(place, *((None,) * axes for axes in range(5)))
        if kind is float:
            return values
        if values.shape[-1:] != (2,):
            raise FileFormatError(f"entry {place!r}: complex numbers need their two parts")
        return values[..., 0] + 1j * values[..., 1]

    def _check_shapes(self, kind: type, values: Mapping[str, Any], place: str) -> None:
        known: dict[str, int] = {}
        if self.network is not None:
            neurons, stages = self.network.live.shape
            known = {"n": self.network.size, "P": neurons, "N": stages}
        for name, shape in SHAPES.get(kind, {}).items():
            given = values.get(name)
            for array in given if isinstance(given, tuple) else (given,):
                if array is not None and not _fits(array.shape, shape.split(), known):
                    raise FileFormatError(
                        f"entry {f'{place}/{name}'!r} has shape {array.shape}, expected ({shape}) "
                        f"with {known}"
                    )


def _fits(shape: tuple[int, ...], letters: list[str], known: dict[str, int]) -> bool:
    """Whether a shape is the expected one; letters that are met first are known from then on."""
    if len(shape) != len(letters):
        return False
    for length, letter in zip(shape, letters):
        expected = int(letter) if letter.isdigit() else known.setdefault(letter, length)
        if length < 1 or (letter != "*" and length != expected):
            return False
    return True


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _plain(kind: type, given: Any, place: str) -> Any:
    """A number, a word, or whether; a bool is no number."""
    if kind is float and isinstance(given, str) and given in NOT_FINITE:
        return NOT_FINITE[given]
    if kind is float and isinstance(given, int) and not isinstance(given, bool):
        try:
            return float(given)
        except OverflowError:
            given = "a whole number beyond any float"
    if not isinstance(given, kind) or (kind is not bool and isinstance(given, bool)):
        raise FileFormatError(f"{place}: expected {kind.__name__}, got {given!r:.60}")
    return given


def _checked(kind: type, given: Any, place: str) -> Any:
    if not isinstance(given, kind):
        word = "a table" if kind is dict else "a list"
        raise FileFormatError(f"{place}: expected {word}, got {given!r:.60}")
    return given


def _choice(available: Mapping[str, Any], given: Any, place: str) -> Any:
    if not isinstance(given, str) or given not in available:
        raise UnknownNameError.of(f"{place}:", given, available)
    return available[given]
