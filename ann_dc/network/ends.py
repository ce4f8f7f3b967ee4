"""The two ends of the row, as data: the cells there are like the others, some neurons are not.

A pinned neuron is an input of the problem: q of cell 0 is q_0, a fixed component of t of the last
cell is q_d. An absent one is what the row is too short for: beta of cell 0. Neither has a state.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class Pin:
    """At one stage a neuron is replaced by an input and holds that input's value there."""

    neuron: str
    stage: int
    input: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Absent:
    """At one stage a neuron is left out; whatever reads it there reads zero."""

    neuron: str
    stage: int
