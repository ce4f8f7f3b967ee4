"""Parametric yield: fraction of drawn circuits that meet a specification.

Circuits are drawn from the tolerances of their parts, emulated and solved. A few circuits, spread
from the best to the worst, also run in ngspice and are compared with the emulation of the same
circuit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import (
    instances,
    measured_runs,
    sample_decks,
    settled_error,
    undrawn,
)
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import Unpredicted, prediction_of, require_emulation, untimed
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.validation import Count, Index, Positive, checked
from ann_dc.yields import Yield, within

TERM = re.compile(r"(error|settle)\s*<=?\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(%|[munµμ]?s|)")
"""Pattern of a limit: quantity, value and unit."""

UNITS = {
    "error": {"": 1.0, "%": 1e-2},
    "settle": {"s": 1.0, "ms": 1e-3, **dict.fromkeys(("us", "µs", "μs"), 1e-6), "ns": 1e-9},
}
"""Factors of the units: fractions of the largest control, and seconds."""

STABLE = "stable"
"""Term that requires only that a circuit settles, as every specification does."""


@checked
@dataclass(frozen=True, kw_only=True)
class Spec:
    """Limits of a circuit; a circuit that does not settle fails all limits.

    ``error`` limits the error of the settled controls, relative to the largest control, and
    ``settling_time`` the seconds until every control stays within 0.1 %.
    """

    error: Positive = math.inf
    settling_time: Positive = math.inf

    @property
    def limits(self) -> dict[str, float]:
        """Finite limits, by name."""
        given = {"error": self.error, "settling_time": self.settling_time}
        return {name: limit for name, limit in given.items() if math.isfinite(limit)}

    def excess(self, error: float, settling_time: float) -> float:
        """Return the larger ratio of the two figures to their limits; 1 is still met.

        The ratio is infinite if a limited figure is nan, and zero if no figure is limited.
        """
        figures = {"error": error, "settling_time": settling_time}
        shares = [figures[name] / limit for name, limit in self.limits.items()]
        return max((math.inf if math.isnan(share) else share for share in shares), default=0.0)

    def __str__(self) -> str:
        words = [f"error<{100 * self.error:g}%"] if math.isfinite(self.error) else []
        if math.isfinite(self.settling_time):
            words.append(f"settle<{1e6 * self.settling_time:g}us")
        return ", ".join(words) or STABLE


@checked
def spec_of(text: str) -> Spec:
    """Parse a specification, ``error<1%, settle<50us``, term by term.

    The terms are ``error<1%`` or ``error<0.01``, ``settle<50us`` (s, ms, us, ns) and ``stable``.
    Raises `NetworkError` if a term is invalid or repeated, or if its limit is not positive.

    >>> spec_of("error < 0.5%, settle<2s").limits
    {'error': 0.005, 'settling_time': 2.0}
    """
    found: dict[str, float] = {}
    for term in text.lower().split(","):
        word = term.strip()
        if word == STABLE:
            continue
        match = TERM.fullmatch(word)
        what, number, unit = match.groups() if match else ("", "", "")
        _check_unit(what, number, unit, word)
        limit = _limit(number) * UNITS.get(what, {}).get(unit, math.nan)
        name = "error" if what == "error" else "settling_time"
        if not 0 < limit < math.inf or name in found:
            raise NetworkError(
                "spec: expected terms with commas, each once, with < and a number above 0, such "
                f"as error<1%, settle<50us or stable; got {term.strip()!r} in {text!r}"
            )
        found[name] = limit
    return Spec(**found)


def _check_unit(what: str, number: str, unit: str, word: str) -> None:
    """Raise `NetworkError` if number and unit are probably a mistake."""
    if what == "settle" and not unit:
        raise NetworkError(f"spec: {word!r} needs ns, us, ms or s, such as settle<50us")
    if what == "error" and not unit and 1 <= _limit(number) < math.inf:
        raise NetworkError(
            f"spec: {word!r} is {100 * _limit(number):g} % of the largest control; write "
            f"error<{number}% for per cent, or a fraction below 1"
        )


def _limit(number: str) -> float:
    try:
        return float(number)
    except ValueError:
        return math.nan


CLOSE = 0.1
"""Relative distance to a limit within which two figures agree although the limit separates them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """Drawn circuit that was also simulated in ngspice.

    Attributes
    ----------
    predicted, measured : float
        Error of the controls relative to the largest control; nan for a failed run.
    predicted_time, measured_time : float
        Settling time in seconds. If the spec does not limit it, the predicted time is nan and the
        measured time is accurate to some percent only.
    kept : (bool, bool)
        True if the circuit meets the spec, as predicted and in ngspice.
    agreed : bool
        True if both meet the spec, if both fail, or if both are close to its limit.
    """

    seed: int
    predicted: float
    measured: float
    predicted_time: float
    measured_time: float
    kept: tuple[bool, bool]
    agreed: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitYield:
    """Yield of drawn circuits for a specification.

    Attributes
    ----------
    errors : (S,) array
        Predicted error of the controls, relative to the largest control; nan if a circuit does not
        settle.
    noise : float
        Rms noise of the worst control relative to the largest control, for the nominal circuit. It
        is added to every error as rms, unless it is nan (unknown).
    settling_times : (S,) array
        Settling times in seconds; nan if the spec does not limit them, if a circuit does not
        settle, or if unknown.
    unknown : tuple of str
        Reason, per circuit, for which the settling time of a settling circuit is unknown; otherwise
        empty. A spec with a settling time counts such a circuit as failed.
    found : Yield
        Fraction that meets the spec, with its interval.
    spots : tuple of Spot
        Circuits that ran in ngspice, best first.
    """

    spec: Spec
    seeds: tuple[int, ...]
    errors: np.ndarray
    noise: float
    settling_times: np.ndarray
    unknown: tuple[str, ...]
    found: Yield
    spots: tuple[Spot, ...] = ()

    def __str__(self) -> str:
        return f"{self.spec}: {self.found}"

    def excess(self, n: int) -> float:
        """Return the predicted figures of a circuit relative to their limits; see `Spec`."""
        return self.spec.excess(noisy(self.errors[n], self.noise), self.settling_times[n])

    @property
    def closest(self) -> int | None:
        """Index of the circuit best within the spec or closest to it; None if unsettled."""
        stable = map(int, np.flatnonzero(np.isfinite(self.errors)))
        ranked = sorted((self.excess(n), self.errors[n], n) for n in stable)
        return ranked[0][2] if ranked else None


@checked
def yield_of(
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    spec: Spec,
    *,
    samples: Count = 100,
    spots: Index = 0,
) -> CircuitYield:
    """Compute the fraction of drawn circuits that meet a specification.

    Raises `NetworkError` if the circuit has no emulation, or if the spec limits the settling time
    of a circuit whose transient is not run: a clocked circuit or more than 6000 neurons. Raises
    `NgspiceMissing` if spots are requested and ngspice is not found.

    Parameters
    ----------
    backend : SpiceBackend
        Tolerances of its level, at the operating conditions of the level, are drawn. All circuits
        have resistors of its series.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
    spec : Spec
        A spec without a settling time needs no transients: 0.1 s per circuit of the paper's car.
    samples : int
        Number of circuits, with seeds 0, 1, ...
    spots : int
        Number of circuits that also run in ngspice.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import spec_of, yield_of
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro())
    >>> found = yield_of(backend, *backend.prepare(network), spec_of("error<20%"), samples=20)
    >>> print(found.found)  # of resistors of 1 %
    100.0 % (83.2 to 100.0 %, 20 of 20)
    """
    common = undrawn(backend, circuit, probe)
    require_emulation(common, "yield")
    timed = "settling_time" in spec.limits
    if timed and (why := untimed(common)):
        raise NetworkError(f"yield: the settling time of {spec} is unknown: {why}")
    if spots:
        find_ngspice()
    seeds = range(samples)
    drawn = instances(common, seeds, progress=backend.progress)
    figures = [_figures(instance, timed) for instance in drawn]
    errors, times = (np.array([each[n] for each in figures]) for n in range(2))
    noise = control_noise(common)
    columns = {"error": noisy(errors, noise), "settling_time": times}
    passed = np.isfinite(errors) & (within(columns, spec.limits) if spec.limits else True)
    found = CircuitYield(
        spec=spec,
        seeds=tuple(seeds),
        errors=errors,
        noise=noise,
        settling_times=times,
        unknown=tuple(each[2] for each in figures),
        found=Yield(passed=int(passed.sum()), count=samples),
    )
    return replace(found, spots=_spots(backend, common, found, spots))


def _figures(instance: CircuitInstance, timed: bool) -> tuple[float, float, str]:
    """Return control error, settling time and the reason if the time is unknown."""
    if not timed:
        return settled_error(instance), np.nan, ""
    found = prediction_of(instance)
    if isinstance(found, Unpredicted) or not found.stable or found.other_equilibrium:
        return np.nan, np.nan, ""
    return found.control_error, found.settling_time, found.unknown


def _spots(
    backend: SpiceBackend, common: CircuitInstance, drawn: CircuitYield, count: int
) -> tuple[Spot, ...]:
    circuit, probe, spec = common.circuit, common.probe, drawn.spec
    seeds = _spread(drawn.errors, count)
    if not seeds:
        return ()
    backend.progress(f"ngspice, {len(seeds)} circuits")
    decks = sample_decks(circuit, backend.level, probe, seeds, base=common.deviations)
    timed, found = "settling_time" in spec.limits, []
    for seed, run in zip(seeds, measured_runs(backend, circuit, probe, decks)):
        error, time, done = np.nan, np.nan, np.inf
        if run is not None and not run.unsettled:
            error, time = run.control_error, run.settling_time() if timed else np.nan
            done = spec.excess(noisy(error, drawn.noise), time)
        said = drawn.excess(seed)
        spot = Spot(
            seed=seed,
            predicted=drawn.errors[seed],
            measured=error,
            predicted_time=drawn.settling_times[seed],
            measured_time=time,
            kept=(bool(said <= 1), bool(done <= 1)),
            agreed=(said <= 1) == (done <= 1) or abs(said - 1) + abs(done - 1) < CLOSE,
        )
        found.append(spot)
    return tuple(found)


def _spread(errors: np.ndarray, count: int) -> Sequence[int]:
    """Return the indices of settling circuits, evenly from best to worst."""
    ranked = np.argsort(errors)[: int(np.isfinite(errors).sum())]  # nan is sorted to the end
    places = np.linspace(0, len(ranked) - 1, min(count, len(ranked))).round().astype(int)
    return [int(ranked[place]) for place in places]
