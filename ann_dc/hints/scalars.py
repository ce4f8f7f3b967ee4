"""The checks of single numbers, texts and arrays."""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np

from ann_dc.errors import ArgumentValueError
from ann_dc.hints.complaints import Check, Complaint


def _none(value: Any) -> Complaint | None:
    return None if value is None else Complaint(expected="None", given=value)


def float_check(value: Any) -> Complaint | None:
    """The check of a number: a ``value`` that is not nan."""
    if number_check(value) is not None:
        return Complaint(expected="a number", given=value)
    if value != value:
        return Complaint(expected="a number", given=value, error=ArgumentValueError)
    return None


def number_check(value: Any) -> Complaint | None:
    """The check of a number that may be nan: a real ``value`` and no bool."""
    if type(value) is float or (isinstance(value, numbers.Real) and not isinstance(value, bool)):
        return None
    return Complaint(expected="a number", given=value)


def _int(value: Any) -> Complaint | None:
    if type(value) is int or (
        isinstance(value, numbers.Integral) and not isinstance(value, (bool, np.bool_))
    ):
        return None
    return Complaint(expected="a whole number", given=value)


def _complex(value: Any) -> Complaint | None:
    if isinstance(value, numbers.Complex) and not isinstance(value, bool):
        return None
    return Complaint(expected="a number", given=value)


def _bool(value: Any) -> Complaint | None:
    if value is True or value is False or isinstance(value, np.bool_):
        return None
    return Complaint(expected="True or False", given=value)


def _text(value: Any) -> Complaint | None:
    return None if isinstance(value, str) else Complaint(expected="text", given=value)


def _array(value: Any) -> Complaint | None:
    if isinstance(value, (list, tuple)):
        value = as_array(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiubc":
        return None
    return Complaint(expected="a NumPy array of numbers", given=value)


def as_array(value: Any) -> Any:
    """Lists of numbers as an array; anything else as it is."""
    if not isinstance(value, (list, tuple)):
        return value
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return value
    return array if array.dtype.kind in "fiub" else value


SCALARS: dict[Any, Check] = {
    type(None): _none,
    float: float_check,
    int: _int,
    complex: _complex,
    bool: _bool,
    str: _text,
    np.ndarray: _array,
}
"""By their type hint."""
