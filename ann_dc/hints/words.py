"""How a refusal says what was expected and what was given."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Mapping, Set, Sized
from typing import Any, TypeVar

import numpy as np

_Class = TypeVar("_Class", bound=type)

_SUCH_AS: dict[type, str] = {}

LONGEST_TEXT = 40
"""Letters of a given text that a refusal repeats."""


def such_as(example: str) -> Callable[[_Class], _Class]:
    """Say how a user comes by an object of a class; refusals of all others tell it.

    Parameters
    ----------
    example : str
        What a user writes, such as "ann_dc.plants.car()".

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
    """What a refusal calls an object of a class, and how to come by one."""
    if issubclass(kind, enum.Enum):
        return f"one of {', '.join(str(member) for member in kind)}"
    example = f" such as {_SUCH_AS[kind]}" if kind in _SUCH_AS else ""
    return with_article(kind.__name__) + example


def given_words(given: object) -> str:
    """What a refusal says was given.

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
    """What to pass instead, where that can be told from what was given; else nothing.

    Parameters
    ----------
    given : object
        What was refused.
    kind : type
        What was expected.
    fits : callable of object
        Whether something else would be taken.
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
    """A name as one of its kind.

    >>> with_article("Network"), with_article("OdeBackend")
    ('a Network', 'an OdeBackend')
    """
    return f"{'an' if name[:1] in 'AEIOaeio' else 'a'} {name}"


def is_empty(given: object) -> bool:
    """Whether what has a length has none."""
    return isinstance(given, Sized) and len(given) == 0
