"""Time constants alone: every neuron moves with its own drive and no other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy import sparse

from ann_dc.network.preconditioners.base import Factors, Kind, Metric, Row, Wires


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class TimeConstants(Metric):
    """M = diag(1 / tau); what a network has where nothing else is given."""

    @property
    def kind(self) -> Kind:
        """`Kind.TIME_CONSTANTS`."""
        return Kind.TIME_CONSTANTS

    def check(self, row: Row) -> None:
        """It fits every row."""

    def apply(self, row: Row, drives: np.ndarray) -> np.ndarray:
        """Drives (..., P, N) times 1 / tau."""
        return drives * row.rates

    def factors(self, row: Row) -> Factors:
        """One node a neuron, with its time constant as its stiffness."""
        n = len(row.state_rates)
        return Factors(
            spread=sparse.eye_array(n, format="csr"),
            stiffness=sparse.diags_array(1 / row.state_rates, format="csr"),
        )

    def wires(self, row: Row) -> Wires:
        """None."""
        return Wires(weights=sparse.csr_array((len(row.state_rates), 0)))

    def reach(self, row: Row) -> np.ndarray:
        """No neuron (P,)."""
        return np.zeros(len(row.rates), bool)
