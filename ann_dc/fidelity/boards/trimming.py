r"""Trimming: which offsets and gains to set by hand, in which order, until a spec is met.

Deviations d of single parts move the settled controls by e = e_0 + S d, with S from the error
budget and e_0 what finite gains cost. The part whose error makes most of the variance of the worst
control is trimmed first, cell by cell; what remains is the largest |e| that a share of drawn
circuits stays below. The same circuits are then emulated with and without their trims.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.readings import Reading, misread, reading_of
from ann_dc.fidelity.error_budget import Sensitivity, sensitivity
from ann_dc.fidelity.monte_carlo import settled_error, specimens, undrawn
from ann_dc.fidelity.prediction import REPELS, not_emulated
from ann_dc.fidelity.specimen import Specimen
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import draw
from ann_dc.hardware.circuit.parameters import Parameter, Quantity
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, PositiveFinite, Share
from ann_dc.progress import Progress
from ann_dc.study.measuring.yields import Yield

TRIMMED = (Kind.OFFSET, Kind.GAIN, Kind.PRODUCT_OFFSET)
"""What is trimmed; resistors are bought as good as they have to be."""

DRAWN = 400
"""Circuits whose errors are predicted by sensitivities after every step."""

BEST = 1.05
"""Of what remains with all trims: so near steps lead where what was asked for is out of reach."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """One trim.

    Attributes
    ----------
    parameter : Parameter
        The part and the quantity that is trimmed.
    stage : int
        In which cell.
    reading : Reading
        What to measure, and what to expect.
    remaining : float
        Error of the controls, over the largest one, that the share of circuits stays below then.
    """

    parameter: Parameter
    stage: int
    reading: Reading
    remaining: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trimming:
    """A procedure, and what it brings.

    Attributes
    ----------
    error : float
        What was asked for: error of the controls over the largest one.
    share : float
        Of the circuits that are to meet it.
    untrimmed, floor : float
        Error that the share stays below without a trim, and with all of them.
    steps : tuple of Step
        In this order.
    before, after : (S,) array
        Errors of drawn circuits by emulation, without and with the steps; infinite where one does
        not settle.
    """

    error: float
    share: float
    untrimmed: float
    floor: float
    steps: tuple[Step, ...]
    before: np.ndarray
    after: np.ndarray

    @property
    def remaining(self) -> float:
        """Error that the share stays below after all steps, by sensitivities."""
        return self.steps[-1].remaining if self.steps else self.untrimmed

    @property
    def reached(self) -> bool:
        """Whether the steps meet what was asked for, by sensitivities."""
        return self.remaining <= self.error

    @property
    def kept(self) -> Yield:
        """Share of the emulated circuits that meet it with the steps, with its interval."""
        return Yield(passed=int((self.after <= self.error).sum()), count=len(self.after))

    @property
    def confirmed(self) -> bool:
        """Whether some emulated circuits meet it, and as many as the share does not contradict."""
        return self.kept.passed > 0 and self.kept.high >= self.share


@checked
def trimming(
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    error: PositiveFinite,
    *,
    share: Share = 0.95,
    resolution: PositiveFinite = 1e-5,
    samples: Count = 20,
) -> Trimming:
    """Which offsets and gains to trim, in which order, to make the controls right enough.

    Parameters
    ----------
    backend : SpiceBackend
        Its level's tolerances say how far parts are off, beside resistors of its series.
    circuit : Circuit
        Of op amps.
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    error : float
        To reach: largest error of a control, over the largest control.
    share : float
        Of the circuits that are to reach it.
    resolution : float
        Volts to which a reading can be set.
    samples : int
        Drawn circuits that are emulated, trimmed and not.

    Returns
    -------
    Trimming
        Where not even all trims are enough, those that nearly bring as much as all.

    Raises
    ------
    NetworkError
        If the circuit has no emulation, no error budget, or oscillates with nominal parts.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import trimming
    >>> from ann_dc.hardware.parts import Tolerances
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> parts = Tolerances(resistor=1e-4, offset=1e-3)
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(tolerances=parts))
    >>> found = trimming(backend, *backend.prepare(network), error=1e-3)
    >>> found.reached, found.untrimmed > 5 * found.remaining
    (True, True)
    >>> found.steps[0].reading.volts  # an op amp whose inputs are to be equal
    0.0
    """
    nominal = undrawn(backend, circuit, probe)
    missing = not_emulated(nominal)
    if missing is not None:
        raise NetworkError(f"trimming: {missing}")
    _check_settles(backend, nominal)
    backend.progress("sensitivities")
    slopes = sensitivity(nominal.emulation, nominal.settled)
    known = tuple(p for p in slopes.parameters if p.name in slopes.slopes)
    order = _order(known, slopes, nominal)
    readings = [reading_of(nominal, parameter, stage) for parameter, stage in order]
    drawn = _Drawn(known, slopes, nominal)
    untrimmed = drawn.remaining(share)
    for place, reading in zip(order, readings):
        drawn.trim(*place, resolution / abs(reading.slope))
    floor = drawn.remaining(share)
    drawn = _Drawn(known, slopes, nominal)
    steps, enough = [], max(error, BEST * floor)
    for (parameter, stage), reading in zip(order, readings):
        if drawn.remaining(share) <= enough:
            break
        drawn.trim(parameter, stage, resolution / abs(reading.slope))
        left = drawn.remaining(share)
        steps.append(Step(parameter=parameter, stage=stage, reading=reading, remaining=left))
    before, after = _emulated(nominal, steps, resolution, range(samples), backend.progress)
    return Trimming(
        error=error,
        share=share,
        untrimmed=untrimmed,
        floor=floor,
        steps=tuple(steps),
        before=before,
        after=after,
    )


def _check_settles(backend: SpiceBackend, nominal: Specimen) -> None:
    """Refuse a circuit that oscillates, which no trim cures."""
    if backend.level.emulated:
        backend.check_stable(nominal.emulation, nominal.probe)
    if nominal.modes.abscissa >= 0:
        raise NetworkError(f"trimming: {REPELS}, and no trim cures that; take faster parts")


class _Drawn:
    """Controls of many drawn circuits by sensitivities, while their parts are trimmed.

    Attributes
    ----------
    errors : (S, controls) array
        Of all controls, with their signs, over the largest one.
    """

    def __init__(
        self,
        known: Sequence[Parameter],
        slopes: Sensitivity,
        nominal: Specimen,
    ) -> None:
        right = nominal.probe.control_values[-1]
        lost = (nominal.emulation.controls(nominal.settled) - right) / np.abs(right).max()
        each = [draw(known, nominal.level.tolerances, seed) for seed in range(DRAWN)]
        self.slopes = slopes.slopes
        self.off = {name: np.array([drawn[name] for drawn in each]) for name in each[0]}
        self.errors = lost + sum(
            (off @ self.slopes[name].T for name, off in self.off.items()),
            np.zeros((DRAWN, len(right))),
        )

    def trim(self, parameter: Parameter, stage: int, grain: float) -> None:
        """Set one part of every circuit, to a grain of what is trimmed."""
        change = -grain * np.round(self.off[parameter.name][:, stage] / grain)
        self.errors += np.outer(change, self.slopes[parameter.name][:, stage])

    def remaining(self, share: float) -> float:
        """Largest error of a control that a share of the circuits stays below."""
        return float(np.quantile(np.abs(self.errors).max(axis=1), share))


def _order(
    known: Sequence[Parameter], slopes: Sensitivity, nominal: Specimen
) -> list[tuple[Parameter, int]]:
    """All trims, each the largest part of what is left of the worst control's variance.

    The gain of a function generator comes before its offset, which is read with the gain right.
    """
    sizes = nominal.level.tolerances
    parts = {p.name: (sizes.deviation(p.kind) * slopes.slopes[p.name]) ** 2 for p in known}
    left = sum(parts[p.name][:, p.present].sum(axis=1) for p in known)
    places = [
        (parameter, stage)
        for parameter in known
        if parameter.kind in TRIMMED and sizes.deviation(parameter.kind) > 0
        for stage in map(int, np.flatnonzero(parameter.present))
    ]
    if not places:
        return []
    share = np.array([parts[parameter.name][:, stage] for parameter, stage in places])
    order, open_, gains = [], np.ones(len(places), bool), _gains(nominal, places)
    while open_.any():
        best = int(np.where(open_, share[:, int(np.argmax(left))], -1.0).argmax())
        gain = gains.get((places[best][0].part, places[best][1]), best)
        best = gain if open_[gain] else best
        order.append(places[best])
        open_[best] = False
        left = left - share[best]
    return order


def _gains(nominal: Specimen, places: Sequence[tuple[Parameter, int]]) -> dict[tuple, int]:
    """Which trim is the gain of a function generator, by part and cell."""
    parts = nominal.circuit.schematic.by_name
    return {
        (parameter.part, stage): n
        for n, (parameter, stage) in enumerate(places)
        if parameter.quantity is Quantity.GAIN and isinstance(parts[parameter.part], Generator)
    }


def _emulated(
    nominal: Specimen,
    steps: Sequence[Step],
    resolution: float,
    seeds: Sequence[int],
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of drawn circuits, without and with the steps; infinite where one does not settle."""
    before, after = [], []
    for specimen in specimens(nominal, seeds, progress=progress):
        before.append(settled_error(specimen))
        trimmed = {name: np.array(off, float) for name, off in specimen.deviations.items()}
        for step in steps:
            _trim(nominal, trimmed, step, resolution)
        there = Specimen(
            circuit=nominal.circuit, level=nominal.level, probe=nominal.probe, deviations=trimmed
        )
        after.append(settled_error(there))
    return np.nan_to_num(before, nan=np.inf), np.nan_to_num(after, nan=np.inf)


def _trim(nominal: Specimen, off: Mapping[str, np.ndarray], step: Step, resolution: float) -> None:
    """Turn one trim of a drawn circuit until it reads what it is to read; in place."""
    here = {p.quantity: p.name for p in nominal.circuit.parameters if p.part == step.parameter.part}
    errors = {q: float(off[name][step.stage]) for q, name in here.items() if name in off}
    volts = misread(nominal, step.parameter, step.stage, errors)
    change = resolution * np.round(volts / resolution) / step.reading.slope
    off[step.parameter.name][step.stage] -= change
