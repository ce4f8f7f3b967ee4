"""Conversion of arguments before their validation: words to objects, lists to arrays and tuples.

A class declares its words once with `declare_words`, next to their table. Every argument or field
whose hint names the class then accepts a word for it, alone or in a container. Upper and lower
case, hyphens, underscores and spaces are equal.
"""

from __future__ import annotations

import collections.abc as abc
import difflib
import types
import typing
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any, Generic, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")
Table = Mapping[str, Any] | Callable[[], Mapping[str, Any]]

UNIONS = (typing.Union, types.UnionType)
KEPT = "kept as given"
"""Marker in an ``Annotated`` hint of words that the function itself converts."""

_CONTAINERS = (abc.Iterable, abc.Sequence, abc.Collection, tuple, list)


class _Words(NamedTuple):
    table: Table
    make: Callable[[Any], Any]


_WORDS: dict[type, _Words] = {}

if TYPE_CHECKING:

    class OrWord(Generic[T]):
        """Field that is read as an object and given as the object or its word."""

        def __get__(self, record: Any, owner: Any) -> T: ...
        def __set__(self, record: Any, value: T | str) -> None: ...

    def default(value: Any) -> Any:
        """Return the default of an `OrWord` field."""

else:

    class OrWord:
        """Hint of a field that is given as an object or its word; evaluates to the class."""

        def __class_getitem__(cls, kind: type[T]) -> type[T]:
            return kind

    def default(value):
        """Return the default of an `OrWord` field, unchanged."""
        return value


def declare_words(kind: type, table: Table, make: Callable[[Any], Any] = lambda found: found):
    """Declare the words for instances of a class.

    ``table`` maps words to entries, or returns such a mapping at the first use; ``make`` returns
    the instance of an entry.
    """
    _WORDS[kind] = _Words(table, make)


def of_word(kind: type, name: str, word: str, error: type[Exception]) -> Any:
    """Return the instance of a class that a word denotes; ``name`` is that of the argument.

    Raises ``error`` with the closest words and all words if the word is unknown.

    Examples
    --------
    >>> from ann_dc.backends.step_rules import Order
    >>> of_word(Order, "order", "Stage_by_stage", LookupError)
    stage by stage
    """
    table, make = _WORDS[kind]
    words = table() if callable(table) else table
    known = {_plain(one): one for one in words}
    if (found := known.get(_plain(word))) is not None:
        return make(words[found])
    near = [known[one] for one in difflib.get_close_matches(_plain(word), known, n=2)]
    closest = f"closest: {' or '.join(near)}; " if near else ""
    raise error(f"{name}: {word!r} does not exist; {closest}choose one of: {', '.join(words)}")


def _plain(word: str) -> str:
    return word.strip().lower().replace("-", " ").replace("_", " ")


def as_array(value: Any) -> Any:
    """Convert lists of numbers to an array; return other values unchanged."""
    if isinstance(value, (list, tuple)):
        with suppress(ValueError):  # rows of different lengths
            array = np.asarray(value)
            return array if array.dtype.kind in "fiub" else value
    return value


def parts(hint: Any) -> list[tuple[Any, ...]]:
    """Return the alternatives of a hint, each with its markers."""
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in UNIONS:
        return [part for one in inside for part in parts(one)]
    if origin is Annotated:
        return [(*part, *inside[1:]) for part in parts(inside[0])]
    return [(hint,)]


def adapter(name: str, hint: Any, error: type[Exception]) -> Callable[[Any], Any] | None:
    """Return the conversion of an argument: words, number lists to arrays, lists to tuples.

    ``error`` is raised for an unknown word.
    """
    fit, kinds = _container(hint), [kind for kind, *marks in parts(hint) if KEPT not in marks]
    alone = _declared(kinds)
    items = _declared(
        part
        for kind in kinds
        if typing.get_origin(kind) in _CONTAINERS
        for one in typing.get_args(kind)
        for part, *_ in parts(one)
    )
    if alone is None and items is None:
        return fit

    def convert(value: Any) -> Any:
        value = fit(value) if fit else value
        if isinstance(value, str):
            return of_word(alone, name, value, error) if alone else value
        if (
            items
            and isinstance(value, (list, tuple, set))
            and any(isinstance(v, str) for v in value)
        ):
            return tuple(of_word(items, name, v, error) if isinstance(v, str) else v for v in value)
        return value

    return convert


def _declared(kinds: abc.Iterable[Any]) -> type | None:
    return next((kind for kind in kinds if isinstance(kind, type) and kind in _WORDS), None)


def _container(hint: Any) -> Callable[[Any], Any] | None:
    origins = {typing.get_origin(kind) or kind for kind, *_ in parts(hint)}
    if abc.Iterable in origins:
        return lambda value: tuple(value) if isinstance(value, abc.Iterator) else value
    if origins & {abc.Sequence, abc.Collection, list}:
        return None
    if tuple in origins:
        return lambda value: tuple(value) if type(value) is list else value
    return as_array if np.ndarray in origins else None
