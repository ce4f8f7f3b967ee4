"""Listing of one cell of a network: neurons, blocks, boundaries and their inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

from ann_dc.decomposition.equations import StageEquations, rounded
from ann_dc.network.cell import Block, Function, Product
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import scales_of
from ann_dc.report.json_file import picked
from ann_dc.report.tables import span, table
from ann_dc.scale import Scale
from ann_dc.si_prefixes import counted, lasting


def cell_listing(network: Network) -> list[Any]:
    """Return a heading, tables of neurons and blocks, and a text of the boundaries."""
    cell = network.cell
    arriving: dict[str, list[str]] = {}
    for wire in cell.connections:
        read = f"{span(wire.weight)} {wire.source}{wire.where}"
        arriving.setdefault(wire.target, []).append(read)
    neurons = table("neuron", "role", "tau dx/ds = sum of")
    for neuron in cell.neurons:
        reads = ", ".join(arriving.get(neuron.name, ["-"]))
        name = f"{neuron.name} (shared by all cells)" if neuron.shared else neuron.name
        neurons.add_row(name, neuron.role.value, reads)
    blocks = table("block", "kind", "computes")
    for block in cell.blocks:
        blocks.add_row(block.name, type(block).__name__.lower(), _computes(block, arriving))
    head = f"{network.title}: {counted(network.stages, 'cells')}, all equal to this one"
    return [head, neurons, blocks, _ends(network)]


def _ends(network: Network) -> str:
    ends = [f"{p.neuron} of cell {p.stage} is the input {p.input}" for p in network.fixed]
    ends += [f"{a.neuron} of cell {a.stage} is omitted" for a in network.omitted]
    return "\n".join([f"inputs: {', '.join(network.cell.inputs)}", "ends:", *ends])


def _computes(block: Block, arriving: Mapping[str, list[str]]) -> str:
    if isinstance(block, Product):
        return f"{block.a} times {block.b}"
    if isinstance(block, Function):
        return f"{block.function} of {block.x}"
    return ", ".join(arriving.get(block.name, ["-"]))


def scale_table(problem: OptimalControlProblem) -> Table:
    """Return a table of the physical values of network one and network zero, by name."""
    shown = table("scale of", "a network value of 1 is", "a network's zero is", dense=True)
    for name, scale in _named_scales(problem).items():
        unit = problem.unit(name).removesuffix("1")  # "1" stands for none
        shown.add_row(name, f"{scale.factor:.6g} {unit}", f"{scale.offset:.6g} {unit}")
    shown.add_row("cost", f"{scales_of(problem).cost:.6g} {problem.cost_unit}", "0")
    return shown


def _named_scales(problem: OptimalControlProblem) -> dict[str, Scale]:
    """Return the scales of states and controls by neuron."""
    scales = scales_of(problem)
    states = ((f"q.{s}", scale) for s, scale in zip(problem.states, scales.states))
    controls = ((f"u.{s}", scale) for s, scale in zip(problem.controls, scales.controls))
    return dict([*states, *controls])


def network_dict(equations: StageEquations, network: Network) -> dict[str, Any]:
    """Return equations, cell and scales of a network as data for JSON."""
    problem, cell = equations.problem, network.cell
    scales = {
        name: picked(scale, "factor", "offset") for name, scale in _named_scales(problem).items()
    }
    return {
        "problem": problem.name,
        "form": str(equations.form),
        "states": [*map(str, problem.states)],
        "controls": [*map(str, problem.controls)],
        "horizon": problem.horizon,
        "units": {**problem.units, "time": problem.time_unit},
        "lagrangian": str(equations.lagrangian),
        "equations": [
            {
                "number": number,
                "variable": str(each.variable),
                "expression": str(each.expression),
                "sign": each.sign,
            }
            for number, each in equations.numbered
        ],
        "inequalities": [*map(str, (*equations.rows, *equations.end_rows))],
        **picked(network, "size", "stages"),
        "neurons": [{**picked(n, "name", "shared"), "role": n.role.value} for n in cell.neurons],
        "blocks": [{**asdict(b), "kind": type(b).__name__.lower()} for b in cell.blocks],
        "connections": [picked(c, "source", "target", "weight", "where") for c in cell.connections],
        "inputs": cell.inputs,
        "scales": {**scales, "cost": {"factor": scales_of(problem).cost, "offset": 0.0}},
    }


def remarks(problem: OptimalControlProblem) -> list[str]:
    """Return descriptions of the step length, inequalities and bounds of a problem.

    The list is empty if none are declared.

    Examples
    --------
    >>> import sympy as sp
    >>> x, a = sp.symbols("x a")
    >>> problem = OptimalControlProblem(
    ...     states=(x,), controls=(a,), map=(x + a,), cost=a**2, horizon=3, q_0=(2,),
    ...     constraints={"disc": x**2 + a**2 >= 1}, bounds={x: (0, None)}, units={x: "m"})
    >>> print(*remarks(problem))
    at every stage: disc, a**2 + x**2 >= 1
    bounds: 0 <= x, in m
    """
    reported = [_step_sentence(problem)] if problem.handed_on else []
    every: Any = problem.constraints
    last: Any = problem.terminal_constraints
    held = [f"at every stage: {name}, {rounded(relation)}" for name, relation in every.items()]
    held += [f"at the end: {name}, {rounded(relation)}" for name, relation in last.items()]
    bounds: Mapping[str, Any] = problem.bounds
    for name, (low, high) in bounds.items():
        unit = problem.unit(name).removesuffix("1")  # "1" stands for none
        below, above = (f"{low:g} <= " * (low > -np.inf), f" <= {high:g}" * (high < np.inf))
        held.append(f"bounds: {below}{name}{above}" + (f", in {unit}" if unit else ""))
    return reported + (["\n".join(held)] if held else [])


def _step_sentence(problem: OptimalControlProblem) -> str:
    """Return the bounds, formula and initial guess of a variable step length."""
    step: Any = problem.dt
    guess, total = (
        problem.timed(f"{value:.4g}") for value in (step.guess, problem.horizon * step.guess)
    )
    return (
        f"step length {step.symbol}: {problem.interval}, determined by the network from the "
        f"initial value {guess}, so that {lasting(problem.horizon)} {total};\n{step.symbol} = "
        f"{rounded(step.expression)}"
    )
