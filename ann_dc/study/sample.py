"""Result of a case as read by metrics, independent of the backend.

Samples that ran as networks, alone or in a batch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.run import Run
from ann_dc.backends.settling import control_settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import certificate_of
from ann_dc.study.realisation import Built, Realisation, network_at
from ann_dc.study.records import Point, Value
from ann_dc.study.settings import behind, is_built


def word_of(outcome: Outcome) -> str:
    """Return an outcome in lower-case words.

    >>> word_of(Outcome.LEFT_DOMAIN)
    'left domain'
    """
    return outcome.name.lower().replace("_", " ")


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample(ABC):
    """Case of a study with its result.

    Attributes
    ----------
    made : Realisation
        Cached problem, design and circuit of the case.
    """

    point: Point
    made: Realisation

    @property
    def setting(self) -> Mapping[str, Value]:
        """Values of the settings of the case."""
        return self.point.setting

    @property
    @abstractmethod
    def outcome(self) -> str:
        """Outcome in one or two words."""

    @property
    @abstractmethod
    def message(self) -> str:
        """Outcome in one sentence."""

    @property
    @abstractmethod
    def network(self) -> Network:
        """Network that ran, with its non-idealities, or the emulation of a circuit."""

    @property
    @abstractmethod
    def state(self) -> np.ndarray:
        """Final state (n,) in units of `network`."""

    @property
    @abstractmethod
    def controls(self) -> np.ndarray:
        """Final live controls (c,) in units of the designed network."""

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit of the residual; nan if undefined."""
        return float("nan")

    @property
    def control_settling_time(self) -> float:
        """Network time (tau = 1) of the last exit of the controls.

        Raises `StudyError` if no trajectory was recorded.
        """
        return control_settling(self.trajectory)

    @property
    def steps(self) -> int | None:
        """Number of steps of the integration or recurrence; None for a circuit."""
        return None

    @property
    def settling_steps(self) -> int | None:
        """Number of steps up to the last exit; None if the sample did not settle."""
        return None

    @property
    def seconds(self) -> float:
        """Settling time of the circuit in seconds; nan if no circuit is built."""
        return float("nan")

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory.

        Raises `StudyError` if no trajectory was recorded.
        """
        raise StudyError("nothing was recorded over time")

    @property
    def settled(self) -> bool:
        """True if the sample settled."""
        return self.outcome == word_of(Outcome.SETTLED)

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues of `network` at the final state.

        Raises `NetworkError` if they cannot be computed.
        """
        return spectrum(self.network, self.state)

    @cached_property
    def resting(self) -> Spectrum:
        """Eigenvalues of `network` at the equilibrium near the designed point.

        They do not depend on the run. Raises `StudyError` if non-idealities add neurons and
        `NetworkError` if the equilibrium does not exist.
        """
        near = self.made.designed(self.setting).settled
        if near.shape != (self.network.size,):
            raise StudyError(
                "its non-idealities add neurons, so that the designed point is none of its"
            )
        return spectrum(self.network, equilibrium(self.network, near))

    @cached_property
    def start(self) -> np.ndarray:
        """Initial state (n,) in units of `network`."""
        return self.network.start_state

    @cached_property
    def right_controls(self) -> tuple[np.ndarray, float]:
        """Settled controls (c,) of the ideal network for the same inputs, and their size.

        Raises `StudyError` if a form with errata has other live controls.
        """
        right, size = self.made.right_controls(self.setting)
        if self.controls.shape != right.shape:
            raise StudyError("the form has other live controls than the corrected one")
        return right, size

    @cached_property
    def built(self) -> Built:
        """Circuit of the case.

        Raises `StudyError` if the study does not define a circuit.
        """
        if not is_built(self.setting):
            raise StudyError("no circuit is built; set circuit.level")
        return self.made.built(self.setting)

    @cached_property
    def problem(self) -> OptimalControlProblem:
        """Problem with the inputs of the case.

        Raises `StudyError` if the subject is a network.
        """
        declared = self.made.problem(self.setting)
        if declared is None:
            raise StudyError("a network without a problem has no cost and no certificate")
        return _with_inputs(declared, behind(self.setting, "input"))

    @cached_property
    def certificate(self) -> Certificate:
        """Optimality certificate of the end, computed from the problem alone.

        Raises `StudyError` if the subject has no problem.
        """
        return certificate_of(self.problem, *self.ideal)

    @property
    @abstractmethod
    def ideal(self) -> tuple[Network, np.ndarray]:
        """Ideal network with the inputs of the case, and the final state in its units."""


def _with_inputs(
    problem: OptimalControlProblem, inputs: Mapping[str, Value]
) -> OptimalControlProblem:
    """Return the problem with other inputs of its network."""
    if not inputs:
        return problem
    states = [str(s) for s in problem.states]
    ends: dict[str, list[Any]] = {"q_0": [*problem.q_0], "q_d": [*(problem.q_d or ())]}
    further: dict[str, Any] = {}
    for name, value in inputs.items():
        end, _, component = name.partition(".")
        if component in states and end in ends:
            ends[end][states.index(component)] = value
        else:
            further[name] = value
    return problem.with_inputs(**ends, **further)


@dataclass(frozen=True, kw_only=True, eq=False)
class _NetworkSample(Sample):
    """Network that ran."""

    @cached_property
    def _ran(self) -> Network:
        designed = self.made.designed(self.setting).network
        return network_at(designed, self.setting, self.point.seed)

    @property
    def network(self) -> Network:
        """Network that ran, with its non-idealities."""
        return self._ran

    @property
    def seconds(self) -> float:
        """Seconds until the controls settle, if a circuit is built."""
        return self.built.circuit.scaling.time * self.control_settling_time

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        network = self.made.nominal(self.setting)
        if network.size != self.network.size:
            raise StudyError("its non-idealities add neurons that the problem knows nothing of")
        return network, self.state


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchSample(_NetworkSample):
    """Network that ran in a batch.

    Attributes
    ----------
    index : int
        Index in the batch.
    """

    batch: BatchRun
    index: int

    @property
    def outcome(self) -> str:
        """Outcome in one or two words."""
        return word_of(self.batch.outcomes[self.index])

    @property
    def message(self) -> str:
        """Outcome in one sentence if the network did not settle; else empty."""
        return "" if self.settled else self.batch.message(self.index).partition(": ")[2]

    @property
    def state(self) -> np.ndarray:
        """Final state (n,)."""
        return self.batch.states[self.index]

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit."""
        return float(self.batch.settling_times[self.index])

    @property
    def controls(self) -> np.ndarray:
        """Final live controls (c,)."""
        return control_values(self.batch.network, self.state)

    @property
    def steps(self) -> int | None:
        """Number of steps."""
        return int(self.batch.steps[self.index])

    @property
    def settling_steps(self) -> int | None:
        """Number of steps up to the last exit."""
        return int(self.batch.settling_steps[self.index]) if self.settled else None

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory."""
        if self.batch.curves is None:
            return super().trajectory
        return self.batch.curves.trajectory(self.index, self.network)


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSample(_NetworkSample):
    """Network that ran alone."""

    run: Run

    @property
    def outcome(self) -> str:
        """Outcome in one or two words."""
        return word_of(self.run.status.outcome)

    @property
    def message(self) -> str:
        """Outcome in one sentence if the network did not settle; else empty."""
        return "" if self.settled else str(self.run.status)

    @property
    def state(self) -> np.ndarray:
        """Final state (n,)."""
        return self.run.trajectory.final

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit."""
        return self.run.settling_time

    @property
    def controls(self) -> np.ndarray:
        """Final live controls (c,)."""
        return control_values(self.network, self.state)

    @property
    def steps(self) -> int | None:
        """Number of steps."""
        return self.run.steps

    @property
    def settling_steps(self) -> int | None:
        """Number of steps up to the last exit."""
        return self.run.settling_steps

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory."""
        return self.run.trajectory
