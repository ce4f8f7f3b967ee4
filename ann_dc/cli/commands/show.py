"""``ann-dc show``: what is wired for a problem, before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ann_dc.cli.arguments.backends import FormOption, form_of
from ann_dc.cli.arguments.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    problem_of,
)
from ann_dc.cli.terminal import console, progress_line
from ann_dc.report.tables import span, table

if TYPE_CHECKING:
    from ann_dc.network.cell import Block
    from ann_dc.network.network import Network


def show(
    problem: ProblemArgument,
    equations: Annotated[
        bool, typer.Option("--equations", help="The equations (11)-(15) of a stage.")
    ] = False,
    cell: Annotated[
        bool, typer.Option("--cell", help="The cell: neurons, blocks and connections.")
    ] = False,
    counts: Annotated[
        bool, typer.Option("--counts", help="How many parts the network has.")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="The equations as LaTeX.")] = False,
    form: FormOption = "corrected",
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
) -> None:
    """Show what is wired for a problem: equations, cell, counts.

    Without options: the equations as text, and the counts. Time constants
    tau and weights are in network units, before gains are designed.

    Examples:

      ann-dc show car
      ann-dc show car --cell
      ann-dc show demos/pendulum.toml --latex > equations.tex
    """
    with progress_line() as progress:
        from ann_dc.decomposition.equations import decompose
        from ann_dc.decomposition.latex import as_latex
        from ann_dc.synthesis.synthesis import synthesize

        stage = decompose(problem_of(problem, settings or (), horizon, q_0, q_d), form_of(form))
        chosen = equations or cell or counts or latex
        parts: list[Any] = []
        if equations or latex or not chosen:
            progress("writing the equations")
            parts.append(as_latex(stage) if latex else str(stage))
        if cell or counts or not chosen:
            progress("wiring the network")
            network = synthesize(stage)
            parts += _cell_listing(network) if cell else []
            parts += [str(network)] if counts or not chosen else []
    for number, part in enumerate(parts):
        if number:
            console().print()
        console().print(part, soft_wrap=isinstance(part, str))


def _cell_listing(network: Network) -> list[Any]:
    """Neurons, blocks and ends of a cell, each with what it reads."""
    cell = network.cell
    arriving: dict[str, list[str]] = {}
    for wire in cell.connections:
        where = f"@{wire.template.name.lower()}" if wire.template else ""
        arriving.setdefault(wire.target, []).append(f"{span(wire.weight)} {wire.source}{where}")
    neurons = table("neuron", "role", "tau dx/ds = sum of")
    for neuron in cell.neurons:
        reads = ", ".join(arriving.get(neuron.name, ["-"]))
        neurons.add_row(neuron.name, neuron.role.value, reads)
    blocks = table("block", "kind", "computes")
    for block in cell.blocks:
        blocks.add_row(block.name, type(block).__name__.lower(), _computes(block, arriving))
    ends = [f"{p.neuron} of cell {p.stage} is the input {p.input}" for p in network.pins]
    ends += [f"{a.neuron} of cell {a.stage} is left out" for a in network.absent]
    inputs = ", ".join(cell.inputs)
    head = f"{network.title}: {network.stages} cells, all wired like this one"
    return [head, neurons, blocks, "\n".join([f"inputs: {inputs}", "ends:", *ends])]


def _computes(block: Block, arriving: Mapping[str, list[str]]) -> str:
    from ann_dc.network.cell import Function, Product

    if isinstance(block, Product):
        return f"{block.a} times {block.b}"
    if isinstance(block, Function):
        return f"{block.function} of {block.x}"
    return ", ".join(arriving.get(block.name, ["-"]))
