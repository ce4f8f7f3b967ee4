r"""The error budget: which part of a circuit to pay for.

A deviation d of a parameter moves the settled controls by S d, with S from
`ann_dc.analysis.sensitivity` on the circuit's emulation. Independent errors of standard deviation
sigma add up as variances, cell by cell and part by part,

.. math:: \sigma_u^2 = \sum_p \sigma_p^2 \sum_k S_{p,k}^2 .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.sensitivity import weight_sensitivity
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.circuit.parameters import Parameter
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts.datasheet import TYPICAL, Kind, Tolerances


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """How the settled controls depend on every parameter.

    Attributes
    ----------
    parameters : tuple of Parameter
        Those that move the settled point; capacitors do not.
    slopes : mapping of parameter name to (controls, N) array
        d(control) / d(deviation), as a share of the largest control.
    """

    parameters: tuple[Parameter, ...]
    slopes: dict[str, np.ndarray]

    def shift(self, deviations: Deviations) -> np.ndarray:
        """Linear prediction (controls,) of how the controls move, over the largest control."""
        count = len(next(iter(self.slopes.values())))
        total = np.zeros(count)
        for name, off in deviations.items():
            if name in self.slopes:
                total += self.slopes[name] @ np.broadcast_to(off, self.slopes[name].shape[1])
        return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Item:
    """A line of the budget.

    Attributes
    ----------
    parameter : Parameter
    size : float
        Standard deviation assumed.
    error : float
        Standard deviation of the control that suffers most, over the largest control.
    share : float
        Of the variance of the whole circuit's worst control.
    """

    parameter: Parameter
    size: float
    error: float
    share: float


def sensitivity(emulation: Emulation, x: np.ndarray) -> Sensitivity:
    """Sensitivity of the controls at an equilibrium (n,) of the emulation.

    Raises
    ------
    NetworkError
        If the emulation does not say what a resistor does, as that of transconductors.
    """
    network = emulation.network
    known = tuple(p for p in emulation.circuit.parameters if p.name in emulation.slopes)
    if not any(parameter.kind is Kind.RESISTOR for parameter in known):
        raise NetworkError(
            "sensitivity: known for op amps with resistors; take a macro level or parts by name"
        )
    controls = emulation.outputs
    units = network.user_units(np.ones(network.size))[controls]
    scale = units / np.abs(x[controls] * units).max()
    by_weight = weight_sensitivity(network, x, controls)
    slopes = {
        name: np.sum([scale[:, None] * by_weight[wire] * slope for wire, slope in wires], axis=0)
        for name, wires in emulation.slopes.items()
    }
    return Sensitivity(parameters=known, slopes=slopes)


def budget(found: Sensitivity, tolerances: Tolerances = TYPICAL) -> tuple[Item, ...]:
    """All parameters, those that matter most first.

    Parameters
    ----------
    found : Sensitivity
    tolerances : Tolerances
        Sizes of the errors; kinds of size zero are left out.
    """
    variances = _variances(found, tolerances)
    if not variances:
        return ()
    total = np.sum(list(variances.values()), axis=0)
    worst = int(total.argmax())
    items = [
        Item(
            parameter=p,
            size=getattr(tolerances, p.kind.value),
            error=float(np.sqrt(variances[p.name].max())),
            share=float(variances[p.name][worst] / total[worst]),
        )
        for p in found.parameters
        if p.name in variances
    ]
    return tuple(sorted(items, key=lambda item: -item.error))


def total_error(found: Sensitivity, tolerances: Tolerances = TYPICAL) -> float:
    """Standard deviation of the worst control with all errors at once, over the largest one."""
    variances = _variances(found, tolerances)
    return float(np.sqrt(np.sum(list(variances.values()), axis=0).max())) if variances else 0.0


def _variances(found: Sensitivity, tolerances: Tolerances) -> dict[str, np.ndarray]:
    """Variance (controls,) that each parameter brings, all cells together."""
    sized = [(p, getattr(tolerances, p.kind.value)) for p in found.parameters]
    return {
        p.name: ((size * found.slopes[p.name][:, p.present]) ** 2).sum(axis=1)
        for p, size in sized
        if size > 0
    }
