"""Records as JSON tables and arrays, field by field, as `reading` takes them back.

A field that is a number, a word or a list of them stands in the table; an array is an entry of its
own, named by its place (``run/trajectory/states``), and the table says what it holds. A network is
a file of its own, and is left out; so is None, where the field says so (`WHERE_GIVEN`).
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from ann_dc.dataclass_pickling import WHERE_GIVEN
from ann_dc.errors import OutputError
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Metric
from ann_dc.network.preconditioners.cyclic_reduction import Tree
from ann_dc.network.preconditioners.diagonal import TimeConstants
from ann_dc.network.preconditioners.multilevel import Pyramid
from ann_dc.network.preconditioners.resistive_grid import Grid

METRICS: dict[str, type[Metric]] = {
    kind.__name__: kind for kind in (TimeConstants, Pyramid, Grid, Tree)
}
"""Metrics by the word that a table has for them."""


class Writer:
    """Writes records; their arrays gather here.

    Attributes
    ----------
    arrays : dict of str to array
        By place, float64; a complex array has its real and imaginary parts in a last axis.

    Examples
    --------
    >>> from ann_dc.analysis import Spectrum
    >>> writer = Writer()
    >>> writer.value(Spectrum(eigenvalues=np.array([-1 + 2j])), "spectrum")
    {'eigenvalues': 'complex'}
    >>> writer.arrays["spectrum/eigenvalues"].tolist()
    [[-1.0, 2.0]]
    """

    def __init__(self) -> None:
        self.arrays: dict[str, np.ndarray] = {}

    def value(self, value: Any, place: str) -> Any:
        """A value as JSON data.

        Parameters
        ----------
        value : None, bool, number, str, Enum, array, tuple, mapping or record
        place : str
            Where it stands.

        Raises
        ------
        OutputError
            If it is none of those.
        """
        if value is None or isinstance(value, (bool, str)):
            return value
        if isinstance(value, numbers.Number):
            return self._number(value, place)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, np.ndarray):
            return self._array(value, place)
        return self._composed(value, place)

    def _composed(self, value: Any, place: str) -> Any:
        if isinstance(value, (tuple, list)):
            return [self.value(part, f"{place}/{i}") for i, part in enumerate(value)]
        if isinstance(value, Mapping):
            return {name: self.value(part, f"{place}/{name}") for name, part in value.items()}
        if is_dataclass(value) and not isinstance(value, type):
            return self._record(value, place)
        raise OutputError(f"{place}: a {type(value).__name__} cannot be saved")

    def _record(self, record: Any, place: str) -> dict[str, Any]:
        given = ((f, getattr(record, f.name)) for f in fields(record))
        values = {f.name: v for f, v in given if v is not None or WHERE_GIVEN not in f.metadata}
        kind = {"type": type(record).__name__} if isinstance(record, Metric) else {}
        return kind | {
            name: self.value(value, f"{place}/{name}")
            for name, value in values.items()
            if not isinstance(value, Network)
        }

    def _number(self, value: Any, place: str) -> int | float | str:
        """JSON has no number that is not finite, so that one is a word."""
        if isinstance(value, numbers.Integral):
            return int(value)
        if not isinstance(value, numbers.Real):
            raise OutputError(f"{place}: {value!r} is no real number, and cannot be saved")
        return float(value) if math.isfinite(value) else str(float(value))

    def _array(self, values: np.ndarray, place: str) -> str:
        if values.dtype.kind not in "fc":
            raise OutputError(f"{place}: an array of {values.dtype} cannot be saved")
        is_complex = np.iscomplexobj(values)
        self.arrays[place] = (
            np.stack([np.real(values), np.imag(values)], -1) if is_complex else values
        )
        return "complex" if is_complex else "float"
