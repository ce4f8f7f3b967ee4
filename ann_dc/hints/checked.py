"""Arguments are checked where a function is called, before anything runs.

``@checked`` stands above a function, a method or a record. What its type hints say is then kept: an
argument that is not what its hint says raises an `ArgumentError`, which names the argument, tells
what was expected, what was given and, where it can, what to pass. Hints are read once, at the first
call. Functions that are called in the middle of a run are not checked.

A checked function is an entry to the package, so it runs with one BLAS thread (`one_thread`).
"""

from __future__ import annotations

import collections.abc as abc
import dataclasses
import functools
import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ann_dc.errors import AnnDcError, ArgumentError, ArgumentTypeError, ArgumentValueError
from ann_dc.hints.checks import check_of
from ann_dc.hints.complaints import Check, Complaint
from ann_dc.hints.scalars import as_array
from ann_dc.hints.values import Finite, OrNan, Shape
from ann_dc.hints.words import given_words
from ann_dc.resources import one_thread

PLACED = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)

Thing = TypeVar("Thing", bound=Callable[..., Any])


def checked(thing: Thing) -> Thing:
    """Check all arguments of a function, or all fields of a record, against their type hints.

    Parameters
    ----------
    thing : function or class
        Of a class, what is checked are the arguments of its construction.

    Returns
    -------
    function or class
        With the same name, signature and docstring; of a class, the class itself.

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
    """What there is to do at every call.

    Attributes
    ----------
    names : tuple of str
        Of the arguments that may be given by place.
    placed : tuple of Check or None
        Their checks.
    more : Check or None
        Of further arguments by place, whose name is the last.
    named : dict of str to Check or None
    rest : Check or None
        Of arguments of any other name.
    adapters : dict of str to callable
        Of the arguments of which something like them is taken too.
    shapes : dict of str to Shape
    is_record : bool
        Whether it is one that is built, so that nothing runs.
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
        """What is wrong with a call, if anything: types before values, values before shapes."""
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
    """The first complaint; but one about a type comes before one about a value."""
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
    """Let a record say itself what is wrong with its values, where it knows."""
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
    """A hint takes the default too, None or nan; where there is none, a number's default is it."""
    if hint is Any and type(default) in (int, float):
        return int if type(default) is int else Finite
    if default is None:
        return hint | None if isinstance(hint, type) else typing.Optional[hint]  # noqa: UP045
    if isinstance(default, float) and default != default:
        return typing.Annotated[hint, OrNan()]
    return hint


def _parts(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a hint, with what is annotated to them."""
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
    """Lists of numbers stand for arrays, lists for tuples; what can be read once only is kept."""
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
