"""What a hint may say beyond a type: a range of numbers, a shape, that it is not empty.

They stand in ``Annotated`` hints, which a type checker reads as the type itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Range:
    """Numbers of a range, as a hint.

    Attributes
    ----------
    words : str
        What a refusal says was expected.
    low, high : float
        Both belong to the range.
    """

    words: str
    low: float = -math.inf
    high: float = math.inf

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high


class OrNan:
    """That nan is let through: it says that there is none, or is refused further on, by name."""


class Own:
    """That a function refuses what is wrong itself, in its own words."""


class NotEmpty:
    """That what is given holds one thing at least."""


SMALLEST, LARGEST = float(np.nextafter(0.0, 1.0)), float(np.finfo(float).max)

Positive: TypeAlias = Annotated[float, Range(words="a positive number", low=SMALLEST)]
"""Above zero; infinite is positive too."""

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
"""Counts from zero: seeds, stages, places in a list."""


class Shape:
    """The shape of an array, and that none of its numbers is nan.

    Parameters
    ----------
    *sizes : int or str
        A number; or a word that stands for one number, 1 or more, wherever the call has it; or
        where that number is found among the other arguments, such as "network.size". "N+1" is
        one more than N. A first size "..." stands for any further ones before the rest.

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
        """What shape was expected, None where it is that of the ``array``.

        Sizes that are not ``known`` yet become known by the array.
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
        """Look up the sizes that other ``arguments`` tell, into ``known``."""
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
"""A state vector of the call's ``network``."""
