"""Constraints in type hints beyond a type: number ranges, shapes, non-emptiness.

They are used in ``Annotated`` hints, which a type checker reads as the type itself.
"""

from __future__ import annotations

import collections.abc as abc
import enum
import inspect
import math
import numbers
import types
from collections.abc import Callable, Mapping, Set, Sized
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias, TypeVar

import numpy as np

from ann_dc.errors import ArgumentError, ArgumentTypeError, ArgumentValueError

# ---- how a refusal says what was expected and what was given

_Class = TypeVar("_Class", bound=type)

_SUCH_AS: dict[type, str] = {}

LONGEST_TEXT = 40
"""Largest number of characters of a given text that an error message repeats."""


def such_as(example: str) -> Callable[[_Class], _Class]:
    """Declare an example expression for a class, such as "ann_dc.plants.car()".

    Error messages that expect an object of the class show the example.

    Examples
    --------
    >>> @such_as("Cat()")
    ... class Cat:
    ...     pass
    >>> class_words(Cat)
    'a Cat such as Cat()'
    """

    def keep(kind: _Class) -> _Class:
        _SUCH_AS[kind] = example
        return kind

    return keep


def class_words(kind: type) -> str:
    """Return the description of a class instance in messages, with its example."""
    if issubclass(kind, enum.Enum):
        return f"one of {', '.join(str(member) for member in kind)}"
    example = f" such as {_SUCH_AS[kind]}" if kind in _SUCH_AS else ""
    return with_article(kind.__name__) + example


def given_words(given: object) -> str:
    """Return the description of a given value in error messages.

    Examples
    --------
    >>> given_words("ode"), given_words([]), given_words(np.zeros((2, 3))), given_words(len)
    ("the text 'ode'", 'an empty list', 'an array of shape (2, 3)', 'the function len')
    """
    if given is None or isinstance(given, (bool, int, float, complex, np.generic, enum.Enum)):
        return repr(given)
    if isinstance(given, (str, bytes)):
        text = repr(given[:LONGEST_TEXT]) + ("..." if len(given) > LONGEST_TEXT else "")
        return f"{'the text' if isinstance(given, str) else 'the bytes'} {text}"
    if isinstance(given, type):
        return f"the class {given.__name__}"
    if inspect.isroutine(given):
        return f"the function {getattr(given, '__name__', given)}"
    if isinstance(given, np.ndarray):
        kind = "an array" if given.dtype.kind in "fiu" else f"an array of {given.dtype}"
        return f"{kind} of shape {given.shape}"
    name = with_article(type(given).__name__)
    if isinstance(given, (list, tuple, Mapping, Set)) and type(given).__module__ == "builtins":
        return f"an empty {type(given).__name__}" if not given else f"{name} of {len(given)}"
    return name


def way_out(given: object, kind: type, fits: Callable[[Any], bool]) -> str:
    """Return a suggestion for a rejected value, or an empty text.

    `kind` is the expected class, and `fits` decides if another value would be accepted.
    """
    if isinstance(given, type):
        return f"; make one: {given.__name__}(...)" if _makes(given, kind) else ""
    if inspect.isroutine(given):
        made = getattr(given, "__annotations__", {}).get("return")
        called = made in (kind, kind.__name__)
        return f"; call it: {given.__name__}(...)" if called else ""
    for name, value in getattr(given, "__dict__", {}).items():
        if not name.startswith("_") and value is not None and fits(value):
            return f"; pass its .{name}"
    return ""


def _makes(given: type, kind: type) -> bool:
    try:
        return issubclass(given, kind)
    except TypeError:  # a protocol with more than methods
        return all(hasattr(given, name) for name in vars(kind) if not name.startswith("_"))


def with_article(name: str) -> str:
    """Return a name with its indefinite article.

    >>> with_article("Network"), with_article("OdeBackend")
    ('a Network', 'an OdeBackend')
    """
    return f"{'an' if name[:1] in 'AEIOaeio' else 'a'} {name}"


def is_empty(given: object) -> bool:
    """Return True if an object with a length is empty."""
    return isinstance(given, Sized) and len(given) == 0


# ---- what is wrong with a value, and the error that says it: what was expected, given, and to pa


@dataclass(frozen=True, kw_only=True)
class Complaint:
    """Fault of a value.

    Attributes
    ----------
    expected : str
        Description of the expected value.
    where : str
        Place inside the argument, such as "[2]"; empty for the argument itself.
    error : type of ArgumentError
        Type of the error to raise.
    wanted : type or None
        Expected class, if any.
    """

    expected: str
    given: object
    where: str = ""
    error: type[ArgumentError] = ArgumentTypeError
    wanted: type | None = None

    def raised_for(self, name: str) -> ArgumentError:
        """Return the error for an argument called ``name``."""
        hint, kind = "", self.wanted
        if kind is not None:
            fits = class_check(kind)
            hint = way_out(self.given, kind, lambda one: fits(one) is None)
        return self.error(
            f"{name}{self.where}: expected {self.expected}, got {given_words(self.given)}{hint}"
        )


Check: TypeAlias = Callable[[Any], Complaint | None]
"""Function that returns the complaint about a value, or None if it is valid."""


def class_check(kind: type) -> Check:
    """Return the check of a class: by members for a protocol, else by `isinstance`."""
    if kind in (abc.Callable, types.FunctionType):
        return callable_check
    protocol = getattr(kind, "_is_protocol", False)
    members = _members(kind) if protocol else ()

    def check(value: Any) -> Complaint | None:
        fits = all(_has(value, m) for m in members) if protocol else isinstance(value, kind)
        if fits and not (protocol and isinstance(value, type)):
            return None
        return Complaint(expected=class_words(kind), given=value, wanted=kind)

    return check


def _members(protocol: type) -> tuple[str, ...]:
    """Return the names that a protocol requires."""
    kinds = [kind for kind in protocol.__mro__ if getattr(kind, "_is_protocol", False)]
    names = {n for kind in kinds for n in (*vars(kind), *getattr(kind, "__annotations__", {}))}
    asked = {name for name in names if not name.startswith("_") or name == "__call__"}
    return tuple(sorted(asked - {"__init__"}))


def _has(value: Any, name: str) -> bool:
    """Return True if an object has an attribute, without evaluating class properties."""
    return hasattr(type(value), name) or name in getattr(value, "__dict__", ())


def callable_check(value: Any) -> Complaint | None:
    """Check that ``value`` is callable and not a class."""
    if callable(value) and not isinstance(value, type):
        return None
    return Complaint(expected="a function", given=value)


# ---- the checks of single numbers, texts and arrays


def _none(value: Any) -> Complaint | None:
    return None if value is None else Complaint(expected="None", given=value)


def float_check(value: Any) -> Complaint | None:
    """Check that ``value`` is a number other than nan."""
    if number_check(value) is not None:
        return Complaint(expected="a number", given=value)
    if value != value:
        return Complaint(expected="a number", given=value, error=ArgumentValueError)
    return None


def number_check(value: Any) -> Complaint | None:
    """Check that ``value`` is a real number, possibly nan, and not a bool."""
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
    """Convert lists of numbers to an array; return other values unchanged."""
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
"""Checks by the type hint of a scalar or an array."""


# ---- what a hint may say beyond a type: a range of numbers, a shape, that it is not empty


@dataclass(frozen=True, kw_only=True)
class Range:
    """Range of numbers, as a hint.

    The limits `low` and `high` belong to the range; `words` is the expected value in error
    messages.
    """

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


SMALLEST, LARGEST = float(np.nextafter(0.0, 1.0)), float(np.finfo(float).max)

Positive: TypeAlias = Annotated[float, Range(words="a positive number", low=SMALLEST)]
"""Number above zero; infinity is positive too."""

PositiveFinite: TypeAlias = Annotated[
    float, Range(words="a positive finite number", low=SMALLEST, high=LARGEST)
]
NotNegative: TypeAlias = Annotated[float, Range(words="zero or a positive number", low=0.0)]
Finite: TypeAlias = Annotated[float, Range(words="a finite number", low=-LARGEST, high=LARGEST)]
Share: TypeAlias = Annotated[
    float, Range(words="a number above 0, 1 at most", low=SMALLEST, high=1.0)
]
FloatOrNan: TypeAlias = Annotated[float, OrNan()]
Count: TypeAlias = Annotated[int, Range(words="a whole number, 1 or more", low=1)]
Index: TypeAlias = Annotated[int, Range(words="a whole number, 0 or more", low=0)]
"""Count from zero: seeds, stages, positions in a list."""


class Shape:
    """Shape of an array that does not contain nan.

    Parameters
    ----------
    *sizes : int or str
        A number, or a name that represents one number, 1 or more, throughout the call. A name such
        as "network.size" refers to another argument. "N+1" is one more than N. A first size "..."
        represents any further dimensions before the others.

    Examples
    --------
    >>> Shape("n", "N+1").complaint(np.zeros((2, 6)), {"n": 2, "N": 5}) is None
    True
    >>> Shape("network.size").complaint(np.zeros(3), {"network.size": 39})
    'an array of shape (network.size,) = (39,)'
    """

    def __init__(self, *sizes: int | str) -> None:
        self.batched = sizes[:1] == ("...",)
        self.sizes = sizes[1:] if self.batched else sizes

    def __repr__(self) -> str:
        return f"Shape{(*(['...'] if self.batched else []), *self.sizes)!r}"

    def complaint(self, array: Any, known: dict[str, int]) -> str | None:
        """Return the expected shape, or None if the ``array`` has it.

        Sizes that are not yet ``known`` are defined by the array.
        """
        shape = tuple(array.shape)
        own = shape[len(shape) - len(self.sizes) :] if self.batched else shape
        if len(own) != len(self.sizes):
            return f"an array of shape {self._text(known)}"
        for size, given in zip(self.sizes, own):
            if isinstance(size, str):
                word, _, more = size.partition("+")
                size = known.setdefault(word, max(given - int(more or 0), 1)) + int(more or 0)
            if size != given:
                return f"an array of shape {self._text(known)}"
        return None

    def _text(self, known: dict[str, int]) -> str:
        words = [str(size) for size in self.sizes]
        numbers = [_size(word, known) for word in words]
        before = ["..."] if self.batched else []
        text = _tuple([*before, *words])
        return text if numbers == words else f"{text} = {_tuple([*before, *numbers])}"

    def learn(self, arguments: Mapping[str, Any], known: dict[str, int]) -> None:
        """Add the sizes defined by other ``arguments`` to ``known``."""
        for size in self.sizes:
            word = str(size).partition("+")[0]
            first, *rest = word.split(".")
            if rest and word not in known and first in arguments:
                value = arguments[first]
                for attribute in rest:
                    value = getattr(value, attribute)
                known[word] = int(value)


def _size(word: str, known: Mapping[str, int]) -> str:
    name, _, more = word.partition("+")
    return str(known[name] + int(more or 0)) if name in known else word


def _tuple(words: list[str]) -> str:
    return f"({', '.join(words)}{',' if len(words) == 1 else ''})"


State: TypeAlias = Annotated[np.ndarray, Shape("network.size")]
"""State vector of the ``network`` argument of the call."""
