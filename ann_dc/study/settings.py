"""Settings that a study can vary, by name 'family.name' (``input.q_d.x``).

Another example is ``nonideal.mismatch``.

Subject of a study: a plant by name, a declared problem or a network.
"""

from __future__ import annotations

import difflib
import enum
import hashlib
import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ann_dc.backends.integration.methods import METHODS
from ann_dc.backends.step_rules import ORDERS
from ann_dc.dataclass_pickling import Record
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import AnnDcError, StudyError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import GainRule
from ann_dc.hardware.parts.datasheet import Datasheet, Kind as PartKind, Tolerances
from ann_dc.hardware.parts.e_series import SERIES
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import KINDS
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import WrittenProblem, declared, written
from ann_dc.solution.saved_result import Reader, Writer
from ann_dc.solver import synthesize
from ann_dc.study.model_levels import LEVELS
from ann_dc.study.records import SEED, Value
from ann_dc.two_level.coordination import COORDINATORS

ENDS = ("q_0", "q_d")


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject(Record):
    """Plant (by name), problem or network under study; see `subject_of`.

    A plant has the problem without settings, and all its parameters can be varied. The network is
    set only without a problem.
    """

    plant: str = ""
    problem: OptimalControlProblem | None = None
    network: Network | None = None

    @cached_property
    def wired(self) -> Network:
        """Network of the subject or of the problem without settings, for its names."""
        return self.network if self.network is not None else synthesize(self._problem)

    @property
    def _problem(self) -> OptimalControlProblem:
        if self.problem is None:
            raise StudyError("subject: expected a problem, got a network")
        return self.problem

    @property
    def name(self) -> str:
        """Display name."""
        return self.problem.name if self.problem is not None else self.wired.title

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of a problem."""
        if self.problem is None:
            return ()
        own = self._own if self.plant else ()
        states = [str(s) for s in self.problem.states]
        ends = [f"{end}.{state}" for end in ENDS for state in states]
        return tuple(dict.fromkeys([*own, "N", "dt", "temperature", *ends]))

    @property
    def _own(self) -> tuple[str, ...]:
        """Parameters of the plant that are a single number or name."""
        given = inspect.signature(plants.get(self.plant)).parameters.values()
        return tuple(p.name for p in given if not isinstance(p.default, tuple))

    def declared(self, given: Mapping[str, Value]) -> OptimalControlProblem:
        """Return the problem with some of its `parameters` set.

        Raises `StudyError` or `ProblemError` if the subject has no problem or a value is invalid.
        """
        problem, left = self._problem, dict(given)
        if self.plant:
            plant = plants.get(self.plant)
            taken: dict[str, Any] = {n: left.pop(n) for n in given if n in self._own}
            try:
                problem = plant(**taken) if taken else problem
            except AnnDcError:
                raise
            except (ArithmeticError, TypeError, ValueError) as error:
                given_values = ", ".join(f"{name} = {value!r}" for name, value in taken.items())
                raise StudyError(f"problem: {self.plant} with {given_values}: {error}") from error
        horizon = left.pop("N", None)
        if horizon is not None:
            problem = problem.with_horizon(horizon)  # type: ignore[arg-type]
        ends = {end: _end(problem, end, left) for end in ENDS}
        fields: dict[str, Any] = {n: left[n] for n in ("dt", "temperature") if n in left}
        fields |= {end: value for end, value in ends.items() if value is not None}
        return replace(problem, **fields) if fields else problem

    def identity(self) -> dict[str, Any]:
        """Return plain data that distinguish the subject."""
        if self.plant:
            return {"plant": self.plant}
        if self.problem is not None:
            record = written(self.problem)
            table = Writer().value(replace(record, inputs={}), "problem")
            return {"problem": table, "inputs": plain(record.inputs)}
        return {"network": self.wired.title, "digest": _digest(self.wired)}


def _end(problem: OptimalControlProblem, end: str, given: Mapping[str, Value]) -> list | None:
    """Return q_0 or q_d with some components set; None if none is set."""
    own = len(problem.states) - len(problem.handed_on)
    names = [str(s) for s in problem.states[:own]]
    if not any(f"{end}.{name}" in given for name in names):
        return None
    return [given.get(f"{end}.{n}", v) for n, v in zip(names, getattr(problem, end))]


def subject_of(given: str | OptimalControlProblem | Network) -> Subject:
    """Return the subject for a plant name, a problem or a network.

    Raises `UnknownNameError` if the plant does not exist.

    >>> subject_of("car").declared({"N": 12, "q_d.x": 4.0}).horizon
    12
    """
    if isinstance(given, str):
        return Subject(plant=given, problem=plants.get(given)())
    if isinstance(given, OptimalControlProblem):
        return Subject(problem=given)
    return Subject(network=given)


def subject_from(identity: Mapping[str, Any]) -> Subject:
    """Return the subject of a stored identity; nothing in it is executed.

    Raises `StudyError` for a network, whose identity contains only the digest, and for invalid
    content. Raises `AnnDcError` if the stored problem is invalid.
    """
    if isinstance(identity.get("plant"), str):
        return subject_of(identity["plant"])
    if "problem" not in identity:
        raise StudyError(
            "subject: the network of the study was declared in Python; run the study from Python"
        )
    record = Reader(None, None).record(  # type: ignore[arg-type]
        WrittenProblem, {**identity["problem"], "inputs": {}}, "problem"
    )
    inputs = {name: np.asarray(v, float) for name, v in identity.get("inputs", {}).items()}
    return Subject(problem=declared(replace(record, inputs=inputs)))


def plain(data: Any) -> Any:
    """Convert records to data that JSON can represent."""
    if isinstance(data, Mapping):
        return {str(name): plain(value) for name, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [plain(value) for value in data]
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    return data if isinstance(data, (str, int, float, bool, type(None))) else str(data)


def _digest(network: Network) -> str:
    """Return the digest of the names and numbers of a network."""
    tape = evaluator(network).tape
    parts = [str([*network.node_index]).encode(), *(a.tobytes() for a in tape)]
    parts.append(network.start_state.tobytes())
    return hashlib.sha256(b"".join(parts)).hexdigest()


STARTS = ("line", "zero", "random")
ALONE = "none"
"""Word for a network without two levels."""
TWO_LEVELS = (ALONE, *COORDINATORS)
BACKENDS = ("ode", "recurrent", "emulation", "spice")
CIRCUITS = ("emulation", "spice")
"""Backends that run circuits."""
TIMED = ("ode", "spice")
"""Backends whose runs can have a given duration."""
OF_NETWORKS = (
    "nonideal.",
    "initial_guess.",
    "run.method",
    "run.order",
    "run.step",
    "run.tolerance",
    "run.limit",
    "run.two_level",
)
"""Settings that circuits do not use."""
NONIDEAL = {
    "mismatch": "relative error of every synapse weight, one standard deviation, drawn",
    "time_constants": "relative error of every time constant, one standard deviation, drawn",
    "gain_error": "relative error of every product and function, one standard deviation, drawn",
    "offset": "bias at every neuron and sum, one standard deviation, drawn; network units",
    "leak": "DC gain of the integrators; infinite for none",
    "extra_pole": "one more pole behind every neuron, in radians per unit of network time",
    "slew": "largest rate of a neuron, network units per unit of network time",
    "saturation": "saturation limits of neurons, network units",
    "bits": "significant bits of every synapse weight",
    "noise": "density of white noise at every neuron, drawn; network units per root network time",
}
"""Non-idealities of the ideal network, in order of application."""


DRAWN = tuple(
    f"nonideal.{name}" for name, description in NONIDEAL.items() if "drawn" in description
)
"""Settings whose value is the size of a random quantity drawn from the seed of the case."""


class Effect(enum.Enum):
    """Effect of a setting, which determines the steps to repeat; the value is a description."""

    PROBLEM = "another problem, with a new design"
    DESIGN = "another design"
    NUMBERS = "other numbers of the same network"
    PARTS = "realisation of the network"
    RUN = "execution"


class Family(NamedTuple):
    """Settings whose names have the same first part; `names` returns the rest, for a subject."""

    effect: Effect
    description: str
    names: Callable[[Subject], Iterable[str]]


def _design(subject: Subject) -> Iterable[str]:
    if subject.problem is None:
        return ()
    factors = [f.name for f in fields(GainRule) if f.type == "float"]
    return ("form", "preconditioner", *factors)


def _gains(subject: Subject) -> Iterable[str]:
    neurons = subject.wired.cell.neurons
    duals = [dual.neuron for dual in subject.wired.cell.duals]
    places = dict.fromkeys(name for n in neurons for name in (n.population, n.name))
    return ("rho", "tau", "coarse", *(f"rho.{n}" for n in duals), *(f"tau.{n}" for n in places))


def _datasheet(_: Subject) -> Iterable[str]:
    figures = [f.name for f in fields(Datasheet) if f.type == "float"]
    return ("level", "bandwidth_margin", "series", *figures)


FAMILIES: dict[str, Family] = {
    "problem": Family(
        Effect.PROBLEM, "parameters and boundary conditions of the problem", lambda s: s.parameters
    ),
    "design": Family(Effect.DESIGN, "form, preconditioner, factors of the gain rule", _design),
    "gains": Family(
        Effect.NUMBERS, "factors on penalties, time constants, coarse-level gains", _gains
    ),
    "input": Family(Effect.NUMBERS, "inputs; gains are fixed", lambda s: s.wired.cell.inputs),
    "initial_guess": Family(Effect.NUMBERS, "initial guess", lambda _: ("kind", "spread")),
    "nonideal": Family(Effect.NUMBERS, "non-idealities of the ideal network", lambda _: NONIDEAL),
    "circuit": Family(Effect.PARTS, "level, parts and bandwidth margin of a circuit", _datasheet),
    "tolerance": Family(
        Effect.PARTS,
        "errors of single parts, drawn: bounds of resistors and capacitors, else one sigma",
        lambda _: [kind.value for kind in PartKind],
    ),
    "run": Family(
        Effect.RUN,
        "backend, integration method, update order, step, tolerance, limit, duration, coordinator",
        lambda _: (
            *("backend", "method", "order", "step", "tolerance", "limit", "duration"),
            "two_level",
        ),
    ),
}
"""Families by the first part of their names."""
WORDS: dict[str, Iterable[str]] = {
    "design.form": ("corrected", "printed", *SWITCHES),
    "design.preconditioner": KINDS,
    "initial_guess.kind": STARTS,
    "circuit.level": LEVELS,
    "circuit.series": SERIES,
    "run.backend": BACKENDS,
    "run.method": METHODS,
    "run.two_level": TWO_LEVELS,
    "run.order": ORDERS,
}
"""Settings with named values, and the valid names."""
RECORDS: dict[str, Callable[..., object]] = {
    "tolerance": Tolerances,
    "circuit": Datasheet,
    "design": GainRule,
}
"""Records whose fields a family sets; they reject numbers out of range."""
ENDLESS = (
    "run.limit",
    "nonideal.leak",
    "nonideal.extra_pole",
    "nonideal.slew",
    "nonideal.saturation",
)
"""Settings that an infinite value switches off."""
POSITIVE = (
    *ENDLESS,
    "problem.dt",
    "gains.",
    "circuit.bandwidth_margin",
    "run.step",
    "run.tolerance",
    "run.duration",
    "nonideal.bits",
)
"""Prefixes of settings with positive values."""
SIZES = ("nonideal.", "tolerance.", "problem.temperature")
"""Prefixes of settings with non-negative values."""
LEAST = {SEED: (0, "zero"), "problem.N": (1, "one")}
"""Smallest value of integer settings, and its name."""


def family_of(name: str) -> Family | None:
    """Return the family of an existing setting; None for the seed."""
    return FAMILIES.get(name.partition(".")[0])


def chosen(setting: Mapping[str, Value], *families: str) -> dict[str, Value]:
    """Return the values of some families by full name."""
    return {n: v for n, v in setting.items() if n.partition(".")[0] in families}


def behind(setting: Mapping[str, Value], family: str) -> dict[str, Any]:
    """Return the values of one family by the name after the first part.

    >>> behind({"input.q_d.x": 3.0, "run.order": "two-phase"}, "input")
    {'q_d.x': 3.0}
    """
    return {n.partition(".")[2]: v for n, v in chosen(setting, family).items()}


def backend_of(setting: Mapping[str, Value]) -> str:
    """Return the backend of a case; the default for a circuit is its emulation.

    >>> backend_of({}), backend_of({"tolerance.resistor": 0.01})
    ('ode', 'emulation')
    """
    default = "emulation" if chosen(setting, "circuit", "tolerance") else "ode"
    return str(setting.get("run.backend", default))


def is_built(setting: Mapping[str, Value]) -> bool:
    """Return True if a setting defines a circuit, run or used next to the network."""
    return bool(chosen(setting, "circuit", "tolerance")) or backend_of(setting) in CIRCUITS


def is_drawn(setting: Mapping[str, Value]) -> bool:
    """Return True if cases of this setting differ between seeds.

    >>> is_drawn({"nonideal.mismatch": 0.01}), is_drawn({"nonideal.mismatch": 0.0})
    (True, False)
    """
    guess = behind(setting, "initial_guess")
    sizes = [setting.get(name) for name in DRAWN]
    if guess.get("kind", "random") == "random":
        sizes.append(guess.get("spread", 1.0 if guess else 0.0))
    positive = (isinstance(size, (int, float)) and size > 0 for size in sizes)
    return bool(chosen(setting, "tolerance")) or any(positive)


def check_together(
    field: str, names: Iterable[str], backends: Iterable[str], others: Iterable[str] = ()
) -> None:
    """Raise `StudyError` for the first setting that none of the backends reads.

    The message begins with `field` and gives the reason. ``others`` are further settings.
    """
    met, given = {*backends}, {*names, *others}
    for name in names:
        if name.startswith(OF_NETWORKS) and met <= {*CIRCUITS}:
            raise StudyError(
                f"{field}: {name} changes the ideal network and its run, and circuits run; errors "
                "of parts are tolerance.*"
            )
        if name.startswith("tolerance.") and not met & {*CIRCUITS}:
            raise StudyError(
                f"{field}: {name} applies to parts, but no circuit is run; omit run.backend, or "
                f"use one of {', '.join(CIRCUITS)}"
            )
        _check_run(field, name, met, given)


def _check_run(field: str, name: str, met: set[str], given: set[str]) -> None:
    """Raise `StudyError` for a setting of runs that none of the backends reads."""
    if name in ("run.order", "run.step") and "recurrent" not in met:
        raise StudyError(f"{field}: {name} applies to run.backend = 'recurrent' only")
    if name == "nonideal.noise" and "run.duration" not in given:
        raise StudyError(f"{field}: {name} needs the duration of the run; set run.duration")
    if name == "run.method" and "ode" not in met:
        raise StudyError(f"{field}: {name} applies to run.backend = 'ode' only")
    if name == "run.duration" and "run.two_level" in given:
        raise StudyError(
            f"{field}: {name} is a network time, which run.two_level does not have; omit one of "
            "them"
        )
    if name == "run.limit" and "run.duration" in given:
        raise StudyError(f"{field}: a run with run.duration has no run.limit; omit it")
    if name == "run.duration" and not met <= {*TIMED}:
        raise StudyError(
            f"{field}: {name} is a network time, which a run has with run.backend = "
            f"{' or '.join(map(repr, TIMED))} only"
        )


def names_of(subject: Subject) -> tuple[str, ...]:
    """Return the names of all settings of a subject."""
    found = [f"{word}.{name}" for word, f in FAMILIES.items() for name in f.names(subject)]
    return (*found, SEED)


def check_name(subject: Subject, field: str, name: str) -> None:
    """Raise `StudyError` for an unknown setting, with the nearest names.

    The message begins with `field`.
    """
    known = names_of(subject)
    if name in known:
        return
    family = FAMILIES.get(name.partition(".")[0])
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else ""
    if family is None:
        known_names = (
            f"settings begin with {', '.join(f'{word}.' for word in FAMILIES)} or are {SEED!r}"
        )
    else:
        word, names = name.partition(".")[0], list(family.names(subject))
        listed = ", ".join(names) or "none for this subject"
        known_names = f"of {word}. ({family.description}) there are {listed}"
    raise StudyError(
        f"{field}: unknown setting {name!r}; {' '.join(filter(None, [hint, known_names]))}"
    )


def check_value(field: str, name: str, value: object) -> None:
    """Raise `StudyError` for an invalid value of a setting."""
    words = WORDS.get(name)
    if words is not None:
        if value not in tuple(words):
            near = difflib.get_close_matches(str(value), list(words), n=2, cutoff=0.5)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise StudyError(f"{field}: {name} is one of {', '.join(words)}, got {value!r}; {hint}")
        return
    if not isinstance(value, (int, float, str, bool)):
        raise StudyError(
            f"{field}: {name} expected a number or a word for each case, got {value!r}"
        )
    if isinstance(value, float) and math.isnan(value):
        raise StudyError(f"{field}: {name} is nan in a case; use a number")
    is_number = name in ("problem.N", "problem.dt", "problem.temperature")
    is_free = value == "adaptive" if name == "run.step" else name.startswith("problem.")
    if not isinstance(value, (str, bool)):
        _check_range(field, name, value)
    elif is_number or not is_free:
        raise StudyError(f"{field}: {name} expected a number for each case, got {value!r}")


def _check_range(field: str, name: str, value: float) -> None:
    """Raise `StudyError` for a number with which no case can be computed."""
    family, _, last = name.partition(".")
    least, begin = LEAST.get(name, (None, ""))
    expected = ""
    if least is not None and not (isinstance(value, int) and value >= least):
        expected = f"a whole number of at least {begin}"
    elif name.startswith(POSITIVE) and not value > 0:
        expected = "a positive number"
    elif name.startswith(SIZES) and not value >= 0:
        expected = "a number of at least 0"
    elif math.isinf(value) and family != "circuit" and name not in ENDLESS:
        expected = "a finite number"
    if expected:
        raise StudyError(f"{field}: {name} is {expected}, got {value!r}")
    if family in RECORDS and name != "circuit.bandwidth_margin":
        try:
            RECORDS[family](**{last: value})
        except AnnDcError as error:
            raise StudyError(f"{field}: {name}: {error}") from error
