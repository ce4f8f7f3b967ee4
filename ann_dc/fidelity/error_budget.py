r"""Error budget of a circuit: contribution of each part to the control error.

A deviation d of a parameter shifts the settled controls by S d, where S comes from
`ann_dc.analysis.sensitivity` on the emulation of the circuit. Independent errors of standard
deviation sigma add up as variances, over all cells and parts,

.. math:: \sigma_u^2 = \sum_p \sigma_p^2 \sum_k S_{p,k}^2 .
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.sensitivity import weight_sensitivity
from ann_dc.errors import NetworkError
from ann_dc.evaluation.rules import size_of
from ann_dc.hardware.circuit.circuit import Parameter
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts.datasheet import TYPICAL, Kind, Tolerances
from ann_dc.validation import checked


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """Sensitivities of the settled controls to all parameters that shift them.

    Capacitors do not shift the settled point. `slopes` maps parameter names to d(control) /
    d(deviation), shape (controls, N), relative to the largest control; for an offset, per volt.
    """

    parameters: tuple[Parameter, ...]
    slopes: dict[str, np.ndarray]

    def shift(self, deviations: Deviations) -> np.ndarray:
        """Return the linear shift (controls,) of the controls, relative to the largest.

        Deviations are relative for resistors and gains and in volts for offsets, as numbers or
        arrays (N,). Parameters without influence on the settled point are ignored.
        """
        count = len(next(iter(self.slopes.values())))
        total = np.zeros(count)
        for name, off in deviations.items():
            if name in self.slopes:
                total += self.slopes[name] @ np.broadcast_to(off, self.slopes[name].shape[1])
        return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Item:
    """Line of the error budget.

    Attributes
    ----------
    parameter : Parameter
        One part of every cell.
    size : float
        Assumed standard deviation: relative for a resistor or a gain, in volts for an offset. For a
        resistor it is the tolerance divided by the root of three.
    error : float
        Standard deviation of the most affected control, relative to the largest control.
    share : float
        Fraction of the variance of the worst control of the whole circuit.
    """

    parameter: Parameter
    size: float
    error: float
    share: float

    def as_dict(self) -> dict[str, str | float]:
        """Return the line as a dictionary for a JSON file."""
        return {
            "parameter": self.parameter.name,
            "meaning": self.parameter.meaning,
            "size": self.size,
            "unit": self.parameter.kind.unit,
            "error": self.error,
            "share_of_variance": self.share,
        }


@checked
def sensitivity(emulation: Emulation, x: np.ndarray) -> Sensitivity:
    """Compute the sensitivity of the controls at an equilibrium of the emulation.

    `x` (n,) is the settled state of an op-amp circuit, in the units of the emulation's network.
    Raises `NetworkError` if the emulation does not model single resistors, such as that of
    transconductors.

    Examples
    --------
    Compare the linear prediction for a resistor with an error of 0.1 % with the solved circuit:

    >>> import ann_dc, numpy as np
    >>> from ann_dc.fidelity import CircuitInstance, sensitivity
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> found = sensitivity(nominal.emulation, nominal.settled)
    >>> off = {"r_m_x_1": np.full(5, 1e-3)}
    >>> built = CircuitInstance(circuit=circuit, level=level, probe=probe, deviations=off)
    >>> bool(abs(np.abs(found.shift(off)).max() / built.control_error - 1) < 0.1)
    True
    """
    network = emulation.network
    known = tuple(p for p in emulation.circuit.parameters if p.name in emulation.slopes)
    if not any(parameter.kind is Kind.RESISTOR for parameter in known):
        raise NetworkError(
            "sensitivity: available for op amps with resistors; use a macro level or parts by name"
        )
    controls = emulation.outputs
    peaks = emulation.circuit.scaling.peaks
    reach = max((peaks[name].value for name in emulation.output_names), default=0.0)
    share = 1.0 / size_of(x[controls], reach)
    by_weight = weight_sensitivity(network, x, controls)
    slopes = {
        name: np.sum([share * by_weight[wire] * slope for wire, slope in wires], axis=0)
        for name, wires in emulation.slopes.items()
    }
    return Sensitivity(parameters=known, slopes=slopes)


@checked
def budget(found: Sensitivity, tolerances: Tolerances = TYPICAL) -> tuple[Item, ...]:
    """Return the error budget of all parameters, largest fraction of the variance first.

    The fractions of its lines add up to one. Kinds of errors of size zero are omitted.

    Parameters
    ----------
    found : Sensitivity
        Sensitivities of the nominal circuit.
    tolerances : Tolerances
        Sizes of the errors, as drawn. Default: `TYPICAL`.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import CircuitInstance, budget, sensitivity
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> items = budget(sensitivity(nominal.emulation, nominal.settled))
    >>> items[0].parameter.name, items[0].parameter.kind.value
    ('r_m_x_1', 'resistor')
    >>> round(sum(item.share for item in items), 9)
    1.0
    """
    variances = _variances(found, tolerances)
    if not variances:
        return ()
    total = np.sum(list(variances.values()), axis=0)
    worst = int(total.argmax())
    items = [
        Item(
            parameter=p,
            size=tolerances.deviation(p.kind),
            error=float(np.sqrt(variances[p.name].max())),
            share=float(variances[p.name][worst] / total[worst]),
        )
        for p in found.parameters
        if p.name in variances
    ]
    return tuple(sorted(items, key=lambda item: (-item.share, -item.error)))


def shares_by_kind(items: Iterable[Item]) -> dict[Kind, float]:
    """Return the fractions of the variance of the worst control, added up by kind of error."""
    total: dict[Kind, float] = {}
    for item in items:
        total[item.parameter.kind] = total.get(item.parameter.kind, 0.0) + item.share
    return total


def total_error(found: Sensitivity, tolerances: Tolerances = TYPICAL) -> float:
    """Return the standard deviation of the worst control with all errors at once.

    The value is relative to the largest control. The default of ``tolerances`` is `TYPICAL`.

    Examples
    --------
    Errors of half the size cause half the control error:

    >>> import ann_dc
    >>> from ann_dc.fidelity import CircuitInstance, sensitivity, total_error
    >>> from ann_dc.hardware.parts import Tolerances
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> found = sensitivity(nominal.emulation, nominal.settled)
    >>> coarse, fine = (total_error(found, Tolerances(resistor=r)) for r in (0.01, 0.005))
    >>> round(coarse / fine, 9)
    2.0
    """
    variances = _variances(found, tolerances)
    return float(np.sqrt(np.sum(list(variances.values()), axis=0).max())) if variances else 0.0


def _variances(found: Sensitivity, tolerances: Tolerances) -> dict[str, np.ndarray]:
    """Return the variance (controls,) due to each parameter, over all cells."""
    sized = [(p, tolerances.deviation(p.kind)) for p in found.parameters]
    return {
        p.name: ((size * found.slopes[p.name][:, p.present]) ** 2).sum(axis=1)
        for p, size in sized
        if size > 0
    }
