"""Tasks of a study, and their execution: network runs, circuits and metrics of the cases.

Cases of equal wiring run as one batch, which has the same samples regardless of the executor and of
earlier runs. The remainder of an interrupted batch starts from the same base, so its records are
identical bit for bit. Problems, designs and circuits are built once per process.
"""

from __future__ import annotations

import platform
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy

import ann_dc
from ann_dc.backends.ode import METHODS, OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.spice.backend import simulate
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import ORDERS, FixedStep
from ann_dc.errors import AnnDcError, StudyError
from ann_dc.evaluation.variant_numbers import Numbers, numbers_of, require_one_wiring
from ann_dc.hardware.nonidealities.numbers import drawn_numbers
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.resources import one_thread
from ann_dc.study.circuit_samples import CircuitSample, EmulatedSample
from ann_dc.study.metrics import Metric
from ann_dc.study.realisation import (
    TOGETHER,
    Realisation,
    network_at,
    nonideal_stream,
    started,
    with_gains,
    with_nonidealities,
)
from ann_dc.study.records import (
    FAILED,
    MESSAGE,
    OUTCOME,
    POINT,
    SEED,
    Finished,
    Point,
    Row,
    Value,
    without_result,
)
from ann_dc.study.sample import BatchSample, RunSample, Sample, TwoLevelSample, word_of
from ann_dc.study.settings import ALONE, CIRCUITS, FAMILIES, Effect, Subject, backend_of, behind
from ann_dc.study.stored_trajectories import packed
from ann_dc.study.tasks import Task, sentence
from ann_dc.two_level.coordination import COORDINATORS
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain

COMPLETED = word_of(Outcome.COMPLETED)
"""Outcome of a run of a given duration."""
BATCH = 500
"""Largest number of cases in a batch."""
CURVES = 200
"""Number of recorded states over time that metrics read."""
NUMBERED = ("gains.", "nonideal.")
"""Setting families that may give each case different weights and time constants."""
SWITCHED_GAIN = 1e-3
"""Smallest gain of (33), for erratum S16."""


# ---- batches of cases ---------------------------------------------------------------------------


def _shared(point: Point) -> tuple[tuple[str, Value], ...]:
    """Return the settings common to all cases of a batch: all except network numbers."""
    numbers = tuple(f"{word}." for word, f in FAMILIES.items() if f.effect is Effect.NUMBERS)
    return tuple(sorted(item for item in point.setting.items() if not item[0].startswith(numbers)))


def _is_batched(point: Point) -> bool:
    """Return True if a case runs in generated code, in a batch."""
    setting = point.setting
    if backend_of(setting) in CIRCUITS:
        return False
    method = METHODS[str(setting.get("run.method", "compiled"))]
    follows = "nonideal.noise" in setting or setting.get("run.two_level", ALONE) != ALONE
    return setting.get("design.form") != "S16" and method.rows is not None and not follows


def tasks(points: Iterable[Point], finished: Set[int]) -> Iterator[Task]:
    """Yield tasks for all cases whose numbers are not in `finished`."""
    open_points = (point for point in points if point.number not in finished)
    batch: list[Point] = []
    for point in open_points:
        if not _is_batched(point):
            yield Task((point,))
        elif batch and (len(batch) == BATCH or _shared(batch[0]) != _shared(point)):
            yield Task(tuple(batch))
            batch = [point]
        else:
            batch.append(point)
    if batch:
        yield Task(tuple(batch))


# ---- records of a task --------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """Callable that executes tasks; it is sent to a process with every task.

    `curves` is the number of states stored per case. Shared designs are cached under `key`, a
    digest of the study.
    """

    subject: Subject
    metrics: tuple[Metric, ...]
    curves: int
    key: str

    def __call__(self, task: Task) -> list[Finished]:
        """Return the records of all cases of a task, in order."""
        with one_thread():
            samples = _samples(task.points, _made_for(self), self._recorded)
            return [self._finished(point, sample) for point, sample in zip(task.points, samples)]

    @property
    def _recorded(self) -> int:
        """Number of states over time to record."""
        needed = CURVES if any(metric.curves for metric in self.metrics) else 0
        return max(needed, self.curves)

    def _finished(self, point: Point, sample: Sample | Exception) -> Finished:
        if isinstance(sample, Exception):
            return without_result(point, FAILED, sentence(sample))
        try:
            row: Row = {POINT: point.number, SEED: point.seed, **point.setting}
            row |= {OUTCOME: sample.end.outcome, MESSAGE: sample.end.message}
            reasons = []
            for metric in self.metrics:
                row[metric.name], why = _measured(metric, sample)
                reasons += [why] if why else []
            said = sample.end.message
            if sample.end.outcome == COMPLETED or not said:  # a failure explains the rest
                row[MESSAGE] = "; ".join(filter(None, [said, *reasons[:1]]))
            return Finished(row, _packed_curves(sample, self.curves))
        except AnnDcError as error:
            return without_result(point, FAILED, sentence(error))


def _measured(metric: Metric, sample: Sample) -> tuple[Value, str]:
    """Return the value of a metric and, if it is missing, the reason."""
    try:
        value = metric.value(sample)
    except Exception as error:
        return float("nan"), f"{metric.name}: {sentence(error)}"
    return value.item() if isinstance(value, np.generic) else value, ""


@cache
def versions() -> str:
    """Return the versions of the software that computes the records."""
    parts = {
        "ann_dc": ann_dc.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
    return ", ".join(f"{name} {version}" for name, version in parts.items())


_MADE: dict[str, Realisation] = {}
_MAKING = threading.Lock()


def _made_for(work: Work) -> Realisation:
    """Return the realisation of the study; a process caches one."""
    with _MAKING:
        if work.key not in _MADE:
            _MADE.clear()
            _MADE[work.key] = Realisation(work.subject)
        return _MADE[work.key]


def _packed_curves(sample: Sample, most: int) -> bytes:
    """Return trajectories of neurons (user units) and residuals as ``.npz`` bytes.

    The result is empty if no states are requested or the sample has no trajectory.
    """
    if not most:
        return b""
    try:
        curves = sample.trajectory.curves
    except StudyError:
        return b""
    rows, checks = (_spread(len(time), most) for time in (curves.time, curves.residual_time))
    return packed(
        {
            "time": curves.time[rows],
            **{name: values[rows] for name, values in curves.neurons.items()},
            "residual_time": curves.residual_time[checks],
            "residuals": curves.residuals[checks],
        }
    )


def _spread(count: int, most: int) -> np.ndarray:
    """Return at most `most` indices, spread from first to last."""
    return np.unique(np.linspace(0, count - 1, min(most, count), dtype=int))


# ---- running ------------------------------------------------------------------------------------


def _samples(points: Sequence[Point], made: Realisation, recorded: int) -> list[Sample | Exception]:
    """Return the sample of every case, or the error that prevented it."""
    if all(map(_is_batched, points)):
        with suppress(AnnDcError):  # alone they run, or report the reason
            return _batched(points, made, recorded)
    return [_alone(point, made) for point in points]


def _alone(point: Point, made: Realisation) -> Sample | Exception:
    try:
        return _single(point, made)
    except Exception as error:
        return error


def _single(point: Point, made: Realisation) -> Sample:
    """Run one case without a batch."""
    word, setting = backend_of(point.setting), point.setting
    if word == "emulation":
        return EmulatedSample(point=point, made=made)
    if word == "spice":
        built = made.built(setting)
        deviations = built.deviations(setting, point.seed)
        run = simulate(built.backend, built.circuit, built.probe, deviations)
        return CircuitSample(point=point, made=made, run=run)
    designed = made.designed(setting)
    network = network_at(designed.network, setting, point.seed)
    if setting.get("run.two_level", ALONE) != ALONE:
        return _on_two_levels(point, made, network)
    backend: Any = replace(_backend(setting), curves=0)
    if isinstance(backend, OdeBackend) and setting.get("design.form") == "S16":
        gain = OracleGain(settled=made.settled(setting), low=SWITCHED_GAIN)
        backend = OracleBackend(ode=backend, gain=gain)
    return RunSample(point=point, made=made, run=backend.run(network))


def _on_two_levels(point: Point, made: Realisation, network: Network) -> Sample:
    """Run one case on two levels, with the coordinator chosen at the designed solution."""
    settling = Settling(tolerance=behind(point.setting, "run").get("tolerance", 1e-6))
    choose = COORDINATORS[str(point.setting["run.two_level"])]
    upper, _ = choose(network, made.designed(point.setting).settled)
    layer = TwoLevels(network, upper=upper)
    run = layer.run(tolerance=settling.confirmed)
    return TwoLevelSample(point=point, made=made, run=replace(run, tolerance=settling.tolerance))


def _backend(setting: Mapping[str, Value]) -> OdeBackend | RecurrentBackend:
    """Return the backend that a setting describes."""
    given: dict[str, Any] = behind(setting, "run")
    word = given.get("backend", "ode")
    settling = Settling(tolerance=given.get("tolerance", 1e-6))
    options: dict[str, Any] = {"settling": settling}
    if "limit" in given:
        options["limit"] = given["limit"]
    if word == "recurrent":
        if "order" in given:
            options["order"] = ORDERS[given["order"]]
        if given.get("step", "adaptive") != "adaptive":
            options["step"] = FixedStep(step=given["step"])
        return RecurrentBackend(**options)
    if "method" in given:
        options["method"] = METHODS[given["method"]]
    if "duration" in given:
        options["duration"] = given["duration"]
    return OdeBackend(verify=False, threads=1, **options)


def _batched(points: Sequence[Point], made: Realisation, recorded: int) -> list[Sample | Exception]:
    """Run cases of one wiring as a batch, and those with a changed wiring separately."""
    designed, backend = made.designed(points[0].setting).network, _backend(points[0].setting)
    samples: dict[int, Sample | Exception] = {}
    numbers, chosen = _numbers(points, designed)
    if chosen:
        cases = [points[i] for i in chosen]
        batch = replace(backend, curves=recorded).run_batch(
            designed, _inputs(cases), _starts(cases, designed), numbers
        )
        for index, i in enumerate(chosen):
            index = index if len(batch) > 1 else 0  # points that differ in nothing that runs
            samples[i] = BatchSample(point=points[i], made=made, batch=batch, index=index)
    return [samples[i] if i in samples else _alone(p, made) for i, p in enumerate(points)]


def _inputs(points: Sequence[Point]) -> dict[str, np.ndarray]:
    """Return the inputs (B,) by name."""
    names = behind(points[0].setting, "input")
    return {n: np.array([p.setting[f"input.{n}"] for p in points], float) for n in names}


def _starts(points: Sequence[Point], network: Network) -> np.ndarray | None:
    """Return initial states (B, n); None if all use the interpolated initial guess."""
    if not behind(points[0].setting, "initial_guess"):
        return None
    lines = moved_starts(network, input_batch(network, _inputs(points)))
    lines = np.broadcast_to(lines, (len(points), network.size))
    return np.stack(
        [started(x, behind(p.setting, "initial_guess"), p.seed) for x, p in zip(lines, points)]
    )


def _numbers(points: Sequence[Point], designed: Network) -> tuple[Numbers | None, list[int]]:
    """Return the numbers of the cases with unchanged wiring, and their indices."""
    if not any(name.startswith(NUMBERED) for name in points[0].setting):
        return None, [*range(len(points))]
    groups: dict[tuple, list[int]] = {}
    for i, point in enumerate(points):
        setting = tuple(item for item in point.setting.items() if item[0].startswith(NUMBERED))
        groups.setdefault(setting, []).append(i)
    seeds = [point.seed for point in points]
    drawn = []
    for setting, members in groups.items():
        drawn += _drawn_members(designed, dict(setting), members, seeds)
    if not drawn:
        return None, []
    indices = np.array([i for members, _ in drawn for i in members], int)
    order = np.argsort(indices)
    weights = np.concatenate([numbers.weights for _, numbers in drawn])[order]
    rates = np.concatenate([numbers.rates for _, numbers in drawn])[order]
    return Numbers(weights=weights, rates=rates), indices[order].tolist()


def _drawn_members(
    designed: Network, setting: Mapping[str, Value], members: list[int], seeds: Sequence[int]
) -> list[tuple[list[int], Numbers]]:
    """Return the numbers of cases of one setting; cases without numbers are omitted."""
    try:
        return [(members, _drawn(designed, setting, [seeds[i] for i in members]))]
    except AnnDcError:  # of one of them, or of all
        alone = [[member] for member in members] if len(members) > 1 else []
        return [pair for one in alone for pair in _drawn_members(designed, setting, one, seeds)]


def _drawn(designed: Network, own: Mapping[str, Value], seeds: Sequence[int]) -> Numbers:
    """Return the numbers of cases with equal gains and equal sizes of non-idealities.

    Raises `NetworkError` or `StudyError` if the wiring changes or a value is out of range.
    """
    network, sizes = with_gains(designed, behind(own, "gains")), behind(own, "nonideal")
    require_one_wiring(designed, network, 1)
    if {*sizes} <= {*TOGETHER}:
        streams = [nonideal_stream(seed, TOGETHER[0]) for seed in seeds]
        weights, time_constants = (sizes.get(name, 0.0) for name in TOGETHER)
        return drawn_numbers(network, streams, weights=weights, time_constants=time_constants)
    networks = [with_nonidealities(network, sizes, seed) for seed in seeds]
    require_one_wiring(designed, networks[0], 1)
    return numbers_of(networks)
