"""Clamps that have to hold more than their op amps can give: a larger margin, or a refusal."""

import re
from dataclasses import replace

import numpy as np
import pytest
from constrained import cart
from simulator import needs_ngspice

from ann_dc import PreconditionerKind, SpiceBackend, design
from ann_dc.errors import NetworkError
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.sizing.bandwidth_margin import check_clamps, holding_margin
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.network.waveforms import Waveform

MACRO = macro(output_swing=13.0)


def two(push: float) -> Network:
    """x' = push - x up to 1/2, and y' = x - y."""
    ends = (("x", "x", -1.0), ("one", "x", push), ("y", "y", -1.0), ("x", "y", 1.0))
    return Network(
        stages=1,
        cell=Cell(
            neurons=(Neuron(name="x", limiter=Limiter(high=0.5)), Neuron(name="y")),
            connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends),
        ),
    )


@pytest.mark.parametrize("push", [2.0, 8.0])
def test_the_margin_is_that_of_the_volts_that_a_clamp_gives(push):
    """The slope that is cut off, (push - 1/2) / 0.6 V per unit, across 50 / (2 pi GBW C)."""
    circuit, probe = SpiceBackend(level=MACRO).prepare(two(push))
    volts = 50 * (push - 0.5) / 0.6  # with a margin of one, and a fastest time constant of one
    least = holding_margin(circuit, MACRO, probe.final)
    assert least == pytest.approx(volts / (0.7 * 13 - 0.6), rel=1e-9)
    assert circuit.scaling.bandwidth_margin == pytest.approx(max(10.0, least), rel=0.1)
    assert circuit.scaling.bandwidth_margin >= least


def test_what_is_free_presses_nothing():
    circuit, probe = SpiceBackend(level=MACRO).prepare(two(0.4))
    assert holding_margin(circuit, MACRO, probe.final) == 0
    assert circuit.scaling.bandwidth_margin == 10


def test_a_margin_that_is_too_small_is_refused_with_one_that_is_not():
    with pytest.raises(NetworkError, match="for the op amps of the clamps") as refused:
        SpiceBackend(level=MACRO, bandwidth_margin=20).prepare(two(8.0))
    enough = float(re.search(r"a margin of (\S+) or more", str(refused.value))[1])
    circuit, _ = SpiceBackend(level=MACRO, bandwidth_margin=enough).prepare(two(8.0))
    assert circuit.scaling.bandwidth_margin == enough


@pytest.mark.sampled(1)
@pytest.mark.parametrize("last", [0.0, 8.0])
def test_clamps_hold_at_every_moment_of_a_run(last):
    """The input presses the limit as two(8) does, in the middle of the run or up to its end."""
    cell = replace(
        two(0.0).cell,
        inputs=("push",),
        connections=(
            *(c for c in two(0.0).cell.connections if c.source != "one"),
            Connection(source="push", target="x", weight=1.0),
        ),
    )
    push = Waveform(times=[0.0, 4.0, 9.0, 12.0], values=[0.0, 8.0, 8.0, last])
    network = replace(two(0.0), cell=cell, inputs={"push": 0.0}).with_inputs({"push": push})
    backend = SpiceBackend(level=MACRO, duration=20.0, bandwidth_margin=20)
    with pytest.raises(NetworkError, match="for the op amps of the clamps"):
        backend.prepare(network)
    assert (
        SpiceBackend(level=MACRO, duration=20.0).prepare(network)[0].scaling.bandwidth_margin > 20
    )


def test_rails_below_the_drop_of_a_diode_hold_nothing():
    circuit, probe = SpiceBackend(level=MACRO).prepare(two(2.0))
    weak = macro(output_swing=0.8)
    least = holding_margin(circuit, weak, probe.final)
    with pytest.raises(
        NetworkError, match=r"swing of 0\.8 V; use parts with a larger output swing"
    ):
        check_clamps(circuit, weak, least)


@pytest.mark.slow
@needs_ngspice
def test_controls_that_are_pressed_hard_stay_at_their_bounds():
    """At a margin of 10 they settled at up to seven times their bounds."""
    run = SpiceBackend(level=MACRO).run(
        design(cart(), preconditioner=PreconditionerKind.DIAGONAL).network
    )
    said = predict(run.circuit, MACRO, run.probe)
    assert run.circuit.scaling.bandwidth_margin > 20
    assert run.settled()
    assert run.control_error < 2e-5
    assert said.control_error == pytest.approx(run.control_error, rel=0.05)
    assert said.settling_time == pytest.approx(run.settling_time(), rel=0.02)
    sizes = np.abs(run.probe.control_values[-1].ravel())
    assert (sizes == sizes.max()).sum() == 4
