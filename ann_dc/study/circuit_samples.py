"""Points that are circuits: predicted by their emulation, or run in ngspice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError, StudyError
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.fidelity.prediction import (
    CLOCKED,
    Prediction,
    clipped_at,
    clipping_of,
    prediction_of,
)
from ann_dc.network.network import Network
from ann_dc.study.sample import Sample, word_of

REPELS = "settled point repels"
"""Outcome of an emulated circuit that has an equilibrium and does not stay there."""
NO_EQUILIBRIUM = "no equilibrium"
"""Outcome of an emulated circuit that rests nowhere near the optimum."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EmulatedSample(Sample):
    """A circuit with the errors of its parts, predicted by its emulation."""

    @cached_property
    def specimen(self) -> Specimen:
        """The circuit as it is built."""
        built = self.built
        return Specimen(
            circuit=built.circuit,
            level=built.level,
            probe=built.probe,
            deviations=built.deviations(self.setting, self.point.seed),
        )

    @cached_property
    def _end(self) -> tuple[str, str]:
        assert self.network  # what cannot be built at all has failed
        try:
            abscissa = self.spectrum.abscissa
        except NetworkError as error:
            return NO_EQUILIBRIUM, str(error)
        emulation = self.specimen.emulation
        if clipped_at(emulation, self.state).any():
            found = clipping_of(self.specimen, emulation, self.state)
            return found.reason.name.lower(), found.sentence
        if abscissa < 0:
            return word_of(Outcome.SETTLED), ""
        return REPELS, f"an eigenvalue of the settled circuit has the real part {abscissa:.3g}"

    @property
    def outcome(self) -> str:
        """How it ended, in one or two words."""
        return self._end[0]

    @property
    def message(self) -> str:
        """The same in a sentence, where it did not settle."""
        return self._end[1]

    @property
    def network(self) -> Network:
        """What ran.

        Raises
        ------
        NetworkError
            If the circuit is a clocked one, which only ngspice and the recurrent layer run.
        """
        if self.specimen.level.technology.clocked:
            raise NetworkError(f"{self.specimen.level.name} circuits: {CLOCKED}")
        return self.specimen.emulation.network

    @property
    def state(self) -> np.ndarray:
        """(n,): where it ended."""
        return self.specimen.settled

    @property
    def controls(self) -> np.ndarray:
        """(c,): live controls at the end."""
        return self.specimen.emulation.controls(self.specimen.settled)

    @cached_property
    def _prediction(self) -> Prediction:
        found = prediction_of(self.specimen)
        if not isinstance(found, Prediction):
            raise found.error
        return found

    @property
    def seconds(self) -> float:
        """Seconds to settle, where a circuit is built."""
        return self._prediction.settling_time

    @property
    def settling_time(self) -> float:
        """Unit time constants to the last exit."""
        return self.seconds / self.built.circuit.scaling.time

    @property
    def control_settling_time(self) -> float:
        """The same: a circuit settles by its controls."""
        return self.settling_time

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        """There is none: other neurons ran.

        Raises
        ------
        StudyError
        """
        raise StudyError("an emulated circuit is compared with the ideal network by its controls")


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitSample(Sample):
    """A circuit that ran in ngspice.

    Attributes
    ----------
    run : CircuitRun
    """

    run: CircuitRun

    @property
    def outcome(self) -> str:
        """How it ended, in one or two words."""
        return word_of(Outcome.NOT_SETTLED if self.run.unsettled else Outcome.SETTLED)

    @property
    def message(self) -> str:
        """The same in a sentence, where it did not settle."""
        return self.run.unsettled

    @property
    def network(self) -> Network:
        """What ran."""
        return self.run.trajectory.network

    @property
    def state(self) -> np.ndarray:
        """(n,): where it ended."""
        return self.run.trajectory.final

    @property
    def controls(self) -> np.ndarray:
        """(c,): live controls at the end."""
        return self.run.trajectory.control_values[-1]

    @property
    def settling_time(self) -> float:
        """Unit time constants to the last exit."""
        return control_settling(self.trajectory)

    @property
    def seconds(self) -> float:
        """Seconds to settle, where a circuit is built."""
        return self.run.settling_time()

    @property
    def trajectory(self) -> Trajectory:
        """What it did over time."""
        return self.run.timed.trajectory

    @property
    def ideal(self) -> tuple[Network, np.ndarray]:
        """The network that was built, and where the circuit ended."""
        return self.network, self.state
