"""The loop: every sample has its own inputs and domains, at every step."""

from dataclasses import replace

import numpy as np
from recurrent_runs import RECURRENT, assert_same_end, pole, wire

from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import FixedStep
from ann_dc.network.cell import Cell, Function, Neuron
from ann_dc.network.network import Network


def test_a_reciprocal_keeps_its_side_of_the_pole():
    """A step of 2 would lead from 3 to -1/3; short ones settle at 1/2."""
    run = replace(RECURRENT, step=FixedStep(step=0.2)).run(pole())
    assert_same_end(run, np.array([0.5]))
    run = replace(RECURRENT, step=FixedStep(step=2.0)).run(pole())
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "r [0]"
    assert run.steps == 1
    np.testing.assert_allclose(run.trajectory.final, -1 / 3, rtol=1e-12)


def test_samples_keep_their_inputs():
    """x' = push - x settles at its own push, whoever has left before it."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("push",),
        connections=(wire("x", "x", -1.0), wire("push", "x")),
    )
    network, push = Network(cell=cell, stages=2, inputs={"push": 0.0}), np.linspace(1.0, 2.0, 9)
    x = np.where(np.isin(np.arange(9), [0, 2, 3, 6, 7, 8]), push, 0.0)
    backend = replace(RECURRENT, step=FixedStep(step=0.5))
    run = backend.run_batch(network, {"push": push}, np.stack([x, x], axis=1))
    assert (run.steps > 0).tolist() == (x == 0).tolist()
    np.testing.assert_allclose(run.states, np.stack([push, push], axis=1), atol=1e-8)


def swinging_out() -> Network:
    """A damped swing of x around zero that is beyond a right angle for three steps of 0.3."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Function(name="g", function="tan", x="x"),),
        connections=(
            wire("x", "x", -0.3), wire("y", "x"), wire("x", "y", -1.0), wire("y", "y", -0.3),
            wire("g", "x", 0.0),
        ),
    )  # fmt: skip
    return Network(cell=cell, stages=1, start={"x": 1.4, "y": 1.4})


def test_a_batch_sees_what_a_run_sees():
    """Also between two looks at who has settled."""
    backend = replace(RECURRENT, step=FixedStep(step=0.3))
    assert backend.run(swinging_out()).status.outcome is Outcome.LEFT_DOMAIN
    assert backend.run_batch(swinging_out(), {}).outcomes == (Outcome.LEFT_DOMAIN,)


def test_a_reciprocal_of_zero_is_outside_its_domain():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="r", function="reciprocal", x="x"),),
        connections=(wire("r", "x"), wire("one", "x", -1.5)),
    )
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    run = RecurrentBackend(step=FixedStep(step=2.0)).run(network)
    assert run.status.outcome is Outcome.LEFT_DOMAIN
