"""Table of the candidates of a design."""

import re

from command_line import run
from rich.console import Console

import ann_dc
from ann_dc import solver
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.report.design import candidate_table


def shown(design, *requested):
    console = Console(width=100, color_system=None)
    with console.capture() as said:
        console.print(candidate_table(design, *requested))
    return " ".join(said.get().split())


def test_candidate_table_names_the_selected_kind_and_those_not_evaluated():
    network = solver.synthesize(ann_dc.plants.double_integrator(N=5))
    design = solver.design(network)
    text = shown(design)
    assert re.search(rf"{design.best.kind.value} \d+ \S+ \d+ selected", text)
    evaluated = {candidate.kind for candidate in design.candidates}
    listed = text.partition("not evaluated: ")[2]
    assert {kind for kind in PreconditionerKind if kind.value in listed} >= (
        {*PreconditionerKind} - evaluated
    )
    assert "cyclic reduction (represented by the resistive grid)" in text
    assert "is within a factor 3 of the limit)" in text
    assert "not evaluated" not in shown(design, [*evaluated])


def test_candidate_table_lists_only_requested_kinds():
    code, text = run("design", "double_integrator", "-N", "5", "--preconditioner", "diagonal")
    assert code == 0
    assert "not evaluated" not in text
    assert re.search(r"diagonal \d+ \S+ \d+ selected", " ".join(text.split()))
