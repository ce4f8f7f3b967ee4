"""Transconductors: their cards add up to the weights, and ngspice shows curvature and leak."""

import re

import numpy as np
import pytest
from designs import small
from simulator import needs_ngspice
from wired import instances, prepared

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.netlist.cells import cell_of
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.netlist.values import Nodes, Values
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import ota_c
from ann_dc.network.preconditioners.base import PreconditionerKind


def test_pairs_and_single_ones_add_up_to_the_weights():
    """Whatever shares a pair, every source weighs -1 / R with the sign of its node."""
    network = design(small("car"), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    circuit, _ = SpiceBackend(level=ota_c()).prepare(network)
    nodes, values = Nodes(circuit), Values(circuit=circuit, deviations={})
    cell = cell_of(nodes, values, ota_c(), 2)
    cards = " \n".join(cell.lines).replace("\n+ ", "").splitlines()
    for part in circuit.schematic.parts:
        if part.name not in circuit.resistors:
            continue
        alias, found = circuit.alias[part.name], {}
        for card in cards:
            match = re.match(rf"X\w*?_{alias}_\d+ (.*) (ota|ota_diff) gm={{(\w+)}}", card)
            if match and match[1].split()[-1] == alias:
                gm, ends = cell.values[match[3]], match[1].split()[:-1]
                for node, sign in zip(ends, (1, -1)):
                    found[node] = found.get(node, 0.0) + sign * gm
        wanted: dict[str, float] = {}
        for resistor in values.resistors(nodes, part, 2):
            node = cell.ports[nodes.plain(resistor.source)]
            wanted[node] = wanted.get(node, 0.0) - nodes.sign(resistor.source) / resistor.ohms
        assert found == pytest.approx(wanted), part.name


def run_of(level):
    return simulate(SpiceBackend(level=level), *prepared(level.technology.differential))


def controls(run) -> np.ndarray:
    return run.trajectory.final[run.trajectory.network.of_population("u")]


@needs_ngspice
@pytest.mark.slow
def test_the_error_of_transconductors_falls_with_the_square_of_their_linear_range():
    """tanh(v / VL) VL = v - v^3 / (3 VL^2): twice the range, a quarter of the error."""
    errors = [run_of(ota_c(linear_range=v)).control_error for v in (10.0, 20.0, 40.0)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.03)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.03)
    assert errors[0] * 10**2 == pytest.approx(0.1737, rel=0.05)


@pytest.mark.slow
@needs_ngspice
def test_the_error_of_leaks_falls_as_one_over_the_gain():
    """An integrator of gain A0 leaks into A0 times the resistors of its inputs in parallel."""
    best = controls(run_of(ota_c(linear_range=1e3)))
    errors = [
        np.abs(controls(run_of(ota_c(linear_range=1e3, a0=a0))) - best).max() for a0 in (1e4, 1e5)
    ]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.02)


def test_transconductors_need_no_op_amps_and_pair_up():
    circuit, _ = prepared(True)
    level = ota_c()
    text = deck_of(circuit, level, duration=1.0).text
    assert not re.search(r"\bopamp", text[text.index("* ---- cells") :])
    assert ".subckt opamp" not in text
    assert not instances(text, "inv")
    assert instances(text, "ota_diff")
    defined = re.split(r"^\.subckt ", text, flags=re.MULTILINE)[1:]
    behavioural = {d.split()[0] for d in defined if re.search(r"^B", d, re.MULTILINE)}
    functions = {name for name in behavioural if name.startswith("func_")}
    assert behavioural - functions == {"ota", "ota_diff", "mul4q"}
