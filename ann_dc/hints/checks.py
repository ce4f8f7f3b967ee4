"""A type hint becomes a check: a function of a value that complains, or does not.

A hint is read once, when a function is first called; what is left for every call are closures that
compare classes. Numbers count as their hints read: every whole number is a float, no bool is a
number, and nan is none unless the hint or the default says so.
"""

from __future__ import annotations

import collections.abc as abc
import math
import types
import typing
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ann_dc.errors import ArgumentValueError
from ann_dc.hints.complaints import Check, Complaint, callable_check, class_check
from ann_dc.hints.scalars import SCALARS, float_check, number_check
from ann_dc.hints.values import NotEmpty, OrNan, Own, Range, Shape
from ann_dc.hints.words import is_empty


def check_of(hint: Any) -> Check | None:
    """The check of a type hint; None where it takes anything.

    Parameters
    ----------
    hint : object
        As `typing.get_type_hints` tells it, with extras.

    Examples
    --------
    >>> check = check_of(tuple[int, ...] | None)
    >>> check((1, 2)), check(None), check((1, "x")).raised_for("stages")
    (None, None, ArgumentTypeError("stages[1]: expected a whole number, got the text 'x'"))
    """
    if hint in (Any, object) or isinstance(hint, (typing.TypeVar, typing.ParamSpec)):
        return None
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _annotated(inside[0], inside[1:])
    if origin in (typing.Union, types.UnionType):
        return _union([check_of(part) for part in inside])
    if origin is typing.Literal:
        return _literal(inside)
    if origin is type:
        return _subclass(inside[0])
    if origin is not None:
        return _CONTAINERS.get(origin, lambda _: class_check(origin))(inside)
    if isinstance(hint, type):
        return SCALARS.get(hint) or class_check(hint)
    return None


# ---- classes -------------------------------------------------------------------------------------


def _subclass(kind: Any) -> Check:
    wanted = typing.get_origin(kind) or kind

    def check(value: Any) -> Complaint | None:
        if isinstance(value, type) and (wanted is Any or issubclass(value, wanted)):
            return None
        return Complaint(expected=f"a subclass of {wanted.__name__}", given=value)

    return check


def _literal(allowed: tuple) -> Check:
    def check(value: Any) -> Complaint | None:
        if any(type(value) is type(one) and value == one for one in allowed):
            return None
        return Complaint(
            expected=f"one of {', '.join(map(repr, allowed))}",
            given=value,
            error=ArgumentValueError,
        )

    return check


# ---- more than one -----------------------------------------------------------------------------


def _union(checks: list[Check | None]) -> Check | None:
    if None in checks:
        return None
    alternatives = [check for check in checks if check is not None]

    def check(value: Any) -> Complaint | None:
        complaints = []
        for one in alternatives:
            complaint = one(value)
            if complaint is None:
                return None
            complaints.append(complaint)
        nearest = [c for c in complaints if c.where or c.error is ArgumentValueError]
        if nearest:
            return nearest[0]
        wanted = next((c.wanted for c in complaints if c.wanted is not None), None)
        words = dict.fromkeys(c.expected for c in complaints if c.expected != "None")
        return Complaint(expected=" or ".join(words), given=value, wanted=wanted)

    return check


def _items(kind: Any, words: str) -> Callable[[tuple], Check]:
    def of(inside: tuple) -> Check:
        item = check_of(inside[0]) if inside else None
        what = _plural(inside[0], words) if inside else words

        def check(value: Any) -> Complaint | None:
            if isinstance(value, (str, bytes, abc.Mapping)) or not isinstance(value, kind):
                return Complaint(expected=what, given=value)
            if item is None or isinstance(value, abc.Iterator):
                return None
            return _first(item, enumerate(value))

        return check

    return of


def _first(item: Check, named: typing.Iterable[tuple[Any, Any]]) -> Complaint | None:
    for place, one in named:
        complaint = item(one)
        if complaint is not None:
            return replace(complaint, where=f"[{place}]{complaint.where}")
    return None


def _plural(hint: Any, words: str) -> str:
    name = getattr(hint, "__name__", "")
    return f"{words} of {name}" if isinstance(hint, type) and name[:1].isupper() else words


def _tuple_of(inside: tuple) -> Check:
    if len(inside) == 2 and inside[1] is Ellipsis:
        return _items((tuple, list), "a tuple")(inside[:1])
    items = [check_of(part) for part in inside]

    def check(value: Any) -> Complaint | None:
        if not isinstance(value, (tuple, list)) or len(value) != len(items):
            return Complaint(expected=f"a tuple of {len(items)}", given=value)
        for place, (item, one) in enumerate(zip(items, value)):
            complaint = None if item is None else item(one)
            if complaint is not None:
                return replace(complaint, where=f"[{place}]{complaint.where}")
        return None

    return check


def _mapping_of(inside: tuple) -> Check:
    keys, values = (check_of(part) for part in inside) if inside else (None, None)

    def check(value: Any) -> Complaint | None:
        if not isinstance(value, abc.Mapping):
            return Complaint(expected='a mapping such as {"name": value}', given=value)
        for key, one in value.items():
            complaint = None if keys is None else keys(key)
            if complaint is not None:
                return replace(complaint, expected=f"{complaint.expected} for a key")
            complaint = None if values is None else values(one)
            if complaint is not None:
                return replace(complaint, where=f"[{key}]{complaint.where}")
        return None

    return check


_SEQUENCES = (abc.Sequence, np.ndarray)
_CONTAINERS: dict[Any, Callable[[tuple], Check]] = {
    tuple: _tuple_of,
    list: _items(list, "a list"),
    set: _items(abc.Set, "a set"),
    frozenset: _items(abc.Set, "a set"),
    abc.Set: _items(abc.Set, "a set"),
    abc.Sequence: _items(_SEQUENCES, "a sequence"),
    abc.Collection: _items(abc.Collection, "a collection"),
    abc.Iterable: _items(abc.Iterable, "a sequence"),
    dict: _mapping_of,
    abc.Mapping: _mapping_of,
    abc.Callable: lambda _: callable_check,
}


# ---- annotated ---------------------------------------------------------------------------------


def _annotated(hint: Any, marks: tuple) -> Check | None:
    if any(isinstance(mark, Own) for mark in marks):
        return None
    check = check_of(hint)
    or_nan = any(isinstance(mark, OrNan) for mark in marks)
    if or_nan and check is float_check:
        check = number_check
    for mark in marks:
        if isinstance(mark, Range):
            check = _both(check, _ranged(mark))
        elif isinstance(mark, NotEmpty):
            check = _both(check, _filled)
        elif isinstance(mark, Shape) and not or_nan:
            check = _both(check, _without_nan)
    return check


def _both(first: Check | None, second: Check) -> Check:
    if first is None:
        return second
    return lambda value: first(value) or second(value)


def _ranged(asked: Range) -> Check:
    def check(value: Any) -> Complaint | None:
        if value in asked:
            return None
        return Complaint(expected=asked.words, given=value, error=ArgumentValueError)

    return check


def _filled(value: Any) -> Complaint | None:
    if not is_empty(value):
        return None
    return Complaint(expected="one at least", given=value, error=ArgumentValueError)


def _without_nan(value: Any) -> Complaint | None:
    total = value.sum() if isinstance(value, np.ndarray) and value.dtype.kind in "fc" else 0.0
    if not math.isnan(abs(total)) or not np.isnan(value).any():
        return None
    return Complaint(expected="numbers, none of them nan", given=value, error=ArgumentValueError)
