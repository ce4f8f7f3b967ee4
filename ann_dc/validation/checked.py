"""Validation of arguments against type hints when a function is called.

The decorator ``@checked`` applies to a function, a method or a record. An argument that does not
match its hint raises an `ArgumentError`. The error names the argument, the expected and the given
value and, if possible, a remedy. Functions that are called in the middle of a run are not checked.

A checked function is an entry point of the package and therefore runs with one BLAS thread
(`one_thread`).

Hints are read once, at the first call. Later calls only run closures that compare classes. Numbers
follow their hints: every integer is accepted as a float, a bool is not a number, and nan is
rejected unless the hint or the default allows it.
"""

from __future__ import annotations

import collections.abc as abc
import dataclasses
import functools
import inspect
import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ann_dc.errors import AnnDcError, ArgumentError, ArgumentTypeError, ArgumentValueError
from ann_dc.resources import one_thread
from ann_dc.validation.values import (
    SCALARS,
    Check,
    Complaint,
    Finite,
    NotEmpty,
    OrNan,
    Own,
    Range,
    Shape,
    as_array,
    callable_check,
    class_check,
    float_check,
    given_words,
    is_empty,
    number_check,
)

# ---- A type hint becomes a check: a function of a value that complains, or does not


def check_of(hint: Any) -> Check | None:
    """Return the check of a type hint; None if it accepts any value.

    Hints are given as by `typing.get_type_hints` with extras.

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


# ---- arguments are checked where a function is called, before anything runs

PLACED = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)

Thing = TypeVar("Thing", bound=Callable[..., Any])


def checked(thing: Thing) -> Thing:
    """Check all arguments of a function, or all fields of a record, by their hints.

    A function is wrapped and retains name, signature and docstring. A class is returned itself, and
    the arguments of its construction are checked.

    Examples
    --------
    >>> @checked
    ... def half(number: float) -> float:
    ...     return number / 2
    >>> half(3)
    1.5
    >>> half("three")
    Traceback (most recent call last):
    ann_dc.errors.ArgumentTypeError: number: expected a number, got the text 'three'
    """
    if not isinstance(thing, type):
        hints = functools.partial(_hints, thing)
        return typing.cast(Thing, _checking(thing, hints, is_record=False))
    name = "__new__" if issubclass(thing, tuple) else "__init__"
    build = vars(thing)[name]
    is_record = dataclasses.is_dataclass(thing) or issubclass(thing, tuple)
    hints = functools.partial(_hints, thing if is_record else build)
    setattr(thing, name, _checking(build, hints, is_record=is_record))
    return typing.cast(Thing, thing)


def _hints(thing: Any) -> dict[str, Any]:
    return typing.get_type_hints(thing, include_extras=True)


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """Checks to perform at every call of a function.

    Attributes
    ----------
    names : tuple of str
        Names of positional arguments.
    placed : tuple of Check or None
        Checks of these arguments.
    more : Check or None
        Check of further positional arguments, whose name is the last of ``names``.
    rest : Check or None
        Check of keyword arguments with any other name.
    adapters : dict of str to callable
        Conversions of arguments that accept similar types.
    is_record : bool
        True for the construction of a record, in which nothing else runs.
    """

    names: tuple[str, ...]
    placed: tuple[Check | None, ...]
    more: Check | None
    named: dict[str, Check | None]
    rest: Check | None
    adapters: dict[str, Callable[[Any], Any]]
    shapes: dict[str, Shape]
    is_record: bool

    def error_of(self, args: tuple, kwargs: dict[str, Any]) -> ArgumentError | None:
        """Return the error of a call, if any: types before values, values before shapes."""
        found = None
        for name, check, value in zip(self.names, self.placed, args):
            if check is not None and (complaint := check(value)) is not None:
                found = _worse(found, name, complaint)
        for name, value in kwargs.items():
            check = self.named.get(name, self.rest)
            if check is not None and (complaint := check(value)) is not None:
                found = _worse(found, name, complaint)
        if found is not None:
            return found[1].raised_for(found[0])
        return self._further(args, kwargs) if self.more or self.shapes else None

    def _further(self, args: tuple, kwargs: dict[str, Any]) -> ArgumentError | None:
        for value in args[len(self.placed) :] if self.more else ():
            complaint = self.more and self.more(value)
            if complaint is not None:
                return complaint.raised_for(self.names[-1])
        return _misshapen(self.shapes, dict(zip(self.names, args)) | kwargs)


_Found: TypeAlias = tuple[str, Complaint]


def _worse(found: _Found | None, name: str, complaint: Complaint) -> _Found:
    """Return the first complaint; a type complaint precedes a value complaint."""
    if found is None or (
        found[1].error is ArgumentValueError and complaint.error is ArgumentTypeError
    ):
        return name, complaint
    return found


def _misshapen(shapes: Mapping[str, Shape], given: dict[str, Any]) -> ArgumentError | None:
    known: dict[str, int] = {}
    for shape in shapes.values():
        shape.learn(given, known)
    for name, shape in shapes.items():
        value = given.get(name)
        if value is None or not hasattr(value, "shape"):
            continue
        expected = shape.complaint(value, known)
        if expected is not None:
            return ArgumentValueError(f"{name}: expected {expected}, got {given_words(value)}")
    return None


def _checking(
    function: Callable, hints: Callable[[], dict[str, Any]], *, is_record: bool
) -> Callable:
    plan: _Plan | None = None

    @functools.wraps(function)
    def with_checks(*args: Any, **kwargs: Any) -> Any:
        nonlocal plan
        if plan is None:
            plan = _plan(function, hints(), is_record)
        if plan.adapters:
            args, kwargs = _adapted(plan, args, kwargs)
        error = plan.error_of(args, kwargs)
        if error is None:
            if plan.is_record:
                return function(*args, **kwargs)
            with one_thread():
                return function(*args, **kwargs)
        if plan.is_record and isinstance(error, ArgumentValueError):
            _build(function, args, kwargs, error)
        raise error

    return with_checks


def _build(record: Callable, args: tuple, kwargs: dict[str, Any], error: ArgumentError) -> None:
    """Construct a record so that it can raise a more specific error for its values."""
    try:
        record(*args, **kwargs)
    except AnnDcError:
        raise
    except Exception:
        raise error from None


def _plan(function: Callable, hints: dict[str, Any], is_record: bool) -> _Plan:
    parameters = inspect.signature(function).parameters.values()
    hinted = {p.name: _widened(hints.get(p.name, Any), p.default) for p in parameters}
    checks = {name: check_of(hint) for name, hint in hinted.items()}
    by_place = [p.name for p in parameters if p.kind in PLACED]
    of_kind = lambda kind: [checks[p.name] for p in parameters if p.kind is kind]  # noqa: E731
    shapes = {name: _shape(hint) for name, hint in hinted.items()}
    adapters = {name: _adapter(hint) for name, hint in hinted.items()}
    return _Plan(
        names=(*by_place, *(p.name for p in parameters if p.kind is p.VAR_POSITIONAL)),
        placed=tuple(checks[name] for name in by_place),
        more=next(iter(of_kind(inspect.Parameter.VAR_POSITIONAL)), None),
        named=checks,
        rest=next(iter(of_kind(inspect.Parameter.VAR_KEYWORD)), None),
        adapters={name: adapter for name, adapter in adapters.items() if adapter is not None},
        shapes={name: shape for name, shape in shapes.items() if shape is not None},
        is_record=is_record,
    )


def _widened(hint: Any, default: Any) -> Any:
    """Extend a hint by a default of None or nan; replace a missing hint by its type."""
    if hint is Any and type(default) in (int, float):
        return int if type(default) is int else Finite
    if default is None:
        return hint | None if isinstance(hint, type) else typing.Optional[hint]  # noqa: UP045
    if isinstance(default, float) and default != default:
        return typing.Annotated[hint, OrNan()]
    return hint


def _parts(hint: Any) -> tuple[Any, ...]:
    """Return the alternatives of a hint, with their annotations."""
    inside = typing.get_args(hint)
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(part for one in inside for part in _parts(one))
    return (hint,)


def _shape(hint: Any) -> Shape | None:
    marks = (mark for part in _parts(hint) for mark in getattr(part, "__metadata__", ()))
    return next((mark for mark in marks if isinstance(mark, Shape)), None)


# ---- what is taken for something else ----------------------------------------------------------


def _adapted(plan: _Plan, args: tuple, kwargs: dict[str, Any]) -> tuple[tuple, dict[str, Any]]:
    adapters = plan.adapters
    args = tuple(
        adapters[name](value) if name in adapters else value
        for name, value in zip_longest(plan.names[: len(args)], args)
    )
    return args, {n: adapters[n](v) if n in adapters else v for n, v in kwargs.items()}


def _adapter(hint: Any) -> Callable[[Any], Any] | None:
    """Return a conversion: number lists to arrays, lists and iterators to tuples."""
    origins = {typing.get_origin(part) or part for part in map(_bare, _parts(hint))}
    if abc.Iterable in origins:
        return lambda value: tuple(value) if isinstance(value, abc.Iterator) else value
    if origins & {abc.Sequence, abc.Collection, list}:
        return None
    if tuple in origins:
        return lambda value: tuple(value) if type(value) is list else value
    return as_array if np.ndarray in origins else None


def _bare(hint: Any) -> Any:
    annotated = typing.get_origin(hint) is typing.Annotated
    return typing.get_args(hint)[0] if annotated else hint
