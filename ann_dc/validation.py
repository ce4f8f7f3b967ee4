"""Validation of arguments against type hints when a function is called.

The decorator ``@checked`` applies to a function, a method or a record. An argument that does not
match its hint raises an `ArgumentError`, which names the argument, the expected and the given value
and, if possible, a remedy. A checked function is an entry point of the package and therefore runs
with one BLAS thread (`one_thread`); functions called in the middle of a run are not checked.

Hints are read once, at the first call. Every integer is accepted as a float, a bool is not a
number, and nan is rejected unless the hint or the default allows it. Markers in ``Annotated`` hints
state a range, a shape or non-emptiness; a type checker ignores them. beartype 0.23 tests only one
random item of a container, and its messages give neither place nor remedy.
"""

from __future__ import annotations

import collections.abc as abc
import inspect
import math
import numbers
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass, is_dataclass
from functools import partial, wraps
from itertools import chain, count, repeat
from operator import attrgetter
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from ann_dc.conversion import UNIONS, adapter, as_array, parts
from ann_dc.errors import (
    AnnDcError,
    ArgumentError,
    ArgumentTypeError,
    ArgumentValueError,
    UnknownNameError,
    class_words,
    given_words,
)
from ann_dc.resources import one_thread

Thing = TypeVar("Thing", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class Range:
    """Range of numbers from ``low`` to ``high``; error messages describe it by ``words``."""

    words: str
    low: float = -math.inf
    high: float = math.inf

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high


class OrNan:
    """Marker that accepts nan: a missing value, or rejected later by name."""


class Own:
    """Marker that leaves the validation of an argument to the function."""


class NotEmpty:
    """Marker that requires at least one element."""


class Shape:
    """Shape of an array that does not contain nan.

    Parameters
    ----------
    *sizes : int or str
        A number, or a name that represents one number, 1 or more, throughout the call. A name such
        as "network.size" refers to another argument. "N+1" is one more than N. A first size "..."
        represents any further dimensions before the others.
    """

    def __init__(self, *sizes: int | str) -> None:
        self.sizes, self.is_open = sizes, sizes[:1] == ("...",)
        parts = [str(size).partition("+") for size in sizes[self.is_open :]]
        self.words = [(word, int(more or 0)) for word, _, more in parts]

    def __repr__(self) -> str:
        return f"Shape{self.sizes!r}"

    def complaint(self, array: Any, known: dict[str, int]) -> str | None:
        """Return the expected shape if ``array`` has another; the array adds to ``known`` sizes."""
        own = array.shape[-len(self.words) :] if self.is_open else array.shape
        if len(own) == len(self.words) and all(
            given == more + (int(w) if w.isdigit() else known.setdefault(w, max(given - more, 1)))
            for given, (w, more) in zip(own, self.words)
        ):
            return None
        sizes = [known[word] + more if word in known else None for word, more in self.words]
        text = self._text([None] * len(sizes))
        return f"an array of shape {text}" + (f" = {self._text(sizes)}" if any(sizes) else "")

    def _text(self, known: list[int | None]) -> str:
        sizes = [str(n or size) for n, size in zip([None] * self.is_open + known, self.sizes)]
        return f"({', '.join(sizes)}{',' * (len(sizes) == 1)})"


_SMALLEST, _LARGEST = float(np.nextafter(0.0, 1.0)), float(np.finfo(float).max)

Positive: TypeAlias = Annotated[float, Range(words="a positive number", low=_SMALLEST)]
"""Number above zero; infinity is positive too."""

PositiveFinite: TypeAlias = Annotated[
    float, Range(words="a positive finite number", low=_SMALLEST, high=_LARGEST)
]
NotNegative: TypeAlias = Annotated[float, Range(words="zero or a positive number", low=0.0)]
Finite: TypeAlias = Annotated[float, Range(words="a finite number", low=-_LARGEST, high=_LARGEST)]
Share: TypeAlias = Annotated[
    float, Range(words="a number above 0, 1 at most", low=_SMALLEST, high=1.0)
]
FloatOrNan: TypeAlias = Annotated[float, OrNan()]
Count: TypeAlias = Annotated[int, Range(words="a whole number, 1 or more", low=1)]
Index: TypeAlias = Annotated[int, Range(words="a whole number, 0 or more", low=0)]
"""Count from zero: seeds, stages, positions in a list."""

State: TypeAlias = Annotated[np.ndarray, Shape("network.size")]
"""State vector of the ``network`` argument of the call."""


class _Complaint(NamedTuple):
    """Fault of a value: ``where`` is a place inside the argument, ``wanted`` a missed class."""

    expected: str
    given: Any
    error: type[ArgumentError] = ArgumentTypeError
    where: str = ""
    wanted: type | None = None

    def raised_for(self, name: str) -> ArgumentError:
        """Return the error for an argument called ``name``."""
        words = f"expected {self.expected}, got {given_words(self.given)}"
        remedy = _remedy(self.given, self.wanted) if self.wanted else ""
        return self.error(f"{name}{self.where}: {words}{remedy}")


Check: TypeAlias = Callable[[Any], _Complaint | None]
"""Function that returns the complaint about a value, or None if it is valid."""


def _remedy(given: Any, kind: Any) -> str:
    if isinstance(given, type):
        names = [name for name in vars(kind) if not name.startswith("_")]
        makes = all(hasattr(given, name) for name in names) and getattr(kind, "_is_protocol", False)
        return f"; make one: {given.__name__}(...)" if makes or kind in given.__mro__ else ""
    if inspect.isroutine(given):
        made = getattr(given, "__annotations__", {}).get("return")
        return f"; call it: {given.__name__}(...)" if made in (kind, kind.__name__) else ""
    fits = _class_check(kind)
    for name, value in getattr(given, "__dict__", {}).items():
        if not name.startswith("_") and value is not None and fits(value) is None:
            return f"; pass its .{name}"
    return ""


# ---- checks of values


def _unless(
    fits: Callable[[Any], Any], expected: str, error: Any = ArgumentTypeError, wanted: Any = None
) -> Check:
    return lambda value: None if fits(value) else _Complaint(expected, value, error, "", wanted)


_value_unless = partial(_unless, error=ArgumentValueError)


def _in_turn(first: Check | None, second: Check) -> Check:
    return second if first is None else lambda value: first(value) or second(value)


def _class_check(kind: type) -> Check:
    """Return the check of a class: by members for a protocol, else by `isinstance`."""
    words = class_words(kind)
    kinds = [one for one in kind.__mro__ if getattr(one, "_is_protocol", False)]
    if kind not in kinds:
        return _unless(lambda value: isinstance(value, kind), words, wanted=kind)
    names = {n for one in kinds for n in (*vars(one), *one.__annotations__)}
    members = [name for name in names if not name.startswith("_") or name == "__call__"]

    def fits(value: Any) -> bool:  # class properties are not evaluated
        own = getattr(value, "__dict__", ())
        has_all = all(hasattr(type(value), name) or name in own for name in members)
        return has_all and not isinstance(value, type)

    return _unless(fits, words, wanted=kind)


def _is_array(value: Any, kinds: str) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in kinds


def _number_check(kind: type, tower: type, expected: str) -> Check:
    is_of = lambda value: isinstance(value, tower) and type(value) is not bool  # noqa: E731
    return _unless(lambda value: type(value) is kind or is_of(value), expected)


def _float(value: Any) -> _Complaint | None:
    return None if type(value) is float and value == value else _NUMBER(value) or _NOT_NAN(value)


_NUMBER = _number_check(float, numbers.Real, "a number")
_NOT_NAN = _value_unless(lambda value: value == value, "a number")
_NO_NAN = _value_unless(
    lambda value: not (_is_array(value, "fc") and np.isnan(value).any()),
    "numbers, none of them nan",
)
_FILLED = _value_unless(
    lambda value: not isinstance(value, abc.Sized) or len(value), "one at least"
)
_SIMPLE: dict[Any, Check] = {
    type(None): _unless(lambda value: value is None, "None"),
    float: _float,
    int: _number_check(int, numbers.Integral, "a whole number"),
    complex: _number_check(complex, numbers.Complex, "a number"),
    bool: _unless(lambda value: isinstance(value, (bool, np.bool_)), "True or False"),
    str: _unless(lambda value: isinstance(value, str), "text"),
    np.ndarray: _unless(
        lambda value: _is_array(as_array(value), "fiubc"), "a NumPy array of numbers"
    ),
    abc.Callable: _unless(
        lambda value: callable(value) and not isinstance(value, type), "a function"
    ),
}


def check_of(hint: Any) -> Check | None:
    """Return the check of a hint from `typing.get_type_hints`; None if it accepts any value."""
    if hint in (Any, object):
        return None
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in _GENERICS:
        return _GENERICS[origin](inside or (Any, ...))
    kind = origin or hint
    return (_SIMPLE.get(kind) or _class_check(kind)) if isinstance(kind, type) else None


def _union(inside: tuple) -> Check | None:
    or_none = type(None) in inside
    checks = [check_of(part) for part in inside if part is not type(None)]
    alternatives = [check for check in checks if check is not None]

    def check(value: Any) -> _Complaint | None:
        if value is None and or_none:
            return None
        complaints = []
        for one in alternatives:
            if (complaint := one(value)) is None:
                return None
            complaints.append(complaint)
        exact = [c for c in complaints if c.where or c.error is ArgumentValueError]
        words = " or ".join(dict.fromkeys(c.expected for c in complaints))
        wanted = next((c.wanted for c in complaints if c.wanted), None)
        return exact[0] if exact else _Complaint(words, value, wanted=wanted)

    return check if len(alternatives) == len(checks) else None


def _literal(allowed: tuple) -> Check:
    kinds = [(type(one), one) for one in allowed]
    words = f"one of {', '.join(map(repr, allowed))}"
    return _value_unless(lambda value: (type(value), value) in kinds, words)


def _subclass(inside: tuple) -> Check:
    kind = object if inside[0] is Any else typing.get_origin(inside[0]) or inside[0]
    words = f"a subclass of {kind.__name__}"
    return _unless(lambda value: isinstance(value, type) and issubclass(value, kind), words)


def _first(places: Iterable, checks: Iterable, values: Iterable) -> _Complaint | None:
    for place, check, value in zip(places, checks, values):
        if check is not None and (complaint := check(value)) is not None:
            return complaint._replace(where=f"[{place}]{complaint.where}")
    return None


def _items(kind: Any, words: str, inside: tuple) -> Check:
    item = check_of(inside[0])
    name = inside[0].__name__ if item and isinstance(inside[0], type) else ""
    expected = f"{words} of {name}" if name[:1].isupper() else words

    def check(value: Any) -> _Complaint | None:
        is_scalar = isinstance(value, (str, bytes, abc.Mapping)) or getattr(value, "ndim", 1) == 0
        if is_scalar or not isinstance(value, kind):
            return _Complaint(expected, value)
        if item is None or isinstance(value, abc.Iterator):
            return None
        return _first(count(), repeat(item), value)

    return check


def _tuple_of(inside: tuple) -> Check:
    if inside[1:] == (Ellipsis,):
        return _items((tuple, list), "a tuple", inside)
    items = [check_of(part) for part in inside]
    is_tuple = _unless(
        lambda value: isinstance(value, (tuple, list)) and len(value) == len(items),
        f"a tuple of {len(items)}",
    )
    return lambda value: is_tuple(value) or _first(count(), items, value)


def _mapping_of(inside: tuple) -> Check:
    keys, values = map(check_of, inside)

    def check(value: Any) -> _Complaint | None:
        if not isinstance(value, abc.Mapping):
            return _Complaint('a mapping such as {"name": value}', value)
        key = _first(value, repeat(keys), value)
        if key is not None:
            return key._replace(expected=f"{key.expected} for a key", where="")
        return _first(value, repeat(values), value.values())

    return check


def _annotated(inside: tuple) -> Check | None:
    hint, *marks = inside
    kinds = [type(mark) for mark in marks]
    if Own in kinds:
        return None
    check = _NUMBER if hint is float and OrNan in kinds else check_of(hint)
    for mark in marks:
        if isinstance(mark, Range):
            check = _in_turn(check, _value_unless(mark.__contains__, mark.words))
        elif isinstance(mark, NotEmpty):
            check = _in_turn(check, _FILLED)
        elif isinstance(mark, Shape) and OrNan not in kinds:
            check = _in_turn(check, _NO_NAN)
    return check


_GENERICS: dict[Any, Callable[[tuple], Check | None]] = {
    **dict.fromkeys(UNIONS, _union),
    Annotated: _annotated,
    typing.Literal: _literal,
    type: _subclass,
    tuple: _tuple_of,
    list: partial(_items, list, "a list"),
    **dict.fromkeys((set, frozenset, abc.Set), partial(_items, abc.Set, "a set")),
    abc.Sequence: partial(_items, (abc.Sequence, np.ndarray), "a sequence"),
    abc.Collection: partial(_items, abc.Collection, "a collection"),
    abc.Iterable: partial(_items, abc.Iterable, "a sequence"),
    **dict.fromkeys((dict, abc.Mapping), _mapping_of),
}

# ---- checks of calls


def checked(thing: Thing) -> Thing:
    """Check all arguments of a function, or all fields of a record, by their hints.

    A function is wrapped and retains name, signature and docstring. A class is returned itself, and
    the arguments of its construction are checked.

    Examples
    --------
    >>> @checked
    ... def half(number: float) -> float:
    ...     return number / 2
    >>> half("three")
    Traceback (most recent call last):
    ann_dc.errors.ArgumentTypeError: number: expected a number, got the text 'three'
    """
    if not isinstance(thing, type):
        return typing.cast(Thing, _checking(thing, thing, is_record=False))
    is_tuple = issubclass(thing, tuple)
    name, is_record = "__new__" if is_tuple else "__init__", is_tuple or is_dataclass(thing)
    build = vars(thing)[name]
    setattr(thing, name, _checking(build, thing if is_record else build, is_record=is_record))
    return typing.cast(Thing, thing)


def _checking(function: Callable, hinted: Any, *, is_record: bool) -> Callable:
    plan: _Plan | None = None

    @wraps(function)
    def with_checks(*args: Any, **kwargs: Any) -> Any:
        nonlocal plan
        plan = plan or _Plan(function, typing.get_type_hints(hinted, include_extras=True))
        args = plan.adapted(args, kwargs) if plan.adapters else args
        error = plan.error_of(args, kwargs)
        if error is None and is_record:  # nothing else runs in its construction
            return function(*args, **kwargs)
        if error is None:
            with one_thread():
                return function(*args, **kwargs)
        if is_record and isinstance(error, ArgumentValueError):
            try:  # a record may raise a more specific error for its values
                function(*args, **kwargs)
            except AnnDcError:
                raise
            except Exception:
                raise error from None
        raise error

    return with_checks


class _Plan:
    """Checks of the arguments of a function, read from its hints."""

    def __init__(self, function: Callable, hints: dict[str, Any]) -> None:
        parameters = inspect.signature(function).parameters.values()
        hinted = {p.name: _widened(hints.get(p.name, Any), p.default) for p in parameters}
        self.names = [p.name for p in parameters if p.kind <= p.POSITIONAL_OR_KEYWORD]
        self.more = [repeat(p.name) for p in parameters if p.kind is p.VAR_POSITIONAL]
        self.checks = {name: check_of(hint) for name, hint in hinted.items()}
        self.rest = next((self.checks[p.name] for p in parameters if p.kind is p.VAR_KEYWORD), None)
        self.adapters = {
            n: fit for n, hint in hinted.items() if (fit := adapter(n, hint, UnknownNameError))
        }
        self.places = [
            (i, self.adapters[n]) for i, n in enumerate(self.names) if n in self.adapters
        ]
        marks = [(n, m) for n, hint in hinted.items() for _, *marks in parts(hint) for m in marks]
        self.shapes = {name: mark for name, mark in marks if isinstance(mark, Shape)}
        words = {word for shape in self.shapes.values() for word, _ in shape.words if "." in word}
        self.references = [(w, w.split(".")[0], attrgetter(w.split(".", 1)[1])) for w in words]

    def adapted(self, args: tuple, kwargs: dict[str, Any]) -> tuple:
        """Convert positional arguments, and keyword arguments in place."""
        for name, value in kwargs.items():
            if (fit := self.adapters.get(name)) is not None:
                kwargs[name] = fit(value)
        if not self.places:
            return args
        found = list(args)
        for place, fit in self.places:
            if place < len(found):
                found[place] = fit(found[place])
        return tuple(found)

    def error_of(self, args: tuple, kwargs: dict[str, Any]) -> ArgumentError | None:
        """Return the error of a call, if any: types before values, values before shapes."""
        names = chain(self.names, *self.more) if self.more else self.names
        placed, named = self._fault(zip(names, args)), self._fault(kwargs.items())
        if placed is None or (named and named[1].error is ArgumentTypeError is not placed[1].error):
            placed = named
        if placed is not None:
            return placed[1].raised_for(placed[0])
        return self._misshapen(dict(zip(self.names, args)) | kwargs) if self.shapes else None

    def _fault(self, given: Iterable[tuple[str, Any]]) -> tuple[str, _Complaint] | None:
        found = None
        for name, value in given:
            check = self.checks.get(name, self.rest)
            if check is not None and (complaint := check(value)) is not None:
                if complaint.error is ArgumentTypeError:
                    return name, complaint
                found = found or (name, complaint)
        return found

    def _misshapen(self, given: dict[str, Any]) -> ArgumentError | None:
        known = {word: int(get(given[n])) for word, n, get in self.references if n in given}
        for name, shape in self.shapes.items():
            value = given.get(name)
            if hasattr(value, "shape") and (expected := shape.complaint(value, known)):
                return ArgumentValueError(f"{name}: expected {expected}, got {given_words(value)}")
        return None


def _widened(hint: Any, default: Any) -> Any:
    """Extend a hint by a default of None or nan; replace a missing hint by its type."""
    if hint is Any and type(default) in (int, float):
        return int if type(default) is int else Finite
    if default is None:
        return hint | None if isinstance(hint, type) else typing.Optional[hint]  # noqa: UP045
    if isinstance(default, float) and default != default:
        return Annotated[hint, OrNan()]
    return hint
