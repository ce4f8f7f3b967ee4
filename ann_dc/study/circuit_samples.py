"""Circuit samples: predicted by behavioural emulation, or simulated in ngspice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError, StudyError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.prediction import (
    CLOCKED,
    Prediction,
    clipped_at,
    clipping_of,
    prediction_of,
)
from ann_dc.network.network import Network
from ann_dc.study.sample import End, Sample, word_of

REPELS = "unstable equilibrium"
"""Outcome of an emulated circuit whose equilibrium is unstable."""
NO_EQUILIBRIUM = "no equilibrium"
"""Outcome of an emulated circuit without an equilibrium near the optimum."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EmulatedSample(Sample):
    """Circuit with part errors, predicted by its behavioural emulation."""

    @cached_property
    def instance(self) -> CircuitInstance:
        """Circuit instance with its part errors."""
        built = self.built
        return CircuitInstance(
            circuit=built.circuit,
            level=built.level,
            probe=built.probe,
            deviations=built.deviations(self.setting, self.point.seed),
        )

    @cached_property
    def end(self) -> End:
        """Predicted end of the circuit."""
        outcome, message = self._outcome()
        return End(outcome, message, self.state, self.instance.emulation.controls(self.state))

    def _outcome(self) -> tuple[str, str]:
        assert self.network  # a circuit that cannot be emulated has failed
        try:
            abscissa = self.spectrum.abscissa
        except NetworkError as error:
            return NO_EQUILIBRIUM, str(error)
        emulation = self.instance.emulation
        if clipped_at(emulation, self.state).any():
            clipping = clipping_of(self.instance, emulation, self.state)
            return clipping.reason.name.lower(), clipping.sentence
        if abscissa < 0:
            return word_of(Outcome.SETTLED), ""
        return REPELS, f"an eigenvalue of the settled circuit has the real part {abscissa:.3g}"

    @property
    def state(self) -> np.ndarray:
        """Final state (n,) of the emulation; the outcome depends on its spectrum."""
        return self.instance.settled

    @property
    def network(self) -> Network:
        """Emulation of the circuit as a network.

        Raises `NetworkError` for a clocked circuit, which only ngspice and the recurrent layer run.
        """
        if self.instance.level.technology.clocked:
            raise NetworkError(f"{self.instance.level.name} circuits: {CLOCKED}")
        return self.instance.emulation.network

    @cached_property
    def _prediction(self) -> Prediction:
        found = prediction_of(self.instance)
        if not isinstance(found, Prediction):
            raise found.error
        return found

    @property
    def seconds(self) -> float:
        """Settling time of the circuit in seconds."""
        return self._prediction.settling_time

    @property
    def settling_time(self) -> float:
        """Settling time in network time (tau = 1), from the controls."""
        return self.seconds / self.built.circuit.scaling.time

    @property
    def control_settling_time(self) -> float:
        """Settling time of the controls, equal to `settling_time` for a circuit."""
        return self.settling_time

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        """Unavailable, because the emulation has other neurons; raises `StudyError`."""
        raise StudyError("an emulated circuit is compared with the ideal network by its controls")


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitSample(Sample):
    """Circuit that was simulated in ngspice."""

    run: CircuitRun

    @cached_property
    def end(self) -> End:
        """End of the simulation."""
        trajectory, unsettled = self.run.trajectory, self.run.unsettled
        outcome = Outcome.NOT_SETTLED if unsettled else Outcome.SETTLED
        if unsettled and "run.duration" in self.setting:
            outcome, unsettled = Outcome.COMPLETED, Outcome.COMPLETED.value
        controls = trajectory.control_values[-1]
        return End(word_of(outcome), unsettled, trajectory.final, controls)

    @property
    def network(self) -> Network:
        """Network of the simulated circuit."""
        return self.run.trajectory.network

    @property
    def settling_time(self) -> float:
        """Network time (tau = 1) of the last exit of the controls."""
        return control_settling(self.trajectory)

    @property
    def seconds(self) -> float:
        """Settling time of the circuit in seconds."""
        return self.run.settling_time()

    @property
    def trajectory(self) -> Trajectory:
        """Recorded trajectory."""
        return self.run.timed.trajectory

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        """Network that was built, and the final state of the circuit."""
        return self.network, self.state
