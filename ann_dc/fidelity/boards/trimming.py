"""Trimming procedure: choice and order of offsets and gains for an error limit.

Deviations d of single parts shift the settled controls by e = e_0 + S d. S comes from the error
budget, and e_0 is the error of finite gains. The part whose error contributes most to the variance
of the worst control is trimmed first, cell by cell. The errors that remain after every trim are
predicted by sensitivities for many drawn circuits.

The number of trims comes from emulated circuits. The search starts at the number predicted by
sensitivities and returns about the fewest trims with which the requested fraction of circuits meets
the error. Other drawn circuits validate the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.measurements import Reading, misread, reading_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import instances, settled_error, undrawn
from ann_dc.fidelity.error_budget import Sensitivity, sensitivity
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import REPELS, require_emulation
from ann_dc.hardware.circuit.circuit import Circuit, Parameter, Quantity
from ann_dc.hardware.circuit.deviations import draw
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.progress import Progress
from ann_dc.validation import Count, PositiveFinite, Share, checked
from ann_dc.yields import Yield

TRIMMED = (Kind.OFFSET, Kind.GAIN, Kind.PRODUCT_OFFSET)
"""Kinds of quantities that are trimmed; resistors are bought with the required tolerance."""

DRAWN = 400
"""Number of circuits whose errors are predicted by sensitivities after every step."""


BEST = 1.05
"""Factor on the error left by all trims, or by the best number of them; below it trimming stops."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """Trim of one quantity of one part in one cell.

    ``remaining`` is the error of the controls relative to the largest control that the requested
    fraction of circuits does not exceed after this step, by sensitivities.
    """

    parameter: Parameter
    stage: int
    reading: Reading
    remaining: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trimming:
    """Trimming procedure and its result.

    Attributes
    ----------
    error : float
        Requested error of the controls relative to the largest control.
    share : float
        Fraction of the circuits that must meet the error.
    untrimmed, floor : float
        Error that this fraction does not exceed without trims and with all trims, by sensitivities.
    steps : tuple of Step
        Trims, in order.
    places : int
        Number of all possible trims.
    noise : float
        Rms noise of the worst control relative to the largest control, for the nominal circuit. It
        is added to every error as rms, unless it is nan (unknown).
    before, after : (S,) array
        Errors of drawn circuits by emulation, without and with the steps; infinite if a circuit
        does not settle. These circuits are not those from which the number of trims was chosen.
    """

    error: float
    share: float
    untrimmed: float
    floor: float
    steps: tuple[Step, ...]
    places: int
    noise: float
    before: np.ndarray
    after: np.ndarray

    @property
    def remaining(self) -> float:
        """Error that the requested fraction of circuits does not exceed after all steps."""
        return self.steps[-1].remaining if self.steps else self.untrimmed

    @property
    def kept(self) -> Yield:
        """Fraction (with interval) of the emulated circuits that meet the error."""
        return _keeping(self.after, self.noise, self.error)

    @property
    def reached(self) -> bool:
        """True if the requested fraction of emulated circuits meets the error."""
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
    """Select and order the trims that reduce the control error below a limit.

    If no number of trims suffices, the fewest trims with nearly the best result are returned.
    Raises `NetworkError` if the circuit has no emulation or error budget, oscillates with nominal
    parts, or is too noisy for any trim.

    Parameters
    ----------
    backend : SpiceBackend
        Tolerances of its level give the deviations of parts; resistors have the values of its
        series.
    circuit, probe : Circuit, Trajectory
        Circuit of op amps, and the run of the ideal network by which it was scaled.
    error : float
        Limit of the largest control error with its noise, relative to the largest control.
    share : float
        Fraction of the circuits that must meet the limit.
    resolution : float
        Accuracy of a reading, in volts.
    samples : int
        Drawn circuits emulated for every number of trims that is tried, about 2 log2 P numbers for
        P trims. The same count of other circuits validates the chosen number.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import trimming
    >>> from ann_dc.hardware.parts import Tolerances
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> parts = Tolerances(resistor=1e-4, offset=1e-3)
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(tolerances=parts))
    >>> found = trimming(backend, *backend.prepare(network), error=1e-3)
    >>> found.reached, found.untrimmed > 5 * found.remaining
    (True, True)
    """
    nominal = undrawn(backend, circuit, probe)
    require_emulation(nominal, "trimming")
    _check_settles(backend, nominal)
    noise = control_noise(nominal)
    static = _without_noise(error, noise)
    backend.progress("sensitivities")
    slopes = sensitivity(nominal.emulation, nominal.settled)
    steps, untrimmed = _trim_steps(nominal, slopes, share, resolution)
    remaining = [float(np.quantile(untrimmed, share)), *(step.remaining for step in steps)]
    boards, others = (
        _Boards(
            nominal=nominal,
            steps=steps,
            resolution=resolution,
            drawn=list(instances(nominal, seeds)),
            progress=backend.progress,
        )
        for seeds in (range(samples), range(samples, 2 * samples))
    )
    emulated, reported = _held(boards.errors(0), share), _held(untrimmed[:samples], share)
    enough = static * reported / emulated if 0 < emulated < np.inf else static
    enough = max(enough, BEST * remaining[-1])
    guess = next(n for n, left in enumerate(remaining) if left <= enough)

    def enough_trims(n: int) -> bool:
        return _keeping(boards.errors(n), noise, error).share >= share

    count = _fewest(guess, len(steps), enough_trims)
    if count is None:
        held = {n: _held(errors, share) for n, errors in sorted(boards.known.items())}
        count = next(n for n, each in held.items() if each <= BEST * min(held.values()))
    return Trimming(
        error=error,
        share=share,
        untrimmed=remaining[0],
        floor=remaining[-1],
        steps=tuple(steps[:count]),
        places=len(steps),
        noise=noise,
        before=others.errors(0),
        after=others.errors(count),
    )


def _without_noise(error: float, noise: float) -> float:
    """Return the error limit less the noise; raise `NetworkError` if noise exceeds it."""
    rms = float(np.nan_to_num(noise))
    if rms >= error:
        raise NetworkError(
            f"trimming: noise of {rms:.2g} of the largest control (rms) remains, and trimming "
            f"cannot reduce the error below {error:.2g}; use smaller resistors, or a larger "
            "full scale"
        )
    return math.sqrt(error**2 - rms**2)


def _keeping(errors: np.ndarray, noise: float, error: float) -> Yield:
    """Return the fraction of emulated circuits that meet an error, noise included."""
    return Yield(passed=int((noisy(errors, noise) <= error).sum()), count=len(errors))


def _fewest(guess: int, most: int, enough: Callable[[int], bool]) -> int | None:
    """Return about the fewest sufficient trims, from a guess upwards, or None."""
    low, high = guess - 1, guess
    while not enough(high):
        if high == most:
            return None
        low, high = high, min(max(1, 2 * high), most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


@dataclass(frozen=True, kw_only=True, eq=False)
class _Boards:
    """Drawn circuits, emulated with the first trim steps to a reading's ``resolution`` (V).

    ``known`` has the errors (S,) by the number of steps.
    """

    nominal: CircuitInstance
    steps: Sequence[Step]
    resolution: float
    drawn: Sequence[CircuitInstance]
    progress: Progress
    known: dict[int, np.ndarray] = field(default_factory=dict)

    def errors(self, count: int) -> np.ndarray:
        """Return the control errors (S,); infinite if a circuit does not settle."""
        if count not in self.known:
            found, steps = [], self.steps[:count]
            reported = f"{count} of {len(self.steps)} trims, circuit"
            for number, board in enumerate(self.drawn, 1):
                self.progress(f"{reported} {number} of {len(self.drawn)}")
                found.append(settled_error(_trimmed(self.nominal, board, steps, self.resolution)))
            self.known[count] = np.nan_to_num(found, nan=np.inf)
        return self.known[count]


def _held(errors: np.ndarray, share: float) -> float:
    """Return the error limit met by a fraction of circuits; infinite if fewer settle."""
    return float(np.quantile(errors, share, method="inverted_cdf"))


def _check_settles(backend: SpiceBackend, nominal: CircuitInstance) -> None:
    """Raise `NetworkError` if the circuit oscillates, which trimming cannot remedy."""
    if backend.level.emulated:
        backend.check_stable(nominal.emulation, nominal.probe)
    if nominal.modes.abscissa >= 0:
        raise NetworkError(f"trimming: {REPELS}, which trimming does not change; use faster parts")


def _trimmed(
    nominal: CircuitInstance, board: CircuitInstance, steps: Sequence[Step], resolution: float
) -> CircuitInstance:
    """Return a drawn circuit after its trim steps."""
    off = {name: np.array(each, float) for name, each in board.deviations.items()}
    for step in steps:
        trimmed, stage = step.parameter, step.stage
        here = {p.quantity: p.name for p in nominal.circuit.parameters if p.part == trimmed.part}
        errors = {q: float(off[name][stage]) for q, name in here.items() if name in off}
        volts = misread(nominal, trimmed, stage, errors)
        off[trimmed.name][stage] -= resolution * np.round(volts / resolution) / step.reading.slope
    return replace(board, deviations=off)


def _trim_steps(
    nominal: CircuitInstance, slopes: Sensitivity, share: Share, resolution: PositiveFinite
) -> tuple[list[Step], np.ndarray]:
    """Return all trims in order and the untrimmed errors (DRAWN,) of drawn circuits.

    Errors are predicted by sensitivities, and are the largest control error of each circuit
    relative to the largest control, by seed. `share` is the fraction of circuits to which the
    remaining error of each step refers; `resolution` is the accuracy of a reading in volts.
    """
    known = tuple(p for p in slopes.parameters if p.name in slopes.slopes)
    drawn, steps = _Drawn(slopes, nominal), []
    untrimmed = drawn.worst
    for parameter, stage in _order(known, slopes, nominal):
        reading = reading_of(nominal, parameter, stage)
        drawn.trim(parameter, stage, resolution / abs(reading.slope))
        left = drawn.remaining(share)
        steps.append(Step(parameter=parameter, stage=stage, reading=reading, remaining=left))
    return steps, untrimmed


class _Drawn:
    """Signed control errors (S, controls) of drawn circuits, by sensitivities."""

    def __init__(self, slopes: Sensitivity, nominal: CircuitInstance) -> None:
        right = nominal.probe.control_values[-1]
        lost = (nominal.emulation.controls(nominal.settled) - right) / nominal.probe.control_size
        listed, sizes = nominal.circuit.parameters, nominal.level.tolerances
        each = [draw(listed, sizes, seed) for seed in range(DRAWN)]
        self.slopes = slopes.slopes
        moving = [name for name in each[0] if name in slopes.slopes]
        self.off = {name: np.array([drawn[name] for drawn in each]) for name in moving}
        self.errors = lost + sum(
            (off @ self.slopes[name].T for name, off in self.off.items()),
            np.zeros((DRAWN, len(right))),
        )

    def trim(self, parameter: Parameter, stage: int, grain: float) -> None:
        """Trim one part of every circuit to the resolution `grain` of the quantity."""
        change = -grain * np.round(self.off[parameter.name][:, stage] / grain)
        self.errors += np.outer(change, self.slopes[parameter.name][:, stage])

    @property
    def worst(self) -> np.ndarray:
        """Largest control error of every circuit, shape (S,)."""
        return np.abs(self.errors).max(axis=1)

    def remaining(self, share: float) -> float:
        """Return the largest control error that a fraction of the circuits stays below."""
        return float(np.quantile(self.worst, share))


def _order(
    known: Sequence[Parameter], slopes: Sensitivity, nominal: CircuitInstance
) -> list[tuple[Parameter, int]]:
    """Return all trims by contribution to the worst control's remaining variance.

    The gain of a function generator precedes its offset, which is read with a trimmed gain.
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


def _gains(nominal: CircuitInstance, places: Sequence[tuple[Parameter, int]]) -> dict[tuple, int]:
    """Return the position of each function generator's gain trim, by part and cell."""
    parts = nominal.circuit.schematic.by_name
    return {
        (parameter.part, stage): n
        for n, (parameter, stage) in enumerate(places)
        if parameter.quantity is Quantity.GAIN and isinstance(parts[parameter.part], Generator)
    }
