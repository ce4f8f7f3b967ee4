"""Networks in files that settle, oscillate or grow."""

import math
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from oscillators import chua, lorenz, lorenz_96, van_der_pol, wire

import ann_dc
from ann_dc.export.behaviour import behaviour
from ann_dc.network import ONE, Cell, Network, Neuron, Product, Waveform

FILE = Path("network.npz")


def wired(names, *wires, **start):
    cell = Cell(neurons=tuple(Neuron(name=name) for name in names), connections=wires)
    return Network(cell=cell, stages=1, start=start)


def modes(facts):
    """Growth rate and angular frequency of the sentence on an equilibrium."""
    words = facts["equilibrium"].split()
    growth = float(words[words.index("grow") + 2]) if "grow" in words else 0.0
    swing = float(words[words.index("oscillate") + 2]) if "oscillate" in words else 0.0
    return growth, swing


# eigenvalues of the linearisation: 0.75 +- i sqrt(7) / 4; (-11 + sqrt(1201)) / 2;
# F (e^(i a) - e^(-2 i a)) - 1 with a = 2 pi k / 5
GROWING = {
    "van der Pol": (van_der_pol(), 0.75 + 1j * math.sqrt(7) / 4),
    "Lorenz": (lorenz(), (-11 + math.sqrt(1201)) / 2),
    "Lorenz-96": (
        lorenz_96(),
        max((8 * (w - w**-2) - 1 for w in np.exp(2j * np.pi * np.arange(5) / 5)), key=np.real),
    ),
}


@pytest.mark.parametrize(("network", "mode"), GROWING.values(), ids=GROWING)
def test_oscillator_has_the_growth_and_frequency_of_its_linearisation(network, mode):
    facts, wrong = behaviour(network, FILE)
    assert wrong == ""
    assert facts["equilibrium"].startswith("unstable")
    assert modes(facts) == pytest.approx((mode.real, abs(mode.imag)), rel=5e-3)
    assert facts["next"].startswith("ann-dc run network.npz --duration ")
    assert facts["settles"].startswith("no ")


def test_undamped_oscillator_is_neither_stable_nor_unstable():
    facts, wrong = behaviour(wired("xy", wire("y", "x"), wire("x", "y", -4.0), x=1.0), FILE)
    assert wrong == ""
    assert facts["equilibrium"].startswith("undamped: deviations do not decay")
    assert modes(facts) == (0.0, 2.0)
    assert "--duration 50 " in facts["next"]  # 100 time constants of 1 / 2


def test_what_grows_without_bound_stays_wrong():
    facts, wrong = behaviour(wired("x", wire("x", "x"), x=1.0), FILE)
    assert "does not settle" in wrong
    assert modes(facts) == (1.0, 0.0)
    assert "next" not in facts


def test_ramp_has_no_equilibrium():
    facts, wrong = behaviour(wired("x", wire(ONE, "x")), FILE)
    assert wrong == ""
    assert facts["equilibrium"].startswith("none found")
    assert "next" in facts


def test_optimiser_that_does_not_settle_stays_wrong():
    blocks = Product(name="xx", a="u.x", b="u.x"), Product(name="xxy", a="xx", b="u.y")
    wires = (
        *(wire("u.y", "u.x"), wire("u.x", "u.y", -1.0)),
        *(wire("u.y", "u.y", 1.5), wire("xxy", "u.y", -1.5)),
    )
    neurons = Neuron(name="u.x"), Neuron(name="u.y")
    cell = Cell(neurons=neurons, blocks=blocks, connections=wires)
    facts, wrong = behaviour(Network(cell=cell, stages=1, start={"u.x": 0.1}), FILE)
    assert "does not settle" in wrong
    assert facts["equilibrium"].startswith("unstable")


def test_inputs_over_time_have_their_first_value():
    ramp = Waveform(times=[0.0, 10.0], values=[0.5, 3.0])
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("load",),
        connections=(wire("x", "x", -1), wire("load", "x")),
    )
    facts, wrong = behaviour(
        Network(cell=cell, stages=1, inputs={"load": 0.0}).with_inputs({"load": ramp}), FILE
    )
    assert wrong == ""
    assert facts["settles"].startswith("settled")


def test_suggested_command_runs(tmp_path):
    ann_dc.save(chua(), tmp_path / "chua.npz")
    code, text = run("inspect", tmp_path / "chua.npz")
    assert code == 0, text
    facts, _ = behaviour(chua(), tmp_path / "chua.npz")
    words = facts["next"].partition(" (")[0].split()[1:]
    code, text = run(*words)
    assert code == 0, text
    assert "completed" in text
