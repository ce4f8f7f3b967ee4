"""Yield: what share of circuits, drawn from the tolerances of their parts, keeps a spec.

Every circuit is emulated and solved; a few of them run in ngspice as well, spread from the best to
the worst, and are compared with what the emulation said of the same circuit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.spec import Spec
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.fidelity.circuit_study import (
    measured_runs,
    sample_decks,
    settled_error,
    specimens,
    undrawn,
)
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import Unpredicted, not_emulated, prediction_of, untimed
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Index
from ann_dc.yields import Yield, within

CLOSE = 0.1
"""Of a limit: so far two figures on both sides of it are off, both together, and still agree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """A drawn circuit that ran in ngspice, too.

    Attributes
    ----------
    seed : int
    predicted, measured : float
        Error of its controls over the largest one; nan of a run that failed.
    predicted_time, measured_time : float
        Settling time in seconds; the predicted one nan, and the measured one good to some percent,
        where the spec has none.
    kept : (bool, bool)
        Whether it keeps the spec: as predicted, and in ngspice.
    agreed : bool
        Whether both keep it, or neither does, or both are close to its limit.
    """

    seed: int
    predicted: float
    measured: float
    predicted_time: float
    measured_time: float
    kept: tuple[bool, bool]
    agreed: bool

    @property
    def difference(self) -> float:
        """By how much the measured error is larger than the predicted one, as a share."""
        return self.measured / self.predicted - 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitYield:
    """Drawn circuits and a spec.

    Attributes
    ----------
    spec : Spec
    seeds : tuple of int
        One a circuit.
    errors : (S,) array
        Predicted error of the controls, over the largest one; nan where a circuit does not settle.
    noise : float
        Rms of the worst control over the largest one, of the nominal circuit; it counts with every
        error, as rms, where it is not nan for not known.
    settling_times : (S,) array
        In seconds; nan where the spec has none, where a circuit does not settle, and where it is
        not known.
    unknown : tuple of str
        Why the settling time of a circuit that settles is not known, a clause a circuit; empty
        where it is, or is not asked for. A spec with a settling time counts such a circuit as lost.
    found : Yield
        The share within the spec, with its interval.
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
    spots: tuple[Spot, ...]

    def __str__(self) -> str:
        return f"{self.spec}: {self.found}"

    @property
    def closest(self) -> int | None:
        """Which circuit keeps the spec best, or comes closest; None where none settles."""
        stable = np.flatnonzero(np.isfinite(self.errors))
        counted = noisy(self.errors, self.noise)
        excess = [self.spec.excess(counted[n], self.settling_times[n]) for n in stable]
        ranked = sorted(zip(excess, self.errors[stable], stable))
        return int(ranked[0][2]) if ranked else None


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
    """The share of drawn circuits that keep a spec.

    Parameters
    ----------
    backend : SpiceBackend
        Its level's tolerances are drawn from, where the level stands; all circuits have resistors
        of its series.
    circuit : Circuit
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    spec : Spec
        One without a settling time takes no transients: 0.1 s a circuit of the paper's car.
    samples : int
        Circuits, with seeds 0, 1, ...
    spots : int
        How many of them ngspice runs.

    Returns
    -------
    CircuitYield

    Raises
    ------
    NetworkError
        If the circuit has no emulation, or a settling time is asked of one whose transient is not
        run: a clocked one, or one of more than 6000 neurons.
    NgspiceMissing
        If there are to be spots and no ngspice is there.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import spec_of, yield_of
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro())
    >>> found = yield_of(backend, *backend.prepare(network), spec_of("error<20%"), samples=20)
    >>> print(found.found)  # of resistors of 1 %
    100.0 % (83.2 to 100.0 %, 20 of 20)
    """
    common = undrawn(backend, circuit, probe)
    missing = not_emulated(common)
    if missing is not None:
        raise NetworkError(f"yield: {missing}")
    timed = "settling_time" in spec.limits
    if timed and (why := untimed(common)):
        raise NetworkError(f"yield: no settling time is known of {spec}: {why}")
    if spots:
        find_ngspice()
    seeds = range(samples)
    drawn = specimens(common, seeds, progress=backend.progress)
    figures = [_figures(specimen, timed) for specimen in drawn]
    errors, times = (np.array([each[n] for each in figures]) for n in range(2))
    noise = control_noise(common)
    columns = {"error": noisy(errors, noise), "settling_time": times}
    passed = np.isfinite(errors) & (within(columns, spec.limits) if spec.limits else True)
    return CircuitYield(
        spec=spec,
        seeds=tuple(seeds),
        errors=errors,
        noise=noise,
        settling_times=times,
        unknown=tuple(each[2] for each in figures),
        found=Yield(passed=int(passed.sum()), count=samples),
        spots=_spots(backend, common, spec, errors, times, noise, spots),
    )


def _figures(specimen: Specimen, timed: bool) -> tuple[float, float, str]:
    """Error of the settled controls, settling time where it is asked for, and why it is unknown."""
    if not timed:
        return settled_error(specimen), np.nan, ""
    found = prediction_of(specimen)
    if isinstance(found, Unpredicted) or not found.stable or found.astray:
        return np.nan, np.nan, ""
    return found.control_error, found.settling_time, found.unknown


def _spots(
    backend: SpiceBackend,
    common: Specimen,
    spec: Spec,
    errors: np.ndarray,
    times: np.ndarray,
    noise: float,
    count: int,
) -> tuple[Spot, ...]:
    circuit, probe = common.circuit, common.probe
    seeds = _spread(errors, count)
    if not seeds:
        return ()
    backend.progress(f"ngspice, {len(seeds)} circuits")
    decks = sample_decks(circuit, backend.level, probe, seeds, base=common.deviations)
    timed, found = "settling_time" in spec.limits, []
    for seed, run in zip(seeds, measured_runs(backend, circuit, probe, decks)):
        error, time, done = np.nan, np.nan, np.inf
        if run is not None and not run.unsettled:
            error, time = run.control_error, run.settling_time() if timed else np.nan
            done = spec.excess(noisy(error, noise), time)
        said = spec.excess(noisy(errors[seed], noise), times[seed])
        spot = Spot(
            seed=seed,
            predicted=errors[seed],
            measured=error,
            predicted_time=times[seed],
            measured_time=time,
            kept=(bool(said <= 1), bool(done <= 1)),
            agreed=(said <= 1) == (done <= 1) or abs(said - 1) + abs(done - 1) < CLOSE,
        )
        found.append(spot)
    return tuple(found)


def _spread(errors: np.ndarray, count: int) -> Sequence[int]:
    """Circuits that settle, evenly from the best to the worst."""
    ranked = np.argsort(errors)[: int(np.isfinite(errors).sum())]  # nan is sorted to the end
    places = np.linspace(0, len(ranked) - 1, min(count, len(ranked))).round().astype(int)
    return [int(ranked[place]) for place in places]
