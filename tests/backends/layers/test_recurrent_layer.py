"""The recurrent layer: other precisions and devices, and the way unrolled."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import designed, wired_with
from hypothesis import given, settings, strategies as st
from recurrent_runs import RECURRENT, ode, short, targets
from scipy.integrate import solve_ivp

import ann_dc.progress
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.step_rules import (
    ORDERS,
    SIMULTANEOUS,
    STAGE_BY_STAGE,
    TWO_PHASE,
    Anderson,
    FixedStep,
)
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.preconditioners.base import PreconditionerKind


def test_in_single_precision():
    network = designed("car").network
    end = RecurrentLayer(network, dtype=torch.float32).settle()
    assert end.settled.tolist() == [True]
    expected = ode("car").trajectory.final
    np.testing.assert_allclose(end.states[0], expected, atol=3e-3 * np.abs(expected).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE], ids=repr)
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
def test_half_the_step_half_the_error(name, order):
    network, end = short(name, 4), 2.0
    exact = solve_ivp(
        lambda _, x: evaluator(network).rhs(x), (0, end), network.start_state,
        method="DOP853", rtol=1e-11, atol=1e-11,
    ).y[:, -1]  # fmt: skip

    def error(steps: int) -> float:
        layer = RecurrentLayer(network, order=order, step=FixedStep(step=end / steps))
        return np.abs(layer(steps=steps)[0].numpy() - exact).max()

    assert 1.8 < error(100) / error(200) < 2.2


@pytest.mark.slow
def test_progress_is_told(monkeypatch):
    times = iter(np.arange(0.0, 1e6))
    monkeypatch.setattr(ann_dc.progress.clock, "monotonic", lambda: next(times))
    meaning, of_code = [], []
    RECURRENT.layer(short("unicycle")).settle(progress=meaning.append)
    assert len(meaning) > 3
    assert all(re.fullmatch(r"step \d+: 1 of 1 samples still run", line) for line in meaning)
    monkeypatch.setattr("ann_dc.backends.lane_batch.ATTEMPTS", 10)
    replace(RECURRENT, progress=of_code.append).run(short("unicycle"))
    assert len(of_code) > 3
    reported = r"step \d+, KKT residual \d\.\de[+-]\d+: 1 of 1 samples still run"
    others = [line for line in of_code if not re.fullmatch(reported, line)]
    assert set(others) <= {"0 of 1 samples still run"}
    assert len(others) < len(of_code) - 3


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none():
    with pytest.raises(NetworkError, match="no CUDA device; use device='cpu'"):
        replace(RECURRENT, device="cuda").run(short("double_integrator"))


def test_an_unknown_device():
    with pytest.raises(NetworkError, match="device: 'abacus' is unknown to torch"):
        replace(RECURRENT, device="abacus").run(short("double_integrator"))


def test_the_unrolled_derivative_knows_where_it_starts():
    """Without x, a layer starts on a line between the ends: that moves with the inputs too."""
    layer = RecurrentLayer(short("unicycle"), step=FixedStep(step=0.3))
    goal = torch.tensor([1.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda goal: layer(inputs={"q_d.x": goal}, steps=2), goal)


# ---- samples do not depend on their company ----------------------------------------------------

SAMPLES = 24


def assert_same_bits(layer: RecurrentLayer, inputs: dict, chosen, **settle) -> None:
    """These samples, in this order, end as they do in the whole batch."""
    whole = layer.settle(inputs=inputs, check=5, **settle)
    some = layer.settle(
        inputs={name: values[chosen] for name, values in inputs.items()}, check=5, **settle
    )
    for name in ("states", "residuals"):  # what is no number is no less the same
        ours, theirs = getattr(some, name).numpy(), getattr(whole, name).numpy()
        theirs = theirs[chosen] if name == "states" else theirs[:, chosen]
        np.testing.assert_array_equal(ours, theirs)
    assert some.steps.tolist() == whole.steps[chosen].tolist()
    assert some.codes.tolist() == whole.codes[chosen].tolist()


COMPANY = list(
    itertools.product(
        ["car", "two_link_arm"], PreconditionerKind, ORDERS.values(), [None, Anderson(memory=6)]
    )
)
"""Plant, preconditioner, order and acceleration: CI takes every seventh, which meets all of each.
"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "kind", "order", "acceleration"),
    [pytest.param(*made, marks=[pytest.mark.slow] * (i % 7 > 0)) for i, made in enumerate(COMPANY)],
    ids=lambda part: getattr(part, "name", repr(part)),
)
@settings(max_examples=2)
@given(chosen=st.lists(st.integers(0, SAMPLES - 1), min_size=1, max_size=30))
def test_samples_do_not_depend_on_their_company(name, kind, order, acceleration, chosen):
    """Subsets, orders and duplicates of a batch have the same bits, on the way too."""
    layer = RecurrentLayer(wired_with(name, kind), order=order, acceleration=acceleration)
    assert_same_bits(layer, targets(name, SAMPLES), np.array(chosen), limit=30)


@pytest.mark.parametrize("samples", [16, pytest.param(300, marks=pytest.mark.slow)])
def test_accelerated_samples_settle_where_they_do_alone(samples):
    """Whoever leaves before them, whatever is taken back: to the last bit."""
    layer = RecurrentLayer(designed("car").network, acceleration=Anderson())
    chosen = np.random.default_rng(0).integers(0, samples, 4)
    assert_same_bits(layer, targets("car", samples), chosen)


def test_a_sample_that_is_lost_changes_no_other():
    layer = RecurrentLayer(designed("car").network, acceleration=Anderson())
    inputs = targets("car", SAMPLES)
    inputs["q_d.x"][3] = np.nan
    assert_same_bits(layer, inputs, np.array([7, 3, 0]))
