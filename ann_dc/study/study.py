"""Study: settings that vary, and metrics measured in every case."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import Any

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.study.execution import Here, execute
from ann_dc.study.metrics import DEFAULT, METRICS, metrics_of
from ann_dc.study.records import HEAD, SEED, TAIL, VERSIONS, Point, Row, Value, without_result
from ann_dc.study.sampling import Plan, Sampling, plan_of
from ann_dc.study.settings import (
    DRAWN,
    LEAST,
    WORDS,
    Subject,
    backend_of,
    check_name,
    check_together,
    check_value,
    family_of,
    is_drawn,
    plain,
    subject_of,
)
from ann_dc.study.store import Store
from ann_dc.study.table import Table
from ann_dc.study.tasks import Task, attempted
from ann_dc.study.work import Work, tasks, versions
from ann_dc.study.worker import stop_script
from ann_dc.summaries import summarised
from ann_dc.validation import Count, Index, Positive, checked
from ann_dc.yields import ends_of

LAYOUT = 2
"""Layout version in the identity of a study. A store with another version is not continued."""


@checked
@summarised(
    lambda self: {
        "title": self.title,
        "cases": len(self),
        "varied": ", ".join(self.vary),
        "metrics": ", ".join(metric.name for metric in self.metrics),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Study(Record):
    """Varied settings of a network and the metrics measured in every case.

    A case (`Point`) is one setting with one seed. Its result is one record (`Row`) of the table.

    Attributes
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network under study.
    vary : mapping of str to list, pair or Span
        Varied settings by name 'family.name', see `FAMILIES`. Of listed values every combination is
        taken. A range (low, high) is sampled. Default: none.
    metrics : sequence of str or Metric
        Measured quantities, see `METRICS`. Default: settling_time and control_error.
    fixed : mapping of str to Value
        Settings with the same value in every case. Default: none.
    samples : int
        Samples at every combination of listed values. A sample is a seed and, with ranges, a
        position in them. More than one requires a random quantity: a range, a random non-ideality,
        a tolerance or a random initial guess. Default 1.
    sampling : Sampling
        Method that fills the ranges. Default: random.
    seed : int
        Seed of all samples. Default 0.
    spec : mapping of metric to float or pair
        Largest value, or (smallest, largest), that a good sample satisfies. Default: no limits.
    curves : int
        Number of states over time stored per case. Default 0, which stores none.
    time_limit : float or None
        Wall-clock limit per case, in seconds. A batch has this limit for each of its cases plus one
        second. The first task of a process has ten more seconds, to load and compile. Default None,
        no limit.
    title : str
        Title. Default "Study of" and the name of the subject.

    Raises
    ------
    StudyError
        If a setting or metric does not exist, a list or range is empty, or all samples would be
        equal.

    Examples
    --------
    >>> import ann_dc
    >>> study = ann_dc.Study(
    ...     subject="double_integrator",
    ...     vary={"nonideal.mismatch": [0.01, 0.1]},
    ...     samples=20,
    ...     metrics=["settling_time", "control_error"],
    ... )
    >>> table = study.run(workers=0)
    >>> len(table), table.yield_of({"control_error": 0.1}).count
    (40, 40)
    """

    subject: str | OptimalControlProblem | Network | Subject
    vary: Mapping[str, Any] = field(default_factory=dict)
    metrics: Sequence[Any] = DEFAULT
    fixed: Mapping[str, Value] = field(default_factory=dict)
    samples: Count = 1
    sampling: Sampling = Sampling.RANDOM
    seed: Index = 0
    spec: Mapping[str, Any] = field(default_factory=dict)
    curves: Index = 0
    time_limit: Positive | None = None
    title: str = ""

    def __post_init__(self) -> None:
        subject = self.subject if isinstance(self.subject, Subject) else subject_of(self.subject)
        object.__setattr__(self, "subject", subject)
        object.__setattr__(self, "metrics", metrics_of(self.metrics))
        object.__setattr__(self, "title", self.title or f"Study of {subject.name}")
        self._check_settings(subject)
        self._check_samples()
        known = [metric.name for metric in self.metrics]
        taken = sorted({*known} & {*HEAD, *TAIL, *self.settings})
        if taken:
            raise StudyError(f"metrics: {taken[0]!r} is a column already; use another name")
        for name, limit in self.spec.items():
            if name not in known:
                raise StudyError(
                    f"spec: {name!r} is not measured; the metrics are {', '.join(known)}"
                )
            ends_of(limit)

    def _check_samples(self) -> None:
        """Raise `StudyError` if all samples are equal and no user-defined metric may draw."""
        plan, known = self.plan, {metric.value for metric in METRICS.values()}
        may_draw = any(metric.value not in known for metric in self.metrics)
        if self.samples <= 1 or plan.spans or may_draw:
            return
        each = [{name: value} for name, values in plan.listed.items() for value in values]
        if SEED in plan.listed or not any(is_drawn({**self.fixed, **one}) for one in [{}, *each]):
            what = "seed is listed" if SEED in plan.listed else "the study has no random settings"
            raise StudyError(
                f"samples: {what}, so {self.samples} samples would be {self.samples} equal "
                "records; omit samples, or add random settings: a range (low, high) of a "
                f"setting, {', '.join(DRAWN)}, tolerance.* or initial_guess.kind = 'random'"
            )

    def _check_settings(self, subject: Subject) -> None:
        for name in self.vary:
            check_name(subject, "vary", name)
        for name, value in self.fixed.items():
            check_name(subject, "fixed", name)
            check_value("fixed", name, value)
        for name in self.plan.spans:
            if name in (*WORDS, *LEAST):
                raise StudyError(f"vary: {name} takes words or whole numbers; list them")
        ends = {name: (span.low or span.high, span.high) for name, span in self.plan.spans.items()}
        for name, values in {**ends, **self.plan.listed}.items():
            for value in values:
                check_value("vary", name, value)
        words = self.plan.listed.get("run.backend", [self.fixed.get("run.backend")])
        others = dict.fromkeys(n for n in (*self.fixed, *self.vary) if n != "run.backend")
        backends = [str(word) if word else backend_of(others) for word in words]
        check_together("vary", self.vary, backends, self.fixed)
        check_together("fixed", self.fixed, backends, self.vary)

    @cached_property
    def plan(self) -> Plan:
        """Plan of the study: its cases, generated on demand."""
        return plan_of(
            self.vary,
            fixed=self.fixed,
            samples=self.samples,
            sampling=self.sampling,
            seed=self.seed,
        )

    def __len__(self) -> int:
        return len(self.plan)

    def points(self) -> Iterator[Point]:
        """Return an iterator over all cases, in order."""
        return self.plan.points()

    @property
    def settings(self) -> tuple[str, ...]:
        """Names of the settings of a case, fixed ones first."""
        return tuple(name for name in (*self.fixed, *self.vary) if name not in HEAD)

    @property
    def columns(self) -> tuple[str, ...]:
        """Column names: case and seed, settings, metrics, outcome, execution details."""
        return (*HEAD, *self.settings, *(metric.name for metric in self.metrics), *TAIL)

    def identity(self) -> dict[str, Any]:
        """Return everything that determines the records, as plain data."""
        families = {name: family_of(name) for name in self.settings}
        return plain(
            {
                "version": LAYOUT,
                "title": self.title,
                "subject": self._subject.identity(),
                "vary": {name: self._axis(name) for name in self.vary},
                "design": {"samples": self.samples, "sampling": self.sampling.value},
                "fixed": dict(self.fixed),
                "seed": self.seed,
                "metrics": {
                    m.name: {"unit": m.unit, "definition": m.definition} for m in self.metrics
                },
                "settings": {
                    name: {"unit": "", "says": family.description if family else ""}
                    for name, family in families.items()
                },
                "spec": dict(self.spec),
                "curves": self.curves,
            }
        )

    def _axis(self, name: str) -> Any:
        """Return the values or the range of a varied setting as plain data."""
        spans = self.plan.spans
        return spans[name]._asdict() if name in spans else self.plan.listed[name]

    @property
    def _subject(self) -> Subject:
        assert isinstance(self.subject, Subject)
        return self.subject

    @cached_property
    def work(self) -> Work:
        """Callable that executes the tasks of this study."""
        text = json.dumps(self.identity(), sort_keys=True).encode()
        return Work(
            subject=self._subject,
            metrics=tuple(self.metrics),
            curves=self.curves,
            key=hashlib.sha256(text).hexdigest(),
        )

    @checked
    def run(
        self,
        folder: str | os.PathLike[str] | None = None,
        *,
        workers: Index | None = None,
        executor: Executor | None = None,
        retry: bool = False,
        progress: Progress = silent,
    ) -> Table:
        """Run all unfinished cases and return the table of the study.

        Parameters
        ----------
        folder : path-like, optional
            Folder that stores records while the study runs: cases that differ in numbers only run
            in batches of about 3 s, others one by one. A study begun in this folder is continued.
            By default nothing is stored.
        workers : int, optional
            Number of processes. By default one per core; 0 uses this process only.
        executor : concurrent.futures.Executor, optional
            Executor that runs the tasks instead, for example that of a Dask cluster.
        retry : bool
            True to repeat cases without a result. Default False.
        progress : Progress
            Callable that receives one progress line at a time. Default: no output.

        Returns
        -------
        Table
            Records in the order of the cases. Ctrl-C ends the study early: ``table.stopped`` is
            then the reason, and the table contains the records that were stored until then.

        Raises
        ------
        StoreError
            If the folder contains another study or cannot be written.
        """
        stop_script()
        with (
            tempfile.TemporaryDirectory(prefix="ann_dc_study_") as temporary,
            Store.begin(
                temporary if folder is None else folder, self.identity(), self.columns
            ) as store,
        ):
            if retry:
                store.discard(store.failed())
            tally = execute(
                tasks(self.points(), store.finished()),
                self.work,
                store,
                executor=Here() if executor is None and workers == 0 else executor,
                workers=1 if workers == 0 else workers,
                limit=self.time_limit,
                common={VERSIONS: versions()},
                progress=progress,
            )
            return Table.of(store, stopped=tally.stopped)

    @checked
    def row(self, point: Index) -> Row:
        """Run one case, numbered from 0, in this process and return its values by column.

        Raises `StudyError` if the study has no case with this number.
        """
        case = next(islice(self.points(), point, None), None)
        if case is None:
            raise StudyError(f"point: there are {len(self)} cases from 0; got {point}")
        done = attempted(self.work, Task((case,)))
        if not done.finished:
            return without_result(case, done.outcome, done.message).row
        return {**done.finished[0].row, VERSIONS: versions()}
