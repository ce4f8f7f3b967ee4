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
from ann_dc.evaluation.rules import size_of
from ann_dc.hardware.circuit.circuit import Parameter
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts.datasheet import TYPICAL, Kind, Tolerances
from ann_dc.validation.checked import checked


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """How the settled controls depend on every parameter.

    Attributes
    ----------
    parameters : tuple of Parameter
        Those that move the settled point; capacitors do not.
    slopes : mapping of parameter name to (controls, N) array
        d(control) / d(deviation), as a share of the largest control; of an offset, per volt.
    """

    parameters: tuple[Parameter, ...]
    slopes: dict[str, np.ndarray]

    def shift(self, deviations: Deviations) -> np.ndarray:
        """Linear prediction (controls,) of how the controls move, over the largest control.

        Parameters
        ----------
        deviations : mapping of parameter name to number or (N,) array
            Shares of resistors and gains, volts of offsets; what moves nothing is left out.
        """
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
        One part of every cell.
    size : float
        Standard deviation assumed: a share of a resistor or a gain, volts of an offset. That of a
        resistor is its tolerance over the root of three.
    error : float
        Standard deviation of the control that suffers most, over the largest control.
    share : float
        Of the variance of the whole circuit's worst control.
    """

    parameter: Parameter
    size: float
    error: float
    share: float

    def as_dict(self) -> dict[str, str | float]:
        """For a JSON file."""
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
    """Sensitivity of the controls at an equilibrium of the emulation.

    Parameters
    ----------
    emulation : Emulation
        Of a circuit of op amps.
    x : (n,) array
        Settled state of the emulation, in its network's units.

    Returns
    -------
    Sensitivity

    Raises
    ------
    NetworkError
        If the emulation does not say what a resistor does, as that of transconductors.

    Examples
    --------
    The linear prediction of a resistor that is 0.1 % off, beside the circuit solved with it:

    >>> import numpy as np
    >>> from ann_dc.fidelity import Specimen, sensitivity
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = Specimen(circuit=circuit, level=level, probe=probe)
    >>> found = sensitivity(nominal.emulation, nominal.settled)
    >>> off = {"r_m_x_1": np.full(5, 1e-3)}
    >>> built = Specimen(circuit=circuit, level=level, probe=probe, deviations=off)
    >>> bool(abs(np.abs(found.shift(off)).max() / built.control_error - 1) < 0.1)
    True
    """
    network = emulation.network
    known = tuple(p for p in emulation.circuit.parameters if p.name in emulation.slopes)
    if not any(parameter.kind is Kind.RESISTOR for parameter in known):
        raise NetworkError(
            "sensitivity: known for op amps with resistors; take a macro level or parts by name"
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
    """All parameters, those that matter most first.

    Parameters
    ----------
    found : Sensitivity
        Of the nominal circuit.
    tolerances : Tolerances
        Sizes of the errors, as they are drawn; kinds of size zero are left out.

    Returns
    -------
    tuple of Item
        Their shares add up to one.

    Examples
    --------
    >>> from ann_dc.fidelity import Specimen, budget, sensitivity
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = Specimen(circuit=circuit, level=level, probe=probe)
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
    return tuple(sorted(items, key=lambda item: -item.error))


def total_error(found: Sensitivity, tolerances: Tolerances = TYPICAL) -> float:
    """Standard deviation of the worst control with all errors at once, over the largest one.

    Parameters
    ----------
    found : Sensitivity
        Of the nominal circuit.
    tolerances : Tolerances
        Sizes of the errors.

    Examples
    --------
    Errors of half the size do half the harm:

    >>> from ann_dc.fidelity import Specimen, sensitivity, total_error
    >>> from ann_dc.hardware.parts import Tolerances
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = Specimen(circuit=circuit, level=level, probe=probe)
    >>> found = sensitivity(nominal.emulation, nominal.settled)
    >>> coarse, fine = (total_error(found, Tolerances(resistor=r)) for r in (0.01, 0.005))
    >>> round(coarse / fine, 9)
    2.0
    """
    variances = _variances(found, tolerances)
    return float(np.sqrt(np.sum(list(variances.values()), axis=0).max())) if variances else 0.0


def _variances(found: Sensitivity, tolerances: Tolerances) -> dict[str, np.ndarray]:
    """Variance (controls,) that each parameter brings, all cells together."""
    sized = [(p, tolerances.deviation(p.kind)) for p in found.parameters]
    return {
        p.name: ((size * found.slopes[p.name][:, p.present]) ** 2).sum(axis=1)
        for p, size in sized
        if size > 0
    }
