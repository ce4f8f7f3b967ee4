r"""Trimming: which offsets and gains to set by hand, in which order, until a spec is met.

Deviations d of single parts move the settled controls by e = e_0 + S d, with S from the error
budget and e_0 what finite gains cost. The part whose error makes most of the variance of the worst
control is trimmed first, cell by cell. How many trims it takes, emulated circuits tell: about the
fewest from what slopes ask for on, with which the share that was asked for keeps the error; others
judge it.
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
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.fidelity.circuit_study import settled_error, specimens, undrawn
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import REPELS, not_emulated
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.progress import Progress
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, PositiveFinite, Share
from ann_dc.yields import Yield

BEST = 1.05
"""Of what all trims leave, or the best number of them: so near it is no use to trim on."""


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
    noise : float
        Rms of the worst control over the largest one, of the nominal circuit; it counts with every
        error, as rms, where it is not nan for not known.
    before, after : (S,) array
        Errors of drawn circuits by emulation, without and with the steps, others than those that
        told how many there are to be; infinite where one does not settle.
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
        """Error that the share stays below after all steps, by sensitivities."""
        return self.steps[-1].remaining if self.steps else self.untrimmed

    @property
    def kept(self) -> Yield:
        """Share of the emulated circuits that meet it with the steps, with its interval."""
        return _keeping(self.after, self.noise, self.error)

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
        To reach: largest error of a control with its noise, over the largest control.
    share : float
        Of the circuits that are to reach it.
    resolution : float
        Volts to which a reading can be set.
    samples : int
        Drawn circuits that are emulated with every number of trims that is tried, of P trims about
        2 log2 P, and as many that judge the number that was chosen.

    Returns
    -------
    Trimming
        Where no number of trims is enough, the fewest that nearly bring as much as any.

    Raises
    ------
    NetworkError
        If the circuit has no emulation, no error budget, oscillates with nominal parts, or is too
        noisy whatever is trimmed.

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
            drawn=list(specimens(nominal, seeds)),
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
    """What noise leaves of an error that is to be reached."""
    rms = float(np.nan_to_num(noise))
    if rms >= error:
        raise NetworkError(
            f"trimming: noise of {rms:.2g} of the largest control rms is on the controls, and no "
            f"trim brings them below {error:.2g}; take smaller resistors, or a larger full scale"
        )
    return math.sqrt(error**2 - rms**2)


def _keeping(errors: np.ndarray, noise: float, error: float) -> Yield:
    """Which share of emulated circuits, of errors (S,), keeps an error with its noise."""
    return Yield(passed=int((noisy(errors, noise) <= error).sum()), count=len(errors))


def _fewest(guess: int, most: int, enough: Callable[[int], bool]) -> int | None:
    """About the fewest trims from a guess on that are enough; None where not even all are."""
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
    """Drawn circuits, emulated with the first of all steps; every number of them once.

    Attributes
    ----------
    nominal : Specimen
        What all of them have in common.
    steps : sequence of Step
        All of them.
    resolution : float
        Volts to which a reading can be set.
    drawn : sequence of Specimen
        One a circuit.
    progress : Progress
        Told every circuit.
    known : dict of int to (S,) array
        Errors by the number of steps.
    """

    nominal: Specimen
    steps: Sequence[Step]
    resolution: float
    drawn: Sequence[Specimen]
    progress: Progress
    known: dict[int, np.ndarray] = field(default_factory=dict)

    def errors(self, count: int) -> np.ndarray:
        """Of the controls (S,), infinite where a circuit does not settle."""
        if count not in self.known:
            found, steps = [], self.steps[:count]
            told = f"{count} of {len(self.steps)} trims, circuit"
            for number, board in enumerate(self.drawn, 1):
                self.progress(f"{told} {number} of {len(self.drawn)}")
                found.append(settled_error(_trimmed(self.nominal, board, steps, self.resolution)))
            self.known[count] = np.nan_to_num(found, nan=np.inf)
        return self.known[count]


def _held(errors: np.ndarray, share: float) -> float:
    """Error that a share of emulated circuits stays below, infinite where fewer settle."""
    return float(np.quantile(errors, share, method="inverted_cdf"))


def _check_settles(backend: SpiceBackend, nominal: Specimen) -> None:
    """Refuse a circuit that oscillates, which no trim cures."""
    if backend.level.emulated:
        backend.check_stable(nominal.emulation, nominal.probe)
    if nominal.modes.abscissa >= 0:
        raise NetworkError(f"trimming: {REPELS}, and no trim cures that; take faster parts")


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
