"""Problems, designs and circuits of the cases of a study, each built once.

Cases that differ only in numbers use the same ones. A study therefore needs one design per problem
and form, and one circuit per level.

Each random quantity has a separate stream, derived from the seed of the case and the name of the
non-ideality. One error therefore does not change when the size of another changes.
"""

from __future__ import annotations

import math
import threading
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, FORMS, Form
from ann_dc.errors import StudyError
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE, GainRule
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.procedure import Design
from ann_dc.hardware import nonidealities
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import cost_of
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.e_series import SERIES
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.buildable import clamped_full_scale
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, KINDS, PreconditionerKind
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.waveforms import Waveform
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solver import design, synthesize
from ann_dc.study.model_levels import level_of
from ann_dc.study.records import Value
from ann_dc.study.settings import ALONE, Subject, behind, chosen, is_built

# ---- network of a case: designed, with other gains, inputs, initial guess and non-idealities ----

TOGETHER = ("mismatch", "time_constants")
"""Non-idealities that change only numbers and can be drawn for many cases at once."""
SPREAD = 0.1
"""Default standard deviation of a random initial guess, as a fraction of a neuron's scale."""


def stream(seed: int, name: str) -> int:
    """Return the seed of a named random quantity, from the seed of the case.

    >>> stream(1, "mismatch") != stream(1, "offset")
    True
    """
    entropy = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return int(entropy.generate_state(1, np.uint64)[0] >> 1)


NONIDEALITIES: dict[str, Callable[[Network, float, int], Network]] = {
    "bits": lambda network, value, seed: nonidealities.quantised(network, bits=value),
    "mismatch": lambda network, value, seed: nonidealities.mismatch(network, value, seed=seed),
    "time_constants": lambda network, value, seed: nonidealities.detuned(network, value, seed=seed),
    "gain_error": lambda network, value, seed: nonidealities.gain_error(network, value, seed=seed),
    "offset": lambda network, value, seed: nonidealities.offset(network, value, seed=seed),
    "leak": lambda network, value, seed: nonidealities.leak(network, value),
    "extra_pole": lambda network, value, seed: nonidealities.extra_pole(network, value),
    "slew": lambda network, value, seed: nonidealities.slew(network, value),
    "saturation": lambda network, value, seed: nonidealities.saturation(network, value),
}
"""Functions by non-ideality, in a valid order of application."""


LEVELS = "run.two_level"
"""Setting whose runs need a form of the equations with q_0 as a neuron."""
HELD, MOST_SAMPLES = 0.1, 20_000
"""Time for which a sample of noise is held, in the fastest time constants, and their number."""


def with_gains(network: Network, factors: Mapping[str, float]) -> Network:
    """Return the network with some gains multiplied by positive factors.

    Names of factors are ``rho`` or ``rho.<dual neuron>``, ``tau`` or ``tau.<population or
    neuron>``, and ``coarse``. Raises `StudyError` if a factor is not positive, or for ``coarse``
    without coarse-level neurons.
    """
    if not factors:
        return network
    for name, factor in factors.items():
        if not 0 < float(factor) < float("inf"):
            raise StudyError(f"gains.{name}: a factor is a positive number, got {factor!r}")
    if "coarse" in factors:
        if not isinstance(network.preconditioner, Multilevel):
            raise StudyError(
                "gains.coarse: the preconditioner has no coarse levels; set "
                "design.preconditioner to multilevel"
            )
        gains = tuple(factors["coarse"] * grid for grid in network.preconditioner.gains)
        network = replace(network, preconditioner=replace(network.preconditioner, gains=gains))
    cell = network.cell
    of_path = {dual.path: _product(factors, "rho", f"rho.{dual.neuron}") for dual in cell.duals}
    connections = tuple(
        replace(c, weight=of_path[c.name] * np.asarray(c.weight))
        if of_path.get(c.name, 1.0) != 1.0
        else c
        for c in cell.connections
    )
    neurons = []
    for neuron in cell.neurons:
        factor = _product(factors, "tau", f"tau.{neuron.population}", f"tau.{neuron.name}")
        neurons.append(replace(neuron, tau=factor * neuron.tau) if factor != 1.0 else neuron)
    return replace(network, cell=replace(cell, neurons=tuple(neurons), connections=connections))


def _product(factors: Mapping[str, float], *names: str) -> float:
    """Return the product of the factors with any of these names."""
    return math.prod(factors.get(name, 1.0) for name in dict.fromkeys(names))


def with_inputs(network: Network, inputs: Mapping[str, Any]) -> Network:
    """Return the network with other inputs and the initial state moved accordingly."""
    if not inputs:
        return network
    start = moved_starts(network, input_batch(network, inputs))[0]
    return network.with_inputs(dict(inputs)).with_start(start)


def started(start: np.ndarray, given: Mapping[str, Any], seed: int) -> np.ndarray:
    """Return the initial state (n,) of a case from the interpolated one.

    The setting ``kind`` is line, zero or random. ``spread`` is the standard deviation of the random
    one in network units, in which a neuron is near one. Its default is `SPREAD`.
    """
    kind = given.get("kind", "random" if "spread" in given else "line")
    if kind == "zero":
        return np.zeros_like(start)
    if kind == "line":
        return start
    rng = np.random.default_rng(stream(seed, "start"))
    return start + given.get("spread", SPREAD) * rng.standard_normal(start.size)


def with_nonidealities(
    network: Network, sizes: Mapping[str, float], seed: int, duration: float = 0.0
) -> Network:
    """Return the network with non-idealities of the given sizes, drawn from the seed.

    The ``duration`` in network time is that of the noise.
    """
    for name, apply in NONIDEALITIES.items():
        if name in sizes:
            network = apply(network, float(sizes[name]), nonideal_stream(seed, name))
    if sizes.get("noise"):
        return noisy(network, sizes["noise"], nonideal_stream(seed, "noise"), duration)
    return network


def noisy(network: Network, density: float, seed: int, duration: float) -> Network:
    """Return the network with white noise at every neuron: tau x' = sum w s + density xi.

    The noise is held for `HELD` of the fastest time constant of a neuron, with the variance of
    white noise over that time; its samples are drawn from the seed. Raises `StudyError` if the
    duration has more than `MOST_SAMPLES` of them.
    """
    interval = HELD / float(network.layout.rates.max())
    count = math.ceil(duration / interval)
    if count > MOST_SAMPLES:
        raise StudyError(
            f"nonideal.noise: a run of {duration:g} has {count:,} samples of noise, above "
            f"{MOST_SAMPLES:,}; use a shorter run.duration"
        )
    network, rng = nonidealities.noise(network, density), np.random.default_rng(seed)
    times, size = interval * np.arange(count), (count, network.stages)
    added = [name for name in network.cell.inputs if name.startswith("noise.")]
    samples = {name: rng.standard_normal(size) / math.sqrt(interval) for name in added}
    waveforms = {n: Waveform(times=times, values=v, hold="previous") for n, v in samples.items()}
    return network.with_inputs(waveforms)


def nonideal_stream(seed: int, name: str) -> int:
    """Return the seed of a non-ideality from the seed of the case.

    Weights and time constants use separate streams within one seed.
    """
    return stream(seed, "nonideal" if name in TOGETHER else f"nonideal.{name}")


def network_at(designed: Network, setting: Mapping[str, Any], seed: int) -> Network:
    """Return the network of a case from the designed network.

    Raises `StudyError` or `NetworkError` if a value is out of range.
    """
    network = with_inputs(with_gains(designed, behind(setting, "gains")), behind(setting, "input"))
    if given := behind(setting, "initial_guess"):
        network = network.with_start(started(network.start_state, given, seed))
    duration = float(setting.get("run.duration", 0.0))
    return with_nonidealities(network, behind(setting, "nonideal"), seed, duration)


# ---- problems, designs and circuits of the cases, each built once -------------------------------

MOST_CACHED = 16
"""Largest number of cached problems, designs, circuits and references, each, per process."""
EXACT = OdeBackend(settling=Settling(tolerance=1e-9), verify=False)
"""Backend of the reference runs."""
BUILDABLE = (PreconditionerKind.DIAGONAL,)
"""Default preconditioner for circuits; every op amp can realise it."""
Made = TypeVar("Made")


class Designed(NamedTuple):
    """Network with fixed gains, and the equilibrium (n,) found by the design.

    If the subject is a network, the initial state replaces the equilibrium.
    """

    network: Network
    settled: np.ndarray


class Built(NamedTuple):
    """Circuit of a design; the probe is a run of the ideal network for the amplitude scaling."""

    circuit: Circuit
    level: Level
    probe: Trajectory
    backend: SpiceBackend

    def deviations(self, setting: Mapping[str, Value], seed: int) -> Deviations:
        """Return the part errors: series rounding, plus random errors from tolerances."""
        off, known = self.backend.deviations(self.circuit), self.circuit.parameters
        if not chosen(setting, "tolerance"):
            return off
        return combined(known, off, draw(known, self.level.tolerances, seed))

    @property
    def power(self) -> float:
        """Power of op amps and multipliers in watts; nan if undefined by the level."""
        deck = self.backend.deck(self.circuit, self.probe, {})
        loads = load_power(self.circuit, self.level, self.probe.final)
        return cost_of(deck.parts, self.level.datasheet, float("nan"), loads).power


@dataclass(frozen=True, eq=False)
class Realisation:
    """Objects built for a study, cached while a process works on it."""

    subject: Subject
    _made: dict[str, dict] = field(default_factory=dict)
    _making: Any = field(default_factory=threading.RLock)

    def _cached(self, name: str, setting: Mapping[str, Any], make: Callable[[], Made]) -> Made:
        """Return the cached object for these values, or build and cache it."""
        key = tuple(sorted(setting.items()))
        with self._making:
            shelf = self._made.setdefault(name, {})
            if key not in shelf:
                made = make()
                if len(shelf) >= MOST_CACHED:
                    shelf.pop(next(iter(shelf)))
                shelf[key] = made
            return shelf[key]

    def problem(self, setting: Mapping[str, Value]) -> OptimalControlProblem | None:
        """Return the problem of the design; None if the subject is a network."""
        if self.subject.problem is None:
            return None
        given = behind(setting, "problem")
        return self._cached("problem", given, lambda: self.subject.declared(given))

    def designed(self, setting: Mapping[str, Value]) -> Designed:
        """Return the designed network of a setting.

        Raises `StudyError` if the design did not settle.
        """
        problem = self.problem(setting)
        if problem is None:
            return Designed(self.subject.wired, self.subject.wired.start_state)
        given = chosen(setting, "problem", "design") | {"": is_built(setting)}
        given |= {LEVELS: setting.get(LEVELS, ALONE)}
        kinds = BUILDABLE if is_built(setting) else ALL_KINDS
        return self._cached("form", given, lambda: self._in_form(problem, given, kinds))

    def _in_form(
        self,
        problem: OptimalControlProblem,
        given: Mapping[str, Any],
        kinds: tuple[PreconditionerKind, ...],
    ) -> Designed:
        """Return the network of a problem; a form with errata uses the corrected gains."""
        form = FORMS[str(given.get("design.form", "corrected"))]
        if given[LEVELS] != ALONE:  # every stage has a solution of its own
            form = replace(form, start_is_neuron=True)
        lender = form.designable
        factors = {n: v for n, v in behind(given, "design").items() if n != "form"}
        lent = {**given, "design.form": str(lender)}
        made = self._cached(
            "design", lent, lambda: _settled_design(problem, lender, factors, kinds)
        )
        network = made.network
        if form != lender:
            network = apply_gains(synthesize(decompose(problem, form)), made.gains)
        return Designed(network, made.state)

    def built(self, setting: Mapping[str, Value]) -> Built:
        """Return the circuit of a setting at its model level, prepared and scaled.

        Raises `NetworkError` if the network does not settle or the level cannot realise it.
        """
        parts = chosen(setting, "problem", "design", "gains", "input", "circuit", "tolerance")
        parts |= {name: setting[name] for name in ("run.duration",) if name in setting}
        return self._cached("circuit", parts, lambda: self._build(setting))

    def _build(self, setting: Mapping[str, Value]) -> Built:
        circuit = behind(setting, "circuit")
        network = self.nominal(setting)
        level = clamped_full_scale(network, level_of(circuit, behind(setting, "tolerance")))
        series = SERIES[str(circuit.get("series", "exact"))]
        duration = behind(setting, "run").get("duration")
        backend = SpiceBackend(level=level, series=series, require_stable=False, duration=duration)
        if "bandwidth_margin" in circuit:
            backend = replace(backend, bandwidth_margin=float(circuit["bandwidth_margin"]))
        built, probe = backend.prepare(network)
        return Built(built, level, probe, backend)

    def nominal(self, setting: Mapping[str, Value]) -> Network:
        """Return the network of a setting without non-idealities, initially interpolated."""
        network = with_gains(self.designed(setting).network, behind(setting, "gains"))
        return with_inputs(network, behind(setting, "input"))

    def settled(self, setting: Mapping[str, Value]) -> np.ndarray:
        """Return the equilibrium (n,) of the nominal network, for the oracle gain of (33)."""
        if not behind(setting, "input"):
            return self.designed(setting).settled
        given = chosen(setting, "problem", "design", "gains", "input")
        return self._cached(
            "settled", given, lambda: EXACT.run(self.nominal(given)).trajectory.final
        )

    def right_controls(self, setting: Mapping[str, Value]) -> tuple[np.ndarray, float]:
        """Return the settled controls (c,) of the nominal network and their size.

        The controls are in network units, and nan if the network does not settle. Errors are
        relative to the size, see `size_of`. For a form with errata the reference is the corrected
        form. Raises `StudyError` if inputs of the network change over time.
        """
        moving = [n for n in self.subject.wired.waveforms if f"input.{n}" not in setting]
        if moving:
            raise StudyError(
                f"inputs {', '.join(moving)} change over time, so the optimum is not constant; "
                "use tracking_error"
            )
        given = chosen(setting, "problem", "input")
        if "design.preconditioner" in setting:
            given["design.preconditioner"] = setting["design.preconditioner"]
        if is_built(setting):  # whose design it shares
            given["circuit.level"] = "macro"

        def settle() -> tuple[np.ndarray, float]:
            run = EXACT.run(self.nominal(given))
            controls, size = run.trajectory.control_values[-1], run.trajectory.control_size
            return controls if run.status.settled else np.full(controls.shape, np.nan), size

        return self._cached("correct controls", given, settle)


def _settled_design(
    problem: OptimalControlProblem,
    form: Form,
    factors: dict[str, Value],
    kinds: tuple[PreconditionerKind, ...],
) -> Design:
    """Return the design of a problem in a designable form.

    Raises `StudyError` if it did not settle.
    """
    if "preconditioner" in factors:
        kinds = (KINDS[str(factors.pop("preconditioner"))],)
    source = problem if form == CORRECTED else synthesize(decompose(problem, form))
    made = design(source, preconditioner=kinds, gain_rule=_gain_rule(kinds, factors))
    if not made.settled:
        reason = f": {made.first.ended}" if made.first.ended else ""
        raise StudyError(f"design: the gain-scheduled run did not settle{reason}")
    return made


def _gain_rule(
    kinds: tuple[PreconditionerKind, ...], given: Mapping[str, Value]
) -> GainRule | None:
    """Return a gain rule with the given factors; None without factors."""
    if not given:
        return None
    if len(kinds) > 1:
        raise StudyError(
            f"design.{next(iter(given))}: a factor of the gain rule needs "
            f"design.preconditioner, one of {', '.join(KINDS)}"
        )
    kind = next(iter(kinds))
    base = DIAGONAL_RULE if kind is PreconditionerKind.DIAGONAL else GainRule()
    return replace(base, kind=kind, **given)
