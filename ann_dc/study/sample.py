"""A point as it ended: what metrics read, whatever it ran on.

Points that ran as networks, alone or in a batch.
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
    """An outcome in a word or two.

    >>> word_of(Outcome.LEFT_DOMAIN)
    'left domain'
    """
    return outcome.name.lower().replace("_", " ")


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample(ABC):
    """A point of a study, and how it ended.

    Attributes
    ----------
    point : Point
    made : Realisation
        What stands behind it.
    """

    point: Point
    made: Realisation

    @property
    def setting(self) -> Mapping[str, Value]:
        """What is set at the point."""
        return self.point.setting

    @property
    @abstractmethod
    def outcome(self) -> str:
        """How it ended, in one or two words."""

    @property
    @abstractmethod
    def message(self) -> str:
        """The same in a sentence."""

    @property
    @abstractmethod
    def network(self) -> Network:
        """What ran: the network with its defects, or the emulation of a circuit."""

    @property
    @abstractmethod
    def state(self) -> np.ndarray:
        """(n,): where it ended, in units of ``network``."""

    @property
    @abstractmethod
    def controls(self) -> np.ndarray:
        """(c,): live controls at the end, in units of the designed network."""

    @property
    def settling_time(self) -> float:
        """Unit time constants to the last exit of the residual; nan where there is none."""
        return float("nan")

    @property
    def control_settling_time(self) -> float:
        """Unit time constants to the last exit of the controls.

        Raises
        ------
        StudyError
            If nothing was recorded over time.
        """
        return control_settling(self.trajectory)

    @property
    def steps(self) -> int | None:
        """Steps of the integration or the recurrence; None of a circuit."""
        return None

    @property
    def settling_steps(self) -> int | None:
        """Those of them up to the last exit; None where it did not settle."""
        return None

    @property
    def seconds(self) -> float:
        """Seconds to settle, of a circuit; nan where none is built."""
        return float("nan")

    @property
    def trajectory(self) -> Trajectory:
        """What it did over time.

        Raises
        ------
        StudyError
            If that was not recorded.
        """
        raise StudyError("nothing was recorded over time")

    @property
    def settled(self) -> bool:
        """Whether it came to rest."""
        return self.outcome == word_of(Outcome.SETTLED)

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues of ``network`` where it ended.

        Raises
        ------
        NetworkError
            If they cannot be had.
        """
        return spectrum(self.network, self.state)

    @cached_property
    def resting(self) -> Spectrum:
        """Eigenvalues of ``network`` where it could rest near the designed point, come what may.

        Raises
        ------
        StudyError, NetworkError
            If defects add neurons, or there is no equilibrium.
        """
        near = self.made.designed(self.setting).settled
        if near.shape != (self.network.size,):
            raise StudyError("its defects add neurons, so that the designed point is none of its")
        return spectrum(self.network, equilibrium(self.network, near))

    @cached_property
    def start(self) -> np.ndarray:
        """(n,): where it began, in units of ``network``."""
        return self.network.start_state

    @cached_property
    def right_controls(self) -> tuple[np.ndarray, float]:
        """Settled controls (c,) of the ideal network for the same inputs, and their size.

        Raises
        ------
        StudyError
            If a printed form has other live controls.
        """
        right, size = self.made.right_controls(self.setting)
        if self.controls.shape != right.shape:
            raise StudyError("the form has other live controls than the corrected one")
        return right, size

    @cached_property
    def built(self) -> Built:
        """The circuit of the point.

        Raises
        ------
        StudyError
            If the study says nothing of one.
        """
        if not is_built(self.setting):
            raise StudyError("no circuit is built; set circuit.level")
        return self.made.built(self.setting)

    @cached_property
    def problem(self) -> OptimalControlProblem:
        """The problem with the inputs of the point.

        Raises
        ------
        StudyError
            If the study is one of a network alone.
        """
        declared = self.made.problem(self.setting)
        if declared is None:
            raise StudyError("a network without a problem has no cost and no certificate")
        return _with_inputs(declared, behind(self.setting, "input"))

    @cached_property
    def certificate(self) -> Certificate:
        """Whether the end is an optimum, by the problem alone.

        Raises
        ------
        StudyError
            If there is no problem.
        """
        return certificate_of(self.problem, *self.ideal)

    @property
    @abstractmethod
    def ideal(self) -> tuple[Network, np.ndarray]:
        """The ideal network with the inputs of the point, and the end in its units."""


def _with_inputs(
    problem: OptimalControlProblem, inputs: Mapping[str, Value]
) -> OptimalControlProblem:
    """The problem for other inputs of its network."""
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
    """A network that ran."""

    @cached_property
    def _ran(self) -> Network:
        designed = self.made.designed(self.setting).network
        return network_at(designed, self.setting, self.point.seed)

    @property
    def network(self) -> Network:
        """What ran."""
        return self._ran

    @property
    def seconds(self) -> float:
        """Seconds until the controls stay where they end, where a circuit is built."""
        return self.built.circuit.scaling.time * self.control_settling_time

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        network = self.made.nominal(self.setting)
        if network.size != self.network.size:
            raise StudyError("its defects add neurons that the problem knows nothing of")
        return network, self.state


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchSample(_NetworkSample):
    """A network that ran in a batch.

    Attributes
    ----------
    batch : BatchRun
    index : int
        Which one of the batch.
    """

    batch: BatchRun
    index: int

    @property
    def outcome(self) -> str:
        """How it ended, in one or two words."""
        return word_of(self.batch.outcomes[self.index])

    @property
    def message(self) -> str:
        """The same in a sentence, where it did not settle."""
        return "" if self.settled else self.batch.message(self.index).partition(": ")[2]

    @property
    def state(self) -> np.ndarray:
        """(n,): where it ended."""
        return self.batch.states[self.index]

    @property
    def settling_time(self) -> float:
        """Unit time constants to the last exit."""
        return float(self.batch.settling_times[self.index])

    @property
    def controls(self) -> np.ndarray:
        """(c,): live controls at the end."""
        return control_values(self.batch.network, self.state)

    @property
    def steps(self) -> int | None:
        """Steps that it took."""
        return int(self.batch.steps[self.index])

    @property
    def settling_steps(self) -> int | None:
        """Those of them up to the last exit."""
        return int(self.batch.settling_steps[self.index]) if self.settled else None

    @property
    def trajectory(self) -> Trajectory:
        """What it did over time."""
        if self.batch.curves is None:
            return super().trajectory
        return self.batch.curves.trajectory(self.index, self.network)


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSample(_NetworkSample):
    """A network that ran alone.

    Attributes
    ----------
    run : Run
    """

    run: Run

    @property
    def outcome(self) -> str:
        """How it ended, in one or two words."""
        return word_of(self.run.status.outcome)

    @property
    def message(self) -> str:
        """The same in a sentence, where it did not settle."""
        return "" if self.settled else str(self.run.status)

    @property
    def state(self) -> np.ndarray:
        """(n,): where it ended."""
        return self.run.trajectory.final

    @property
    def settling_time(self) -> float:
        """Unit time constants to the last exit."""
        return self.run.settling_time

    @property
    def controls(self) -> np.ndarray:
        """(c,): live controls at the end."""
        return control_values(self.network, self.state)

    @property
    def steps(self) -> int | None:
        """Steps that it took."""
        return self.run.steps

    @property
    def settling_steps(self) -> int | None:
        """Those of them up to the last exit."""
        return self.run.settling_steps

    @property
    def trajectory(self) -> Trajectory:
        """What it did over time."""
        return self.run.trajectory
