"""What stands behind the points of a study: problems, designs and circuits, each made once.

Points that differ in numbers only share all of them; so a study costs as many designs as it has
problems and forms, and as many circuits as it has levels.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, FORMS, Form
from ann_dc.errors import StudyError
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.rules.gains import apply_gains
from ann_dc.gain_design.rules.recipe import WITHOUT_COORDINATORS, Recipe
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import cost_of
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.e_series import SERIES
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.rails import with_rails
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solver import design, synthesize
from ann_dc.study.keeping.rows import Value
from ann_dc.study.varying.levels import level_of
from ann_dc.study.varying.settings import KINDS, behind, chosen, is_built
from ann_dc.study.varying.subject import Subject
from ann_dc.study.varying.variants import with_gains, with_inputs

MOST_KEPT = 16
"""Problems, designs, circuits and references that a process keeps, of each."""
EXACT = OdeBackend(settling=Settling(tolerance=1e-9), verify=False)
"""Runs what others are compared with."""
BUILDABLE = (Kind.TIME_CONSTANTS,)
"""The metric where a circuit is built and nothing else is said: any op amp can do it."""
Made = TypeVar("Made")


class Designed(NamedTuple):
    """A network with constants for good.

    Attributes
    ----------
    network : Network
    settled : (n,) array
        Where the design found it to rest; its start for a network that was given.
    """

    network: Network
    settled: np.ndarray


class Built(NamedTuple):
    """A circuit of a design.

    Attributes
    ----------
    circuit : Circuit
    level : Level
    probe : Trajectory
        The ideal network's run that it was scaled by.
    backend : SpiceBackend
        That builds it.
    """

    circuit: Circuit
    level: Level
    probe: Trajectory
    backend: SpiceBackend

    def deviations(self, setting: Mapping[str, Value], seed: int) -> Deviations:
        """Errors of its parts: of a series, and drawn where tolerances are set.

        Parameters
        ----------
        setting : mapping of str to Value
        seed : int
            Of the point.
        """
        off, known = self.backend.deviations(self.circuit), self.circuit.parameters
        if not chosen(setting, "tolerance"):
            return off
        return combined(known, off, draw(known, self.level.tolerances, seed))

    @property
    def power(self) -> float:
        """Watts of its op amps and multipliers; nan where a level does not say."""
        deck = self.backend.deck(self.circuit, self.probe, {})
        loads = load_power(self.circuit, self.level, self.probe.final)
        return cost_of(deck.parts, self.level.datasheet, float("nan"), loads).power


@dataclass(frozen=True, eq=False)
class Realisation:
    """What is made for a study, kept while a process works on it.

    Attributes
    ----------
    subject : Subject
    """

    subject: Subject
    _made: dict[str, dict] = field(default_factory=dict)
    _making: Any = field(default_factory=threading.RLock)

    def _kept(self, what: str, setting: Mapping[str, Any], make: Callable[[], Made]) -> Made:
        """What was made for these values before, or is made now."""
        key = tuple(sorted(setting.items()))
        with self._making:
            shelf = self._made.setdefault(what, {})
            if key not in shelf:
                made = make()
                if len(shelf) >= MOST_KEPT:
                    shelf.pop(next(iter(shelf)))
                shelf[key] = made
            return shelf[key]

    def problem(self, setting: Mapping[str, Value]) -> OptimalControlProblem | None:
        """The problem as it was designed for; None of a network without one.

        Parameters
        ----------
        setting : mapping of str to Value
        """
        if self.subject.problem is None:
            return None
        given = behind(setting, "problem")
        return self._kept("problem", given, lambda: self.subject.declared(given))

    def designed(self, setting: Mapping[str, Value]) -> Designed:
        """The network of a setting as it was designed.

        Parameters
        ----------
        setting : mapping of str to Value

        Returns
        -------
        Designed

        Raises
        ------
        StudyError
            If the design settled nowhere.
        """
        problem = self.problem(setting)
        if problem is None:
            return Designed(self.subject.wired, self.subject.wired.start_state)
        given = chosen(setting, "problem", "design") | {"": is_built(setting)}
        kinds = BUILDABLE if is_built(setting) else ALL_KINDS
        return self._kept("form", given, lambda: self._in_form(problem, given, kinds))

    def _in_form(
        self, problem: OptimalControlProblem, given: Mapping[str, Any], kinds: tuple[Kind, ...]
    ) -> Designed:
        """A problem's network; a printed form has the gains of the corrected one."""
        form = FORMS[str(given.get("design.form", "corrected"))]
        lender = form.designable
        factors = {n: v for n, v in behind(given, "design").items() if n != "form"}
        lent = {**given, "design.form": str(lender)}
        found = self._kept("design", lent, lambda: _found(problem, lender, factors, kinds))
        if form == lender:
            return Designed(found.network, found.state)
        network = apply_gains(synthesize(decompose(problem, form)), found.gains)
        return Designed(network, found.state)

    def built(self, setting: Mapping[str, Value]) -> Built:
        """The circuit of a setting: its level, prepared and scaled.

        Parameters
        ----------
        setting : mapping of str to Value

        Returns
        -------
        Built

        Raises
        ------
        NetworkError
            If the network does not settle, or the level cannot build it.
        """
        parts = chosen(setting, "problem", "design", "gains", "input", "circuit", "tolerance")
        return self._kept("circuit", parts, lambda: self._build(setting))

    def _build(self, setting: Mapping[str, Value]) -> Built:
        circuit = behind(setting, "circuit")
        network = self.nominal(setting)
        level = with_rails(network, level_of(circuit, behind(setting, "tolerance")))
        series = SERIES[str(circuit.get("series", "exact"))]
        backend = SpiceBackend(level=level, series=series, require_stable=False)
        if "margin" in circuit:
            backend = replace(backend, margin=float(circuit["margin"]))
        built, probe = backend.prepare(network)
        return Built(built, level, probe, backend)

    def nominal(self, setting: Mapping[str, Value]) -> Network:
        """The network of a setting without any defect, from the straight line.

        Parameters
        ----------
        setting : mapping of str to Value
        """
        network = with_gains(self.designed(setting).network, behind(setting, "gains"))
        return with_inputs(network, behind(setting, "input"))

    def settled(self, setting: Mapping[str, Value]) -> np.ndarray:
        """State (n,) where the nominal network of a setting rests, for the oracle of (33).

        Parameters
        ----------
        setting : mapping of str to Value
        """
        if not behind(setting, "input"):
            return self.designed(setting).settled
        given = chosen(setting, "problem", "design", "gains", "input")
        return self._kept("settled", given, lambda: self._rest(given))

    def _rest(self, setting: Mapping[str, Value]) -> np.ndarray:
        return EXACT.run(self.nominal(setting)).trajectory.final

    def right_controls(self, setting: Mapping[str, Value]) -> tuple[np.ndarray, float]:
        """Controls (c,) to which the nominal network of a setting settles, in network units.

        Of a printed form, those of the corrected one: what is right does not depend on a slip.

        Parameters
        ----------
        setting : mapping of str to Value

        Returns
        -------
        controls : (c,) array
            nan where it does not settle.
        size : float
            Size to which their errors are related; see `size_of`.
        """
        given = chosen(setting, "problem", "input")
        if "design.kind" in setting:
            given["design.kind"] = setting["design.kind"]
        if is_built(setting):  # whose design it shares
            given["circuit.level"] = "macro"

        def settle() -> tuple[np.ndarray, float]:
            run = EXACT.run(self.nominal(given))
            found, size = run.trajectory.control_values[-1], run.trajectory.control_size
            return found if run.status.settled else np.full(found.shape, np.nan), size

        return self._kept("right controls", given, settle)


def _found(
    problem: OptimalControlProblem,
    form: Form,
    factors: dict[str, Value],
    kinds: tuple[Kind, ...],
) -> Design:
    """The design of a problem in a form that can be designed.

    Raises
    ------
    StudyError
        If it settled nowhere.
    """
    if "kind" in factors:
        kinds = (KINDS[str(factors.pop("kind"))],)
    source = problem if form == CORRECTED else synthesize(decompose(problem, form))
    found = design(source, kinds=kinds, recipe=_recipe(kinds, factors))
    if not found.settled:
        why = f": {found.first.ended}" if found.first.ended else ""
        raise StudyError(f"design: its first run did not settle{why}")
    return found


def _recipe(kinds: tuple[Kind, ...], given: Mapping[str, Value]) -> Recipe | None:
    """A recipe with the factors that are set, None where none is."""
    if not given:
        return None
    if len(kinds) > 1:
        raise StudyError(
            f"design.{next(iter(given))}: a factor of the recipe needs design.kind, one of "
            f"{', '.join(KINDS)}"
        )
    kind = next(iter(kinds))
    base = WITHOUT_COORDINATORS if kind is Kind.TIME_CONSTANTS else Recipe()
    return replace(base, kind=kind, **given)
