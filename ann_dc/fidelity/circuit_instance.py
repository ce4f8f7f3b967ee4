"""Circuit instance: one circuit with its part errors, emulated and solved once."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.ode import BDF, RADAU, OdeBackend
from ann_dc.backends.run import Run
from ann_dc.backends.settling import control_settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.building import emulate, emulate_clamps
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.states import modes_at, settled_state
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OP_AMPS, SwitchedCapacitors
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.validation import checked

TRANSIENT = OdeBackend(verify=False, limit=1e6, most_steps=300_000)
"""Backend of the transient; the fastest poles are those of multipliers, far from the slowest."""

STIFF = 5e4
"""Stiffness ratio beyond which `TRANSIENT` ends before twenty of the slowest time constants."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitInstance:
    """Circuit on a level with deviations of its parts; each result is computed once.

    Attributes
    ----------
    circuit : Circuit
        Circuit with nominal components.
    level : Level
        Level of the parts.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
    deviations : mapping of parameter name to (N,) array
        Deviations of the parts. Default: empty, for the nominal circuit.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import CircuitInstance
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> nominal.control_error < 1e-3  # what finite gains cost
    True
    """

    circuit: Circuit
    level: Level
    probe: Trajectory
    deviations: Deviations = field(default_factory=dict)

    @cached_property
    def emulation(self) -> Emulation:
        """Emulation of the circuit; for a clocked circuit, one with the same equilibrium.

        The branches of a switched-capacitor circuit transfer no charge at equilibrium, sum c (y +
        e) = 0, with e the virtual ground. Resistors of the same ratios carry no current at the same
        point.

        Raises `NetworkError` if the circuit has no emulation, or a deviation is out of its range.
        """
        level = self.level
        if level.technology.clocked:
            level = replace(level, technology=OP_AMPS)
        return emulate(self.circuit, level, self.deviations)

    @cached_property
    def moving(self) -> Emulation:
        """Emulation of the transient: moving clamps, voltage drops of currents and diodes.

        Identical to `emulation` if the circuit has no clamps, output resistances or rectifying
        multiplier neurons.
        """
        if self.clamped or self.level.datasheet.rout or self.circuit.schematic.diode_neurons:
            return emulate_clamps(self.circuit, self.level, self.deviations)
        return self.emulation

    @property
    def clamped(self) -> bool:
        """True if the circuit has clamps for saturation limits."""
        parts = self.circuit.schematic.parts
        return any(isinstance(part, Integrator) and part.with_limits for part in parts)

    @cached_property
    def settled(self) -> np.ndarray:
        """Settled state (n,) by Newton's method, from the ideal network's equilibrium.

        The state is in the units of the emulation's network. Raises `NetworkError` if no
        equilibrium exists near the ideal one.
        """
        return settled_state(self.emulation, self.probe.final)

    @cached_property
    def modes(self) -> Spectrum:
        """Eigenvalues of the pole model at the settled point, per unit of network time.

        A clocked circuit with step h has the rates ln(1 + h lambda) / h of its recurrence, where
        lambda are the modes of the ideal network.
        """
        built = self.level.technology
        if not isinstance(built, SwitchedCapacitors):
            return modes_at(self.emulation, self.settled)
        ideal = spectrum(self.circuit.schematic.network, self.probe.final)
        factors = 1 + built.step * ideal.eigenvalues.astype(complex)
        return Spectrum(eigenvalues=np.log(factors) / built.step)

    @property
    def control_error(self) -> float:
        """Error of the settled controls against the ideal network's, relative to size."""
        return control_error(self.settled_controls, self.probe)

    @property
    def settled_controls(self) -> np.ndarray:
        """Controls (m,) of the settled state, or all states without controls."""
        return self.emulation.controls(self.settled)


def transient_of(
    instance: CircuitInstance,
    most_steps: int = TRANSIENT.most_steps,
    start: np.ndarray | None = None,
) -> Run:
    """Integrate the transient from reset, or from the state ``start`` (n,)."""
    network = instance.moving.network
    if start is not None:
        network = network.with_start(start)
    explicit = replace(TRANSIENT, most_steps=most_steps)
    implicit = replace(explicit, method=BDF, limit=1e9)
    if instance.circuit.conductances:  # nodes of a grid are far faster than the rest
        return implicit.run(network)
    if instance.clamped:  # other steps shake the diodes that conduct
        run = replace(implicit, method=RADAU).run(network)
        return run if run.status.settled else explicit.run(network)
    run = explicit.run(network)
    late = run.status.outcome is Outcome.NOT_SETTLED and _stiff(instance)
    return implicit.run(network) if late else run


def settling_of(instance: CircuitInstance, run: Run) -> float:
    """Return the seconds until every control of a transient stays within 0.1 %."""
    found = control_settling(run.trajectory, controls=instance.moving.controls)
    return instance.circuit.scaling.time * found


def _stiff(instance: CircuitInstance) -> bool:
    """Return True if the circuit would settle only after the explicit steps end."""
    try:
        return STIFF < instance.modes.stiffness_ratio < math.inf
    except NetworkError:  # it has no equilibrium
        return False
