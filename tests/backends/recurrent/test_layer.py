"""The recurrent layer: other precisions and devices, and the way unrolled."""

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import designed
from recurrent_runs import RECURRENT, ode, short
from scipy.integrate import solve_ivp

import ann_dc.progress
from ann_dc.backends.recurrent import (
    SIMULTANEOUS,
    STAGE_BY_STAGE,
    TWO_PHASE,
    FixedStep,
    RecurrentLayer,
)
from ann_dc.errors import NetworkError
from ann_dc.evaluation import evaluator


def test_in_single_precision():
    network = designed("car").network
    end = RecurrentLayer(network, dtype=torch.float32).settle()
    assert end.settled.tolist() == [True]
    expected = ode("car").trajectory.final
    np.testing.assert_allclose(end.states[0], expected, atol=3e-3 * np.abs(expected).max())


@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE], ids=repr)
@pytest.mark.parametrize("name", ["double_integrator", "car"])
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


def test_progress_is_told(monkeypatch):
    times = iter(np.arange(0.0, 1e6))
    monkeypatch.setattr(ann_dc.progress.clock, "monotonic", lambda: next(times))
    meaning = []
    replace(RECURRENT, progress=meaning.append).run(short("unicycle"))
    assert len(meaning) > 3
    assert all(re.fullmatch(r"step \d+: 1 of 1 samples run on", line) for line in meaning)


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none():
    with pytest.raises(NetworkError, match="no CUDA device; use device='cpu'"):
        replace(RECURRENT, device="cuda").run(short("double_integrator"))


def test_an_unknown_device():
    with pytest.raises(NetworkError, match="device: 'abacus' is no device"):
        replace(RECURRENT, device="abacus").run(short("double_integrator"))


def test_the_unrolled_derivative_knows_where_it_starts():
    """Without x, a layer starts on a line between the ends: that moves with the inputs too."""
    layer = RecurrentLayer(short("unicycle"), step=FixedStep(step=0.3))
    goal = torch.tensor([1.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda goal: layer(inputs={"q_d.x": goal}, steps=2), goal)
