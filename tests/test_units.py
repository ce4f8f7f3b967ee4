"""The design of a problem does not notice in which units it was written."""

import numpy as np
import pytest
import sympy as sp
from mixed_units import MIXED
from other_units import Units, written_in
from problems import SUITE
from seeds import seeds

from ann_dc import design, equilibrium
from ann_dc.evaluation.populations import kkt_point
from ann_dc.gain_design.procedure import Design
from ann_dc.optimality.certificate import certify
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import scales_of


def kelvin_reactor(N=20) -> OptimalControlProblem:
    """A stirred tank in SI units: kmol/m^3, K, s; cooled by its jacket, Arrhenius with 8750 K."""
    c, T, T_c = sp.symbols("c T T_c")
    rate = 1.2e9 * sp.exp(-8750 / T) * c
    return OptimalControlProblem(
        name="reactor",
        states=(c, T),
        controls=(T_c,),
        dynamics=(
            (1.0 - c) / 60 - rate,
            (350 - T) / 60 + 209 * rate + (T_c - T) / 28.7,
        ),
        cost=((c - 0.5) / 0.5) ** 2 + ((T - 350) / 20) ** 2 + ((T_c - 300) / 10) ** 2,
        dt=3.0,
        horizon=N,
        q_0=(0.5, 350),
        q_d=(0.4, 356),
    )


CELSIUS = Units(
    state=np.array([1e-3, 1.0]),  # mol/l told in mol/m^3, kelvin told in degrees
    control=np.array([1.8]),
    cost=100.0,
    time=60.0,
    shift=np.array([0.0, 273.15]),
    push=np.array([255.37]),
)
"""The reactor for somebody with minutes, Celsius, and a jacket in Fahrenheit."""


def settled_point(problem: OptimalControlProblem, found: Design):
    """q, u, t, mu, beta where the design settled, Newton's last digits added."""
    point = kkt_point(found.network, equilibrium(found.network, found.state))
    return point, certify(problem, *point)


def assert_same_design(problem: OptimalControlProblem, units: Units) -> None:
    other = written_in(problem, units)
    ours, theirs = design(problem), design(other)
    assert theirs.settled is ours.settled is True
    assert theirs.first.steps == ours.first.steps
    assert theirs.best.gain_rule == ours.best.gain_rule
    np.testing.assert_allclose(theirs.best.ratio, ours.best.ratio, rtol=1e-5)
    np.testing.assert_allclose(theirs.best.settling, ours.best.settling, rtol=1e-2)
    assert_same_solution(problem, units, settled_point(problem, ours), settled_point(other, theirs))


def assert_same_solution(problem: OptimalControlProblem, units: Units, ours, theirs) -> None:
    """States, controls and multipliers as the user of either problem reads them."""
    (point, certificate), (reported, other_proof) = ours, theirs
    scales = scales_of(problem)
    state, control = scales.state_factors[:, None], scales.control_factors[:, None]
    shift = np.broadcast_to(units.shift, problem.n)[:, None]
    push = np.broadcast_to(units.push, problem.m)[:, None]
    in_state, in_control = units.state[:, None], units.control[:, None]
    for own, other, size in (
        (point[0], shift + in_state * reported[0], state),
        (point[1], push + in_control * reported[1], control),
        (point[2], shift + in_state * reported[2], state),
        (point[3], units.cost / in_state * reported[3], scales.cost / state),
        (point[4][:, 1:], (units.cost / in_state * reported[4])[:, 1:], scales.cost / state),
    ):
        np.testing.assert_allclose(other / size, own / size, rtol=1e-6, atol=1e-6)
    assert other_proof.certified == certificate.certified
    assert other_proof.verdict == certificate.verdict
    assert units.cost * other_proof.objective == pytest.approx(certificate.objective, rel=1e-7)


@pytest.mark.sampled(2)
@seeds(2)
@pytest.mark.parametrize("name", ["double_integrator", "pendulum"])
def test_a_plant_in_random_units(name, seed):
    problem = SUITE[name].problem
    assert_same_design(problem, Units.random(problem, seed))


@pytest.mark.slow
def test_a_reactor_in_kelvin_and_in_celsius():
    assert_same_design(kelvin_reactor(), CELSIUS)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SUITE))
def test_every_plant_in_random_units(name):
    problem = SUITE[name].problem
    assert_same_design(problem, Units.random(problem, 2))


@pytest.mark.parametrize(
    "name",
    [name if name == "economy" else pytest.param(name, marks=pytest.mark.slow) for name in MIXED],
)
def test_mixed_units_of_one_problem(name):
    """It is certified as its user wrote it, and is the same network in random units."""
    problem = MIXED[name]
    _, certificate = settled_point(problem, design(problem))
    assert certificate.certified
    for seed in (0, 1):
        assert_same_design(problem, Units.random(problem, seed))
