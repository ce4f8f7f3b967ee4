"""Execution of a task: network runs, circuits and metrics of its cases.

A task returns one record per case. Problems, designs and circuits common to several cases are built
once per process.
"""

from __future__ import annotations

import platform
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.recurrent.rules.steps import FixedStep
from ann_dc.backends.settling import Settling
from ann_dc.backends.spice.backend import simulate
from ann_dc.errors import AnnDcError, StudyError
from ann_dc.evaluation.variant_numbers import Numbers, numbers_of
from ann_dc.evaluation.variant_wiring import require_one_wiring
from ann_dc.hardware.nonidealities.drawing import drawn_numbers
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.resources import one_thread
from ann_dc.study.circuit_samples import CircuitSample, EmulatedSample
from ann_dc.study.metrics import Metric
from ann_dc.study.planning import is_batched
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
from ann_dc.study.sample import BatchSample, RunSample, Sample
from ann_dc.study.settings import ORDERS, Subject, backend_of, behind
from ann_dc.study.stored_trajectories import packed
from ann_dc.study.tasks import Task
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain

CURVES = 200
"""Number of recorded states over time that metrics read."""
NUMBERED = ("gains.", "nonideal.")
"""Setting families that may give each case different weights and time constants."""
SWITCHED_GAIN = 1e-3
"""Smallest gain of (33), for erratum S16."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """Callable that executes tasks; it is sent to a process with every task.

    Attributes
    ----------
    curves : int
        States stored per case; 0 for none.
    key : str
        Digest of the study, under which shared designs are cached.
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
            for metric in self.metrics:
                row[metric.name], why = _measured(metric, sample)
                row[MESSAGE] = row[MESSAGE] or why
            return Finished(row, _kept_curves(sample, self.curves))
        except AnnDcError as error:
            return without_result(point, FAILED, sentence(error))


def _measured(metric: Metric, sample: Sample) -> tuple[Value, str]:
    """Return the value of a metric and, if it is missing, the reason."""
    try:
        value = metric.value(sample)
    except Exception as error:
        return float("nan"), f"{metric.name}: {sentence(error)}"
    return value.item() if isinstance(value, np.generic) else value, ""


def sentence(error: Exception) -> str:
    """Return the description of an error on one line."""
    said = " ".join(str(error).split())
    return said if isinstance(error, AnnDcError) else f"{type(error).__name__}: {said}"


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


def _kept_curves(sample: Sample, most: int) -> bytes:
    """Return trajectories of neurons (user units) and residuals as ``.npz`` bytes.

    The result is empty if no states are requested or the sample has no trajectory.
    """
    if not most:
        return b""
    try:
        curves = sample.trajectory.curves
    except StudyError:
        return b""
    rows, looks = (_spread(len(time), most) for time in (curves.time, curves.residual_time))
    return packed(
        {
            "time": curves.time[rows],
            **{name: values[rows] for name, values in curves.neurons.items()},
            "residual_time": curves.residual_time[looks],
            "residuals": curves.residuals[looks],
        }
    )


def _spread(count: int, most: int) -> np.ndarray:
    """Return at most `most` indices, spread from first to last."""
    return np.unique(np.linspace(0, count - 1, min(most, count), dtype=int))


# ---- running ------------------------------------------------------------------------------------


def _samples(points: Sequence[Point], made: Realisation, recorded: int) -> list[Sample | Exception]:
    """Return the sample of every case, or the error that prevented it."""
    if all(map(is_batched, points)):
        with suppress(AnnDcError):  # alone they run, or say why not
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
    backend: Any = replace(_backend(setting), curves=0)
    if isinstance(backend, OdeBackend) and setting.get("design.form") == "S16":
        gain = OracleGain(settled=made.settled(setting), low=SWITCHED_GAIN)
        backend = OracleBackend(ode=backend, gain=gain)
    return RunSample(point=point, made=made, run=backend.run(network))


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
    return OdeBackend(verify=False, threads=1, **options)


def _batched(points: Sequence[Point], made: Realisation, recorded: int) -> list[Sample | Exception]:
    """Run cases of one wiring as a batch, and those with a changed wiring separately."""
    designed, backend = made.designed(points[0].setting).network, _backend(points[0].setting)
    found: dict[int, Sample | Exception] = {}
    numbers, chosen = _numbers(points, designed)
    if chosen:
        own = [points[i] for i in chosen]
        batch = replace(backend, curves=recorded).run_batch(
            designed, _inputs(own), _starts(own, designed), numbers
        )
        for index, i in enumerate(chosen):
            index = index if len(batch) > 1 else 0  # points that differ in nothing that runs
            found[i] = BatchSample(point=points[i], made=made, batch=batch, index=index)
    return [found[i] if i in found else _alone(p, made) for i, p in enumerate(points)]


def _inputs(points: Sequence[Point]) -> dict[str, np.ndarray]:
    """Return the inputs (B,) by name."""
    names = behind(points[0].setting, "input")
    return {n: np.array([p.setting[f"input.{n}"] for p in points], float) for n in names}


def _starts(points: Sequence[Point], network: Network) -> np.ndarray | None:
    """Return initial states (B, n); None if all use the interpolated initial guess."""
    if not behind(points[0].setting, "start"):
        return None
    lines = moved_starts(network, input_batch(network, _inputs(points)))
    lines = np.broadcast_to(lines, (len(points), network.size))
    return np.stack([started(x, behind(p.setting, "start"), p.seed) for x, p in zip(lines, points)])


def _numbers(points: Sequence[Point], designed: Network) -> tuple[Numbers | None, list[int]]:
    """Return the numbers of the cases with unchanged wiring, and their indices."""
    if not any(name.startswith(NUMBERED) for name in points[0].setting):
        return None, [*range(len(points))]
    groups: dict[tuple, list[int]] = {}
    for i, point in enumerate(points):
        own = tuple(item for item in point.setting.items() if item[0].startswith(NUMBERED))
        groups.setdefault(own, []).append(i)
    found = []
    for own, members in groups.items():
        seeds = [points[i].seed for i in members]
        try:
            found.append((members, _drawn(designed, dict(own), seeds)))
        except AnnDcError:  # of one of them, or of all
            found += list(_each_drawn(designed, dict(own), members, seeds))
    kept = np.array([i for members, _ in found for i in members], int)
    if not found:
        return None, []
    order = np.argsort(kept)
    weights = np.concatenate([numbers.weights for _, numbers in found])[order]
    rates = np.concatenate([numbers.rates for _, numbers in found])[order]
    return Numbers(weights=weights, rates=rates), kept[order].tolist()


def _each_drawn(
    designed: Network, own: Mapping[str, Value], members: Sequence[int], seeds: Sequence[int]
) -> Iterator[tuple[list[int], Numbers]]:
    """Yield the numbers case by case; cases without numbers are omitted and run alone."""
    for member, seed in zip(members, seeds):
        with suppress(AnnDcError):
            yield [member], _drawn(designed, own, [seed])


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
