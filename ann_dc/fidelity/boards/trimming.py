r"""Trimming: which offsets and gains to set by hand, in which order, until a spec is met.

Deviations d of single parts move the settled controls by e = e_0 + S d, with S from the error
budget and e_0 what finite gains cost. The part whose error makes most of the variance of the worst
control is trimmed first, cell by cell. How many trims it takes, emulated circuits tell: as many as
should do by slopes, which are as far off as they are for these circuits without a trim, then twice
as many, until the share that was asked for keeps the error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

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
"""Of the least that remains: so near steps lead where what was asked for is out of reach."""


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
        Error of the controls, over the largest one, that the share of circuits stays below then,
        by sensitivities.
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
        Error that the share stays below without a trim, and with all of them, by sensitivities.
    steps : tuple of Step
        In this order.
    places : int
        All trims there are.
    before, after : (S,) array
        Errors of drawn circuits by emulation, without and with the steps; infinite where one does
        not settle.
    """

    error: float
    share: float
    untrimmed: float
    floor: float
    steps: tuple[Step, ...]
    places: int
    before: np.ndarray
    after: np.ndarray

    @property
    def remaining(self) -> float:
        """Error that the share stays below after all steps, by sensitivities."""
        return self.steps[-1].remaining if self.steps else self.untrimmed

    @property
    def kept(self) -> Yield:
        """Share of the emulated circuits that meet it with the steps, with its interval."""
        return Yield(passed=int((self.after <= self.error).sum()), count=len(self.after))

    @property
    def reached(self) -> bool:
        """Whether the steps bring the share that was asked for of the emulated circuits to it."""
        return self.kept.share >= self.share


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
        Where no number of trims is enough, the fewest that nearly bring as much as any.

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
    steps, drawn = _all_steps(nominal, slopes, share, resolution)
    remaining = [float(np.quantile(drawn, share)), *(step.remaining for step in steps)]
    boards, tried = list(specimens(nominal, range(samples))), {}

    def trim(count: int) -> Trimming:
        if count not in tried:
            trimmed = (_trimmed(nominal, board, steps[:count], resolution) for board in boards)
            told = f"{count} of {len(steps)} trims, circuit {{}} of {samples}"
            tried[count] = _settled_errors(trimmed, told, backend.progress)
        return Trimming(
            error=error,
            share=share,
            untrimmed=remaining[0],
            floor=remaining[-1],
            steps=tuple(steps[:count]),
            places=len(steps),
            before=tried[0],
            after=tried[count],
        )

    emulated = _held(trim(0).before, share) / _held(drawn[:samples], share)
    enough = error / emulated if 0 < emulated < np.inf else error
    for count in _counts(remaining, max(enough, BEST * remaining[-1])):
        if (found := trim(count)).reached:
            return found
    held = {count: _held(errors, share) for count, errors in sorted(tried.items())}
    return trim(next(n for n, each in held.items() if each <= BEST * min(held.values())))


def _counts(remaining: Sequence[float], enough: float) -> Iterator[int]:
    """Numbers of trims to try: as many as should do by slopes, then twice as many, up to all."""
    most = len(remaining) - 1
    count = next(n for n, left in enumerate(remaining) if left <= enough)
    while count < most:
        yield count
        count = max(1, 2 * count)
    yield most


def _held(errors: np.ndarray, share: float) -> float:
    """Error that a share of emulated circuits stays below, infinite where fewer settle."""
    return float(np.quantile(errors, share, method="inverted_cdf"))


def _all_steps(
    nominal: Specimen, slopes: Sensitivity, share: float, resolution: float
) -> tuple[list[Step], np.ndarray]:
    """All trims in their order, and errors of drawn circuits without any, by slopes."""
    known = tuple(p for p in slopes.parameters if p.name in slopes.slopes)
    drawn, steps = _Drawn(known, slopes, nominal), []
    untrimmed = drawn.worst
    for parameter, stage in _order(known, slopes, nominal):
        reading = reading_of(nominal, parameter, stage)
        drawn.trim(parameter, stage, resolution / abs(reading.slope))
        left = drawn.remaining(share)
        steps.append(Step(parameter=parameter, stage=stage, reading=reading, remaining=left))
    return steps, untrimmed


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

    @property
    def worst(self) -> np.ndarray:
        """Largest error of a control of every circuit, (S,)."""
        return np.abs(self.errors).max(axis=1)

    def remaining(self, share: float) -> float:
        """Largest error of a control that a share of the circuits stays below."""
        return float(np.quantile(self.worst, share))


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


def _settled_errors(boards: Iterable[Specimen], told: str, progress: Progress) -> np.ndarray:
    """Errors of emulated circuits; infinite where one does not settle."""
    errors = []
    for number, board in enumerate(boards, 1):
        progress(told.format(number))
        errors.append(settled_error(board))
    return np.nan_to_num(errors, nan=np.inf)


def _trimmed(
    nominal: Specimen, board: Specimen, steps: Sequence[Step], resolution: float
) -> Specimen:
    """A drawn circuit once its steps are done."""
    off = {name: np.array(each, float) for name, each in board.deviations.items()}
    for step in steps:
        _trim(nominal, off, step, resolution)
    return replace(board, deviations=off)


def _trim(nominal: Specimen, off: Mapping[str, np.ndarray], step: Step, resolution: float) -> None:
    """Turn one trim of a drawn circuit until it reads what it is to read; in place."""
    here = {p.quantity: p.name for p in nominal.circuit.parameters if p.part == step.parameter.part}
    errors = {q: float(off[name][step.stage]) for q, name in here.items() if name in off}
    volts = misread(nominal, step.parameter, step.stage, errors)
    change = resolution * np.round(volts / resolution) / step.reading.slope
    off[step.parameter.name][step.stage] -= change
