"""Diagonal preconditioner: every neuron moves with its net input only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy import sparse

from ann_dc.network.preconditioners.base import (
    ArrayLayout,
    Factors,
    Preconditioner,
    PreconditionerKind,
    Wires,
)


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Diagonal(Preconditioner):
    """Diagonal preconditioner M = diag(1 / tau), the default of a network."""

    @property
    def kind(self) -> PreconditionerKind:
        """Kind of the preconditioner, `PreconditionerKind.DIAGONAL`."""
        return PreconditionerKind.DIAGONAL

    def check(self, row: ArrayLayout) -> None:
        """Accept every cell array."""

    def apply(self, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
        """Return net inputs (..., P, N) times 1 / tau."""
        return drives * row.rates

    def factors(self, row: ArrayLayout) -> Factors:
        """Return one node per neuron, with its time constant as stiffness."""
        n = len(row.state_rates)
        return Factors(
            spread=sparse.eye_array(n, format="csr"),
            stiffness=sparse.diags_array(1 / row.state_rates, format="csr"),
        )

    def wires(self, row: ArrayLayout) -> Wires:
        """Return an empty set of wires."""
        return Wires(weights=sparse.csr_array((len(row.state_rates), 0)))

    def reach(self, row: ArrayLayout) -> np.ndarray:
        """Return False for all neurons (P,)."""
        return np.zeros(len(row.rates), bool)
