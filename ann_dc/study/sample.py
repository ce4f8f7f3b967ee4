"""Result of a case as read by metrics, independent of the backend."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.run import Run
from ann_dc.backends.settling import control_settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import StudyError
from ann_dc.families.family import problem_at
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate
from ann_dc.solution.solution import certificate_of
from ann_dc.study.realisation import Built, Realisation, network_at
from ann_dc.study.records import Point, Value
from ann_dc.study.settings import behind, is_built
from ann_dc.two_level.run import TwoLevelRun


def word_of(outcome: Outcome) -> str:
    """Return an outcome in lower-case words.

    >>> word_of(Outcome.LEFT_DOMAIN)
    'left domain'
    """
    return outcome.name.lower().replace("_", " ")


class End(NamedTuple):
    """End of a case.

    The outcome has one or two words; the message is empty if the case settled. The final state (n,)
    is in units of the network that ran, the live controls (c,) in those of the designed one. Steps
    are None for a circuit, `settling_steps` also if the case did not settle.
    """

    outcome: str
    message: str
    state: np.ndarray
    controls: np.ndarray
    steps: int | None = None
    settling_steps: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample(ABC):
    """Case of a study with its result; `made` caches its problem, design and circuit."""

    point: Point
    made: Realisation

    @cached_property
    @abstractmethod
    def end(self) -> End:
        """Outcome, final state and steps."""

    @property
    @abstractmethod
    def network(self) -> Network:
        """Network that ran, with its non-idealities, or the emulation of a circuit."""

    @property
    @abstractmethod
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit of the residual, or of a circuit's controls."""

    @property
    @abstractmethod
    def seconds(self) -> float:
        """Settling time of the circuit in seconds."""

    @property
    @abstractmethod
    def ideal(self) -> tuple[Network, np.ndarray]:
        """Ideal network with the inputs of the case, and the final state in its units."""

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory; raises `StudyError` if nothing was recorded."""
        raise StudyError("no values were recorded over time")

    @property
    def setting(self) -> Mapping[str, Value]:
        """Values of the settings of the case."""
        return self.point.setting

    @property
    def state(self) -> np.ndarray:
        """Final state (n,) in units of `network`."""
        return self.end.state

    @property
    def controls(self) -> np.ndarray:
        """Final live controls (c,) in units of the designed network."""
        return self.end.controls

    @property
    def settled(self) -> bool:
        """True if the sample settled."""
        return self.end.outcome == word_of(Outcome.SETTLED)

    @property
    def control_settling_time(self) -> float:
        """Network time (tau = 1) of the last exit of the controls."""
        return control_settling(self.trajectory)

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues of `network` at the final state."""
        return spectrum(self.network, self.state)

    @cached_property
    def equilibrium_spectrum(self) -> Spectrum:
        """Eigenvalues of `network` at the equilibrium near the designed point.

        They do not depend on the run. Raises `StudyError` if non-idealities add neurons.
        """
        near = self.made.designed(self.setting).settled
        if near.shape != (self.network.size,):
            raise StudyError(
                "its non-idealities add neurons, so that the designed point is not one of "
                "its states"
            )
        return spectrum(self.network, equilibrium(self.network, near))

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
        """Circuit of the case; raises `StudyError` if the study does not define one."""
        if not is_built(self.setting):
            raise StudyError("no circuit is built; set circuit.level")
        return self.made.built(self.setting)

    @cached_property
    def certificate(self) -> Certificate:
        """Optimality certificate of the end, computed from the problem alone.

        Raises `StudyError` if the subject has no problem.
        """
        declared = self.made.problem(self.setting)
        if declared is None:
            raise StudyError("a network without a problem has no cost and no certificate")
        inputs = behind(self.setting, "input")
        return certificate_of(problem_at(declared, inputs), *self.ideal)


@dataclass(frozen=True, kw_only=True, eq=False)
class _NetworkSample(Sample):
    """Network that ran."""

    @cached_property
    def _ran(self) -> Network:
        designed = self.made.designed(self.setting).network
        return network_at(designed, self.setting, self.point.seed)

    @property
    def network(self) -> Network:
        return self._ran

    @property
    def seconds(self) -> float:
        return self.built.circuit.scaling.time * self.control_settling_time

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        network = self.made.nominal(self.setting)
        if network.size != self.network.size:
            raise StudyError("its non-idealities add neurons that do not belong to the problem")
        return network, self.state


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoLevelSample(_NetworkSample):
    """Network that ran on two levels; its steps are outer iterations."""

    run: TwoLevelRun

    @cached_property
    def end(self) -> End:
        """End of the run."""
        outcome, state = self.run.outcomes[0], self.run.states[0]
        needed = int(self.run.outer_iterations[0])
        return End(
            outcome=word_of(outcome),
            message="" if outcome is Outcome.SETTLED else self.run.message(0),
            state=state,
            controls=control_values(self.network, state),
            steps=self.run.rounds,
            settling_steps=None if needed < 0 else needed,
        )

    @property
    def settling_time(self) -> float:
        """Unavailable, because two levels have no network time; raises `StudyError`."""
        raise StudyError("two levels have outer iterations (settling_steps) and no network time")


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchSample(_NetworkSample):
    """Network that ran in a batch, at an index."""

    batch: BatchRun
    index: int

    @cached_property
    def end(self) -> End:
        """End of one sample of the batch."""
        batch, index = self.batch, self.index
        outcome, state = batch.outcomes[index], batch.states[index]
        settled = outcome is Outcome.SETTLED
        return End(
            outcome=word_of(outcome),
            message="" if settled else batch.message(index).partition(": ")[2],
            state=state,
            controls=control_values(batch.network, state),
            steps=int(batch.steps[index]),
            settling_steps=int(batch.settling_steps[index]) if settled else None,
        )

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit."""
        return float(self.batch.settling_times[self.index])

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

    @cached_property
    def end(self) -> End:
        """End of the run."""
        status, state = self.run.status, self.run.trajectory.final
        return End(
            outcome=word_of(status.outcome),
            message="" if status.settled else str(status),
            state=state,
            controls=control_values(self.network, state),
            steps=self.run.steps,
            settling_steps=self.run.settling_steps,
        )

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit."""
        return self.run.settling_time

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory."""
        return self.run.trajectory
