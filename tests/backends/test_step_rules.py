"""Step rules as data: what they refuse, and what they become."""

import numpy as np
import pytest
from recurrent_runs import short

import ann_dc
from ann_dc.backends.step_rules import ORDERS, AdaptiveStep, FixedStep, StepLengths, StepRule
from ann_dc.errors import NetworkError


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_is_positive(step):
    with pytest.raises(NetworkError, match="step: expected a positive number, got"):
        FixedStep(step=step)


@pytest.mark.parametrize("name", ["share", "first", "cut", "window", "least"])
def test_an_adaptive_step_has_positive_numbers(name):
    with pytest.raises(NetworkError, match=f"{name}: expected a positive number, got"):
        AdaptiveStep(**{name: 0})


def test_steps_are_as_long_as_the_limit_allows():
    rule = AdaptiveStep(share=0.5, first=0.1)
    wide, narrow = rule.lengths(4.0), rule.lengths(2.0)
    assert (wide.first, wide.longest) == (0.4, 2.0)
    assert (narrow.first, narrow.longest) == (0.2, 1.0)
    assert not wide.is_fixed
    assert FixedStep(step=0.3).lengths(4.0) == FixedStep(step=0.3).lengths(2.0)
    assert FixedStep(step=0.3).lengths(4.0).is_fixed


class Sprint(StepRule):
    """Short at first and then the same, which no rule of the package is."""

    def lengths(self, limit):
        """A twentieth of the limit that grows to a half of it, whatever the energy."""
        return StepLengths.always(limit / 2)._replace(first=limit / 20, growth=1.5, least=0.1)


@pytest.mark.parametrize("order", ORDERS.values(), ids=repr)
def test_a_rule_of_ones_own_steps_alike_in_code_and_in_layers(order):
    network = short("double_integrator")
    backend = ann_dc.RecurrentBackend(order=order, step=Sprint(), limit=20)
    code, layers = backend.run_batch(network, {}), backend.layer(network).settle(limit=20)
    assert code.steps.tolist() == layers.steps.tolist()
    scale = np.abs(code.states).max()
    np.testing.assert_allclose(code.states, layers.states, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("run", [
    lambda network, step: ann_dc.RecurrentBackend(step=step, limit=1).run(network),
    lambda network, step: ann_dc.RecurrentLayer(network, step=step)(steps=1),
], ids=["code", "layers"])  # fmt: skip
def test_a_fixed_step_above_the_limit_is_told(run):
    with pytest.warns(UserWarning, match="step 100 is above the stability limit"):
        run(short("double_integrator"), FixedStep(step=100.0))
