"""Who has settled and who is lost: counted as if alone, and kept in place."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from recurrent_runs import RECURRENT, growing, short, targets, wire
from torch.utils._python_dispatch import TorchDispatchMode

import ann_dc
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE, FixedStep
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.network import Network


def leak() -> Cell:
    """x' = -x."""
    return Cell(neurons=(Neuron(name="x"),), connections=(wire("x", "x", -1.0),))


def test_the_last_step_counts_too():
    """1e-9 lies between 2^-29 and 2^-30."""
    network, step = Network(cell=leak(), stages=1, start={"x": 1.0}), FixedStep(step=0.5)
    backend = replace(RECURRENT, step=step)
    assert backend.run(network).steps == 30
    assert not replace(backend, limit=29).run(network).status.settled
    assert replace(backend, limit=30).run(network).status.settled


@pytest.mark.slow
def test_samples_count_their_steps_as_if_alone():
    layer = RecurrentLayer(short("unicycle"), step=FixedStep(step=0.3))
    inputs = targets("unicycle", 6)
    together = layer.settle(inputs=inputs)
    assert len(set(together.steps.tolist())) > 1
    for sample in range(6):
        alone = layer.settle(inputs={name: value[[sample]] for name, value in inputs.items()})
        assert abs(int(together.steps[sample] - alone.steps[0])) <= 1  # rounding
        assert abs(int(together.settling_steps[sample] - alone.settling_steps[0])) <= 1
        np.testing.assert_allclose(together.states[sample], alone.states[0], atol=1e-7)


@pytest.mark.slow
def test_samples_keep_their_places():
    """Those that start settled leave first; the others move up, and come back to their places."""
    network = short("unicycle")
    x = np.repeat(network.start_state[None], 9, axis=0)
    goals = np.linspace(1.5, 2.5, 9)
    done = RECURRENT.run_batch(network, {"q_d.x": goals}).states
    early = [0, 2, 3, 6, 7, 8]
    x[early] = done[early]
    run = RECURRENT.run_batch(network, {"q_d.x": goals}, x)
    assert run.settled.all()
    assert (run.steps[early] == 0).all()
    assert (np.delete(run.steps, early) > 100).all()
    np.testing.assert_allclose(run.states, done, atol=1e-6)
    t = network.neuron_index["t.x"]
    ends = [run.network_of(i).unpack(x)[t, -1] for i, x in enumerate(run.states)]
    np.testing.assert_allclose(ends, network.input_scale("q_d.x").network(goals), rtol=1e-15)


def test_a_large_sample_does_not_hide_that_another_diverges():
    """Divergence is told from a sample's own start."""
    backend, x = replace(RECURRENT, step=FixedStep(step=0.5)), np.array([[0.0] * 3, [1e30] * 3])
    alone = backend.run_batch(growing(), {"push": [1.0]}, x[:1])
    both = backend.run_batch(growing(), {"push": [1.0, 0.0]}, x)
    assert alone.outcomes[0] is both.outcomes[0] is Outcome.DIVERGED
    assert both.steps[0] == alone.steps[0]


class Waits(TorchDispatchMode):
    """Counts what makes a processor wait for a GPU: numbers read, and chosen by truth values."""

    count = 0

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        name = operation.overloadpacket.__name__
        chosen = args[1] if name in ("index", "index_put", "index_put_") else ()
        by_truth = any(at is not None and at.dtype == torch.bool for at in chosen)
        self.count += by_truth or name in ("_local_scalar_dense", "nonzero", "masked_select")
        return operation(*args, **(kwargs or {}))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "order", [SIMULTANEOUS, TWO_PHASE, pytest.param(STAGE_BY_STAGE, marks=pytest.mark.slow)]
)
def test_nobody_waits_between_two_looks(monkeypatch, order):
    """And a look at which nobody is done is one wait."""
    monkeypatch.setattr(ann_dc.progress.clock, "monotonic", lambda: 0.0)  # a line told is a wait
    layer = RecurrentLayer(short("unicycle"), order=order)
    few, many, never = Waits(), Waits(), Settling(tolerance=1e-30)
    with few:
        layer.settle(inputs=targets("unicycle", 6), settling=never, check=20, limit=40)
    with many:
        layer.settle(inputs=targets("unicycle", 6), settling=never, check=20, limit=100)
    assert many.count == few.count + 3
