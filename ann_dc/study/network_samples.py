"""Points that ran as networks, alone or in a batch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.run import Run
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.study.realisation import network_at
from ann_dc.study.sample import Sample, word_of


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
