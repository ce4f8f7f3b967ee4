"""Trimming procedure: choice and order of offsets and gains for an error limit.

Deviations d of single parts shift the settled controls by e = e_0 + S d. S comes from the error
budget, and e_0 is the error of finite gains. The part whose error contributes most to the variance
of the worst control is trimmed first, cell by cell.

The number of trims comes from emulated circuits. The search starts at the number predicted by
sensitivities and returns about the fewest trims with which the requested fraction of circuits meets
the error. Other drawn circuits validate the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.measurements import misread
from ann_dc.fidelity.boards.trim_order import Step, trim_steps
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import instances, settled_error, undrawn
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import REPELS, not_emulated
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.progress import Progress
from ann_dc.validation import Count, PositiveFinite, Share, checked
from ann_dc.yields import Yield

BEST = 1.05
"""Factor on the error left by all trims, or by the best number of them; below it trimming stops."""


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
        """Error that the requested fraction of circuits does not exceed after all steps.

        The error is computed by sensitivities.
        """
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
    circuit : Circuit
        Circuit of op amps.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
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
    >>> found.steps[0].reading.volts  # an op amp whose inputs are to be equal
    0.0
    """
    nominal = undrawn(backend, circuit, probe)
    missing = not_emulated(nominal)
    if missing is not None:
        raise NetworkError(f"trimming: {missing}")
    _check_settles(backend, nominal)
    noise = control_noise(nominal)
    static = _without_noise(error, noise)
    backend.progress("sensitivities")
    slopes = sensitivity(nominal.emulation, nominal.settled)
    steps, untrimmed = trim_steps(nominal, slopes, share, resolution)
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
    emulated, told = _held(boards.errors(0), share), _held(untrimmed[:samples], share)
    enough = static * told / emulated if 0 < emulated < np.inf else static
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
            f"trimming: noise of {rms:.2g} of the largest control rms is on the controls, and no "
            f"trim brings them below {error:.2g}; take smaller resistors, or a larger full scale"
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
    """Drawn circuits, emulated with the first trim steps; results are cached.

    Attributes
    ----------
    nominal : CircuitInstance
        Nominal circuit, common to all.
    resolution : float
        Accuracy of a reading, in volts.
    drawn : sequence of CircuitInstance
        Circuit instances.
    progress : Progress
        Receives every circuit.
    known : dict of int to (S,) array
        Errors by the number of steps.
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
            told = f"{count} of {len(self.steps)} trims, circuit"
            for number, board in enumerate(self.drawn, 1):
                self.progress(f"{told} {number} of {len(self.drawn)}")
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
        raise NetworkError(f"trimming: {REPELS}, and no trim cures that; take faster parts")


def _trimmed(
    nominal: CircuitInstance, board: CircuitInstance, steps: Sequence[Step], resolution: float
) -> CircuitInstance:
    """Return a drawn circuit after its trim steps."""
    off = {name: np.array(each, float) for name, each in board.deviations.items()}
    for step in steps:
        _trim(nominal, off, step, resolution)
    return replace(board, deviations=off)


def _trim(
    nominal: CircuitInstance, off: Mapping[str, np.ndarray], step: Step, resolution: float
) -> None:
    """Adjust one trim in place until the reading has its target value."""
    here = {p.quantity: p.name for p in nominal.circuit.parameters if p.part == step.parameter.part}
    errors = {q: float(off[name][step.stage]) for q, name in here.items() if name in off}
    volts = misread(nominal, step.parameter, step.stage, errors)
    change = resolution * np.round(volts / resolution) / step.reading.slope
    off[step.parameter.name][step.stage] -= change
