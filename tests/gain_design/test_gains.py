"""Gains by hand, and gains put into networks."""

import numpy as np
import pytest

from ann_dc.errors import DesignError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize


def test_hand_gains_by_name_and_population():
    network = synthesize(plants.car(N=3))
    gains = manual_gains(network, rho={"mu": 2.0, "mu.phi": 3.0}, tau={"q": 0.5})
    row = network.neuron_index
    assert gains.rho[row["mu.x"]] == 2.0
    assert gains.rho[row["mu.phi"]] == 3.0
    assert gains.rho[row["beta.x"]] == 0.0
    assert gains.rho[row["q.x"]] == 0.0
    assert (gains.rate[row["q.y"]] == 2.0).all()
    assert (gains.rate[row["mu.y"]] == 1.0).all()
    assert gains.preconditioner.kind is PreconditionerKind.DIAGONAL


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"tau": 0.0}, DesignError, "tau: time constants must be positive, got 0.0"),
        ({"tau": -1.0}, DesignError, "tau"),
        ({"tau": np.nan}, DesignError, "tau"),
        ({"tau": np.inf}, DesignError, "tau"),
        ({"tau": {"q.x": 0.0}}, DesignError, "tau.*'q.x': 0.0"),
        ({"rho": -0.1}, DesignError, "rho: penalties must be zero or positive, got -0.1"),
        ({"rho": np.nan}, DesignError, "rho"),
        ({"rho": {"nu": 1.0}}, UnknownNameError, "neuron or population 'nu'.*mu.varphi"),
        ({"tau": {"q.z": 1.0}}, UnknownNameError, "'q.z' does not exist"),
    ],
)
def test_hand_gains_that_are_refused(given, error, message):
    with pytest.raises(error, match=message):
        manual_gains(synthesize(plants.car(N=2)), **given)


def test_applied_gains_survive_a_second_time():
    network = synthesize(plants.car(N=3))
    once = apply_gains(network, manual_gains(network, rho=2.0, tau=0.1))
    twice = apply_gains(once, manual_gains(once, rho=3.0, tau=0.2))
    direct = apply_gains(network, manual_gains(network, rho=3.0, tau=0.2))
    x = network.start_state + 0.1
    np.testing.assert_array_equal(evaluator(twice).rhs(x), evaluator(direct).rhs(x))
