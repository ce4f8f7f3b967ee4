"""Effects of single non-idealities on a circuit, by emulation and in ngspice.

The circuit is designed for one level and built with the parts of another level, which has one
additional effect. The table therefore shows effects that the design ignores; `ann_dc.SpiceBackend`
takes these into account when it chooses resistors and bandwidth margin.

Tolerances differ from part to part and add up as squares. A nonlinearity, a leakage or a bias
current is equal in all parts of one type, and `systematic` gives the shift of the controls by each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NotFiniteError, SpiceTimeoutError, UnknownNameError
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.prediction import Unpredicted, prediction_of
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.hardware.parts.parasitics import NONE, Parasitics
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.validation import PositiveFinite, checked

MARGIN, OHMS = 10.0, 10e3
"""Bandwidth margin and resistance (ohms) of the tested circuits: fast, ignoring parasitics."""

PATIENCE = 60.0
"""Default time limit of ngspice in seconds; circuits that ring do not end."""

STAYS = 0.9
"""Ringing threshold: swing of the controls in a third of a run relative to the third before."""

OP_AMPS: dict[str, dict[str, float]] = {
    "no effect": {},
    **{f"{p} pF at every ground": {"stray_capacitance": p * 1e-12} for p in (1, 3, 5, 8, 12, 20)},
    **{f"second pole at {k} GBW": {"second_pole": k * 10e6} for k in (10, 5, 3, 2, 1)},
    "second pole at 3 GBW, 3 pF": {"second_pole": 30e6, "stray_capacitance": 3e-12},
    "second pole at 3 GBW, 8 pF": {"second_pole": 30e6, "stray_capacitance": 8e-12},
    "bias current 1 nA": {"bias_current": 1e-9},
    "bias current 10 nA": {"bias_current": 1e-8},
    "bias current 100 nA": {"bias_current": 1e-7},
    "bias current 1 uA": {"bias_current": 1e-6},
}
"""Parasitics of op amps of 10 MHz, by their description."""

BOARDS = ("opa192_ad734", "ad8065_ad835")
"""Part sets that are most sensitive."""

PASSIVES: dict[str, dict[str, float]] = {
    "multiplier nonlinearity 0.1 %": {"multiplier_nonlinearity": 1e-3},
    "multiplier nonlinearity 0.4 %": {"multiplier_nonlinearity": 4e-3},
    "feedthrough 0.3 %": {"multiplier_feedthrough": 3e-3},
    "multiplier input capacitance 5 pF": {"multiplier_capacitance": 5e-12},
    "capacitor leakage time constant 0.1 s": {"capacitor_leakage": 0.1},
    "open switches 1 Gohm": {"switch_leakage": 1e9},
    "open switches 5 pF": {"switch_capacitance": 5e-12},
    "open switches 1 Gohm and 5 pF": {"switch_leakage": 1e9, "switch_capacitance": 5e-12},
    "switch charge injection 0.5 pC": {"switch_charge": 0.5e-12},
    "switch charge injection 5 pC": {"switch_charge": 5e-12},
}
"""Parasitics of multipliers, capacitors and reset switches by description, rows of the table."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """Non-ideal effect: description ``words``, and two levels.

    The circuit is designed for the level ``made_for`` and built with the parts of ``level``.
    """

    words: str
    level: Level
    made_for: Level


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Result of one effect on a circuit, predicted and simulated.

    Attributes
    ----------
    effect : Effect
        Tested effect.
    predicted_error, measured_error : float
        Error of the settled controls against the ideal network, relative to the largest control, by
        emulation and in ngspice. Default nan: the circuit does not settle or was not simulated.
    predicted_settling, measured_settling : float
        Time in seconds until every control stays within 0.1 %. Default nan, as for the errors.
    predicted_stable, measured_stable : bool or None
        True if the circuit settles; None (default) if unknown.
    why, measured_why : str
        Reason for which the emulation or ngspice gave no result; empty (default) if there is a
        result.
    """

    effect: Effect
    predicted_error: float = math.nan
    predicted_settling: float = math.nan
    predicted_stable: bool | None = None
    measured_error: float = math.nan
    measured_settling: float = math.nan
    measured_stable: bool | None = None
    why: str = ""
    measured_why: str = ""

    def __str__(self) -> str:
        predicted = _said(self.predicted_stable, self.predicted_error, self.predicted_settling)
        measured = _said(self.measured_stable, self.measured_error, self.measured_settling)
        if self.measured_stable is None:
            measured = f"nothing: {self.measured_why}"
        simulated = self.measured_why or self.measured_stable is not None
        ngspice = f"ngspice {measured}" if simulated else "not simulated"
        return f"{self.effect.words}: predicted {predicted}; {ngspice}"


def _said(stable: bool | None, error: float, settling: float) -> str:
    if stable is None:
        return "nothing"
    return f"{error:.2e}, {settling * 1e6:.4g} us" if stable else "rings"


@checked
def known_effects() -> tuple[Effect, ...]:
    """Return the known effects of parts on a board, beginning with "no effect".

    The effects apply to op amps of 10 MHz and to the part sets that are most sensitive.

    Examples
    --------
    >>> [effect.words for effect in known_effects()][:2]
    ['no effect', '1 pF at every ground']
    """
    plain = _made(macro())
    boards = {name: _made(presets.get(name)) for name in BOARDS}
    return (
        *_on(plain, OP_AMPS),
        *(Effect(words=name, level=board, made_for=board) for name, board in boards.items()),
        *_on(plain, PASSIVES),
    )


def _on(plain: Level, table: dict[str, dict[str, float]]) -> Iterator[Effect]:
    for words, parasitics in table.items():
        yield Effect(words=words, level=with_parasitics(plain, **parasitics), made_for=plain)


def _made(level: Level) -> Level:
    return replace(level, smallest_resistor=OHMS)


@checked
def with_parasitics(level: Level, **parasitics: float) -> Level:
    """Return a level whose parts have the given `Parasitics`, in their units.

    Raises `UnknownNameError` if a name is not an attribute of `Parasitics`.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import with_parasitics
    >>> strays = with_parasitics(ann_dc.levels.macro(), stray_capacitance=3e-12)
    >>> strays.datasheet.parasitics.ground
    3e-12
    """
    known = [field.name for field in fields(Parasitics)]
    for name in parasitics:
        if name not in known:
            raise UnknownNameError.of("parasitic", name, known)
    datasheet = level.datasheet
    changed = replace(datasheet.parasitics, **parasitics)
    return replace(level, datasheet=replace(datasheet, parasitics=changed))


@checked
def effects_table(
    network: Network,
    looked_at: Iterable[Effect] | None = None,
    *,
    simulated: bool = True,
    patience: PositiveFinite = PATIENCE,
    progress: Progress = silent,
) -> tuple[Found, ...]:
    """Compute the result of every effect on the circuit of a network, one row per effect.

    Raises `NetworkError` if the network does not settle. Raises `NgspiceMissing` or `SpiceError` if
    ngspice is not found, or fails for a reason other than ringing.

    Parameters
    ----------
    network : Network
        Network with diagonal preconditioner only.
    looked_at : iterable of Effect, optional
        Effects to test. Default: `known_effects`.
    simulated : bool
        If False, ngspice is not run. Default True.
    patience : float
        Time limit of ngspice in seconds per circuit; a run that exceeds the limit gives no result.
        Default 60.
    progress : Progress
        Receives every started run and every row. Default: silent.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import effects_table, known_effects
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> table = effects_table(network, known_effects()[:7], simulated=False)
    >>> [row.predicted_stable for row in table]
    [True, True, True, True, True, True, False]
    """
    made: dict[Level, tuple[Circuit, Trajectory]] = {}
    rows = []
    for effect in known_effects() if looked_at is None else looked_at:
        progress(f"{effect.words}: emulation")
        wanted = effect.made_for
        if wanted not in made:
            made[wanted] = SpiceBackend(level=wanted, bandwidth_margin=MARGIN).prepare(network)
        row = _predicted(effect, *made[wanted])
        if simulated:
            progress(f"{effect.words}: ngspice")
            row = _simulated(row, *made[wanted], patience)
        progress(str(row))
        rows.append(row)
    return tuple(rows)


def _predicted(effect: Effect, circuit: Circuit, probe: Trajectory) -> Found:
    found = prediction_of(CircuitInstance(circuit=circuit, level=effect.level, probe=probe))
    if isinstance(found, Unpredicted):
        return Found(effect=effect, why=found.sentence)
    settles = found.stable and not found.other_equilibrium
    return Found(
        effect=effect,
        predicted_error=found.control_error if settles else math.nan,
        predicted_settling=found.settling_time,
        predicted_stable=settles,
        why=found.unknown,
    )


def _simulated(row: Found, circuit: Circuit, probe: Trajectory, patience: float) -> Found:
    simulator = Ngspice(timeout=patience)
    backend = SpiceBackend(level=row.effect.level, require_stable=False, simulator=simulator)
    try:
        run = simulate(backend, circuit, probe, {})
    except NotFiniteError as error:
        return replace(row, measured_stable=False, measured_why=str(error))
    except SpiceTimeoutError:
        return replace(row, measured_why=f"terminated after {patience:g} s")
    if run.unsettled:
        rings = False if _rings(run) else None
        return replace(row, measured_stable=rings, measured_why=run.unsettled)
    return replace(
        row,
        measured_error=run.control_error,
        measured_settling=run.settling_time(),
        measured_stable=True,
    )


def _rings(run: CircuitRun) -> bool:
    """Return True if the last third of a run swings nearly as far as the second."""
    if run.deck.cut:
        return False  # what drifts for longer than the run moves evenly, too
    time, controls = run.trajectory.time, run.trajectory.control_values
    thirds = (time > time[-1] / 3) & (time <= 2 / 3 * time[-1]), time > 2 / 3 * time[-1]
    before, last = (np.ptp(controls[third], axis=0).max() for third in thirds)
    return bool(last >= STAYS * before)


STILL = ("bias_doubling", "multiplier_noise", "amplifier_noise")
"""Parasitics that do not shift the controls by themselves, or only briefly."""


@checked
def systematic(instance: CircuitInstance) -> dict[str, float]:
    """Return the shift of the settled controls by each parasitic, taken alone.

    The result maps attributes of `Parasitics` to the largest shift relative to the largest control,
    in decreasing order, against parts without parasitics. Parasitics without effect, such as a
    capacitance, give about zero. Raises `NetworkError` if a circuit has no emulation, or no
    equilibrium near the ideal one.
    """
    parasitics = instance.level.datasheet.parasitics
    plain = _controls(instance, NONE)
    size = size_of(plain, instance.probe.control_reach)
    moves = {}
    for field in fields(Parasitics):
        value = getattr(parasitics, field.name)
        if field.name not in STILL and value != getattr(NONE, field.name):
            alone = _controls(instance, replace(NONE, **{field.name: value}))
            moves[field.name] = float(np.abs(alone - plain).max() / size)
    return dict(sorted(moves.items(), key=lambda move: -move[1]))


def _controls(instance: CircuitInstance, parasitics: Parasitics) -> np.ndarray:
    """Return the settled controls (m,) of the circuit with these parasitics."""
    level = instance.level
    parts = replace(level.datasheet, parasitics=parasitics)
    built = replace(instance, level=replace(level, datasheet=parts))
    return built.emulation.controls(built.settled)
