"""TODO: the idea."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class Pin:
    """At one stage a neuron is replaced by an input: q of cell 0 by q_0, t of the last by q_d."""

    neuron: str
    stage: int
    input: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Absent:
    """At one stage a neuron is left out (beta of cell 0); it reads as zero."""

    neuron: str
    stage: int
