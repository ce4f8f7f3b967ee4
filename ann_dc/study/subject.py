"""What a study is about: a plant by its name, a declared problem, or a network that is there."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import AnnDcError, StudyError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import WrittenProblem, declared, written
from ann_dc.solution.result_writer import Writer
from ann_dc.solution.saved_result import Reader
from ann_dc.solver import synthesize
from ann_dc.study.records import Value

ENDS = ("q_0", "q_d")


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject(Record):
    """One of the three; see `subject_of`.

    Attributes
    ----------
    plant : str
        Its name, if it is one; every parameter of it can be varied.
    problem : OptimalControlProblem or None
        The plant as it is without settings, or the declared problem.
    network : Network or None
        Only where there is no problem.
    """

    plant: str = ""
    problem: OptimalControlProblem | None = None
    network: Network | None = None

    @cached_property
    def wired(self) -> Network:
        """The network, or that of the problem without settings: for its names."""
        return self.network if self.network is not None else synthesize(self._problem)

    @property
    def _problem(self) -> OptimalControlProblem:
        if self.problem is None:
            raise StudyError("subject: this is a network, and no problem is known of it")
        return self.problem

    @property
    def name(self) -> str:
        """What people call it."""
        return self.problem.name if self.problem is not None else self.wired.title

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of what a problem may be declared with."""
        if self.problem is None:
            return ()
        own = self._own if self.plant else ()
        states = [str(s) for s in self.problem.states]
        ends = [f"{end}.{state}" for end in ENDS for state in states]
        return tuple(dict.fromkeys([*own, "N", "dt", "temperature", *ends]))

    @property
    def _own(self) -> tuple[str, ...]:
        """Parameters of the plant that are one number or word."""
        given = inspect.signature(plants.get(self.plant)).parameters.values()
        return tuple(p.name for p in given if not isinstance(p.default, tuple))

    def declared(self, given: Mapping[str, Value]) -> OptimalControlProblem:
        """The problem with some of its parameters set.

        Parameters
        ----------
        given : mapping of str to Value
            By their names in `parameters`.

        Returns
        -------
        OptimalControlProblem

        Raises
        ------
        StudyError, ProblemError
            If there is no problem, or none with such values.
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
                told = ", ".join(f"{name} = {value!r}" for name, value in taken.items())
                raise StudyError(f"problem: {self.plant} with {told}: {error}") from error
        horizon = left.pop("N", None)
        if horizon is not None:
            problem = problem.with_horizon(horizon)  # type: ignore[arg-type]
        ends = {end: _end(problem, end, left) for end in ENDS}
        fields: dict[str, Any] = {n: left[n] for n in ("dt", "temperature") if n in left}
        fields |= {end: value for end, value in ends.items() if value is not None}
        return replace(problem, **fields) if fields else problem

    def identity(self) -> dict[str, Any]:
        """As plain data, to tell one study from another."""
        if self.plant:
            return {"plant": self.plant}
        if self.problem is not None:
            record = written(self.problem)
            table = Writer().value(replace(record, inputs={}), "problem")
            return {"problem": table, "inputs": plain(record.inputs)}
        return {"network": self.wired.title, "digest": _digest(self.wired)}


def _end(problem: OptimalControlProblem, end: str, given: Mapping[str, Value]) -> list | None:
    """q_0 or q_d with some components set; None where none is."""
    own = len(problem.states) - len(problem.handed_on)
    names = [str(s) for s in problem.states[:own]]
    if not any(f"{end}.{name}" in given for name in names):
        return None
    return [given.get(f"{end}.{n}", v) for n, v in zip(names, getattr(problem, end))]


def subject_of(given: str | OptimalControlProblem | Network) -> Subject:
    """A plant's name, a problem or a network as the subject of a study.

    Parameters
    ----------
    given : str, OptimalControlProblem or Network

    Returns
    -------
    Subject

    Raises
    ------
    UnknownNameError
        If there is no such plant.

    Examples
    --------
    >>> subject_of("car").declared({"N": 12, "q_d.x": 4.0}).horizon
    12
    """
    if isinstance(given, str):
        return Subject(plant=given, problem=plants.get(given)())
    if isinstance(given, OptimalControlProblem):
        return Subject(problem=given)
    return Subject(network=given)


def subject_from(identity: Mapping[str, Any]) -> Subject:
    """The subject of an identity; nothing in it is executed.

    Parameters
    ----------
    identity : mapping
        From `Subject.identity`.

    Returns
    -------
    Subject

    Raises
    ------
    StudyError
        If it is a network, of which an identity has the digest alone, or no subject.
    AnnDcError
        If what is written is no problem.
    """
    if isinstance(identity.get("plant"), str):
        return subject_of(identity["plant"])
    if "problem" not in identity:
        raise StudyError(
            "subject: the study is one of a network that was declared in Python; run it from there"
        )
    record = Reader(None, None).record(  # type: ignore[arg-type]
        WrittenProblem, {**identity["problem"], "inputs": {}}, "problem"
    )
    inputs = {name: np.asarray(v, float) for name, v in identity.get("inputs", {}).items()}
    return Subject(problem=declared(replace(record, inputs=inputs)))


def plain(data: Any) -> Any:
    """Records' fields as what JSON can hold."""
    if isinstance(data, Mapping):
        return {str(name): plain(value) for name, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [plain(value) for value in data]
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    return data if isinstance(data, (str, int, float, bool, type(None))) else str(data)


def _digest(network: Network) -> str:
    """Of names and numbers."""
    tape = evaluator(network).tape
    parts = [str([*network.node_index]).encode(), *(a.tobytes() for a in tape)]
    parts.append(network.start_state.tobytes())
    return hashlib.sha256(b"".join(parts)).hexdigest()
