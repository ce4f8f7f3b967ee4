"""Boundary data of the cell array: fixed and omitted neurons.

The cells at the boundaries are equal to the others. A fixed neuron is replaced by an input of the
problem: q of cell 0 is q_0, a fixed component of t of the last cell is q_d. An omitted neuron is
not needed at the boundary, such as beta of cell 0. Neither has a state.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedNeuron:
    """Fixed neuron: at one stage, an input replaces the neuron.

    Attributes
    ----------
    stage : int
        Stage from 0 to N - 1.
    """

    neuron: str
    stage: int
    input: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Omitted:
    """Omitted neuron at one stage; readers of the neuron read zero there.

    Attributes
    ----------
    stage : int
        Stage from 0 to N - 1.
    """

    neuron: str
    stage: int
