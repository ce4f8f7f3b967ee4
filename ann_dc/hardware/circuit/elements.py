"""The elements of a schematic: what one cell is made of, before any volt or ohm is chosen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False)
class Wire:
    """A weighted connection: ``weight`` (N,) times the source, from the cell at ``offset``."""

    source: str
    offset: int
    weight: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Integrator:
    """x' = rate * sum of wires; ``rate`` is (N,), zero where the neuron is pinned or absent."""

    name: str
    wires: tuple[Wire, ...]
    rate: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class PICell:
    """m = mu + rho c, mu' = rate c, c the sum of wires.

    ``dual`` names mu; where it is absent, so is m.
    """

    name: str
    dual: str
    wires: tuple[Wire, ...]
    rate: np.ndarray
    rho: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Adder:
    """The sum of wires."""

    name: str
    wires: tuple[Wire, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Multiplier:
    """a times b."""

    name: str
    a: str
    b: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator:
    """A function generator on x."""

    name: str
    function: str
    x: str


Part = Integrator | PICell | Adder | Multiplier | Generator
Amplifier = Integrator | PICell | Adder
"""Parts with wires into a virtual ground."""
