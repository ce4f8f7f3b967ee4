"""Problems with inequalities: IPOPT's optima are certified, what only looks like one is not."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from other_units import Units, written_in
from seeds import seeds

from ann_dc.errors import ArgumentValueError
from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.complementarity import LARGEST_MISS
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem

CAR, LINE = plants.car(), plants.double_integrator(N=40, dt=3 / 40)
(PX, PY, _, _), (NU, ETA) = CAR.states, CAR.controls
(X, V), (A,) = LINE.states, LINE.controls
a, b, c, x = sp.symbols("a b c x")

PROBLEMS = {
    "limited effort": replace(
        plants.double_integrator(N=20, dt=0.105), bounds={"a": (-1.0, 1.0)}
    ),
    "limited speed": replace(LINE, bounds={V: (None, 0.4)}),
    "both, from the bound itself": replace(LINE, bounds={V: (0, 0.4), A: (-1, 1)}),
    "position": replace(  # Bryson and Ho: a position that touches its bound along an arc
        plants.double_integrator(N=40, dt=1 / 40), q_0=(0, 1), q_d=(0, -1),
        bounds={"x": (None, 1 / 9)},
    ),
    "car, disc": replace(CAR, constraints={"disc": (PX - 2.5) ** 2 + (PY - 1.2) ** 2 >= 0.36}),
    "car, effort": replace(CAR, constraints=(NU**2 + ETA**2 <= 110,)),
    "car, limits": replace(CAR, bounds={NU: (0, 11), ETA: (-4.5, 4.5)}),
    "free end": replace(
        LINE, q_d=(None, None), terminal_constraints=(X + V >= 1, V <= 0.1), bounds={V: (0, 0.36)}
    ),
    "an end within bounds": replace(LINE, q_d=(1, None), bounds={V: (0, 0.45), A: (-0.4, 2)}),
}  # fmt: skip

LOOSE = [name for name in PROBLEMS if name not in ("limited effort", "car, limits")]
"""Those with rows."""


@pytest.fixture(scope="module")
def optima():
    return {name: ipopt_point(problem) for name, problem in PROBLEMS.items()}


@pytest.mark.parametrize("name", PROBLEMS)
def test_an_independent_optimum_is_certified_with_its_multipliers(name, optima):
    given = certify(PROBLEMS[name], *optima[name].kkt)
    kept = given.complementarity
    assert given.certified, given.reason
    assert given.newton_step < 1e-5
    assert kept.strong > 0
    assert max(kept.violation, kept.wrong_sign, kept.product) < LARGEST_MISS
    assert given.objective == pytest.approx(optima[name].objective, rel=1e-12)
    assert f"inequalities           {kept.strong} strongly active" in str(given)


@pytest.mark.parametrize("moved", range(5))
@pytest.mark.parametrize("name", PROBLEMS)
def test_a_neighbour_is_not(name, moved, optima):
    point = [values.copy() for values in optima[name].kkt]
    point[moved][:, 3] += 1e-2 * np.abs(point[moved]).max()
    assert not certify(PROBLEMS[name], *point).certified


@pytest.mark.parametrize("name", LOOSE)
def test_multipliers_of_rows_count(name, optima):
    """Without them the slopes do not vanish; with another sign they are refused."""
    *point, zeta, zeta_end = optima[name].kkt
    assert certify(PROBLEMS[name], *point).stationarity_residual > 1e-4
    turned = certify(PROBLEMS[name], *point, -zeta, -zeta_end)
    assert turned.complementarity.wrong_sign > 1e-3
    assert not turned.certified
    more = certify(PROBLEMS[name], *point, zeta + 0.1 * zeta.max(), zeta_end)
    assert not more.certified


def test_the_optimum_of_other_limits_is_none():
    """A tighter bound is violated, a wider one is not touched by a control that pushes outward."""
    problem = PROBLEMS["limited effort"]
    point = ipopt_point(problem).kkt
    tighter = certify(replace(problem, bounds={"a": (-0.999, 0.999)}), *point)
    assert tighter.complementarity.violation == pytest.approx(1e-3, rel=1e-3)
    assert "violated" in tighter.reason
    wider = certify(replace(problem, bounds={"a": (-1.001, 1.001)}), *point)
    assert wider.complementarity.violation == 0.0
    assert wider.complementarity.strong == 0
    assert wider.stationarity_residual > 1e-4
    assert not wider.certified


def test_a_violated_row_alone_is_enough(optima):
    """Least effort, and a bound on the speed that nobody looked at."""
    free = replace(LINE, bounds={})
    point = ipopt_point(free).kkt[:5]
    assert certify(free, *point).certified
    fastest = float(point[0][1].max())
    bounded = replace(LINE, bounds={V: (None, fastest / (1 + 3e-6))})
    certificate = certify(bounded, *point)
    assert certificate.kkt_residual < 1e-8
    assert LARGEST_MISS < certificate.complementarity.violation < 1e-5
    assert not certificate.certified


# ---- closed forms ------------------------------------------------------------------------------


def filled(caps, cost=a**2 / 2, relation=a <= c) -> OptimalControlProblem:
    """x' = x + a from 0 to 1, with a cap of its own at every stage."""
    return OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=cost, horizon=len(caps), q_0=(0,), q_d=(1,),
        inputs={c: caps}, constraints=(relation,),
    )  # fmt: skip


def along(problem, controls, level, zeta):
    """The point of these controls with mu = -level all along."""
    u = np.array([controls], float)
    q = problem.functions.rollout(problem.q_0, u)
    mu = np.full(u.shape, -float(level))
    return q[:, :-1], u, q[:, 1:], mu, -mu, np.array([zeta], float)


CAPS = (0.1, 0.5, 0.2, 0.9)
LEVEL = 0.35
"""0.1 + 0.35 + 0.2 + 0.35 = 1: every stage up to the same level, or to its cap."""


@pytest.mark.parametrize(
    "relation", [a <= c, 1e9 * a <= 1e9 * c, sp.exp(3 * a) <= sp.exp(3 * c), a**3 <= c**3]
)
def test_water_filling(relation):
    """However the rows are written, once their multipliers are those of their own slopes."""
    problem, controls = filled(CAPS, relation=relation), np.minimum(CAPS, LEVEL)
    g = relation.lhs - relation.rhs
    slope = [float(g.diff(a).subs({a: value})) for value in controls]
    zeta = (LEVEL - controls) / slope
    certificate = certify(problem, *along(problem, controls, LEVEL, zeta))
    kept = certificate.complementarity
    assert certificate.certified, certificate.reason
    assert (kept.strong, kept.weak, kept.inactive) == (2, 0, 2)
    assert certificate.objective == pytest.approx((controls**2).sum() / 2)
    assert kept.product < 1e-15
    wrong = certify(problem, *along(problem, controls, LEVEL, zeta * [1, 1, -1, 1]))
    assert wrong.complementarity.wrong_sign == pytest.approx(0.15 / 0.35)


def test_water_filling_by_limits():
    """One cap for all stages, of which only the cheapest reaches it: a limit is its own witness."""
    weights, level = (0.5, 1.0, 2.0, 1.0), 0.28  # 0.3 + 0.28 + 0.14 + 0.28 = 1
    controls = np.minimum(0.3, level / np.array(weights))
    problem = filled(weights, cost=c * a**2 / 2)
    limited = replace(problem, constraints=(), bounds={a: (None, 0.3)})
    certificate = certify(limited, *along(limited, controls, level, [0] * 4)[:5])
    assert certificate.certified, certificate.reason
    kept = certificate.complementarity
    assert (kept.strong, kept.weak, kept.inactive) == (1, 0, 3)
    by_chance = replace(limited, cost=a**2 / 2, bounds={a: (None, 0.25)})
    certificate = certify(by_chance, *along(by_chance, [0.25] * 4, 0.25, [0] * 4)[:5])
    assert certificate.certified, certificate.reason
    assert (certificate.complementarity.strong, certificate.complementarity.weak) == (0, 4)


def test_an_inactive_row_has_no_multiplier():
    """Slopes that vanish by a multiplier of a row that does not touch."""
    problem = filled((0.9,) * 4)
    uneven = np.array([0.4, 0.2, 0.2, 0.2])
    certificate = certify(problem, *along(problem, uneven, 0.4, 0.4 - uneven))
    assert certificate.kkt_residual < 1e-15
    assert certificate.complementarity.product > 0.1
    assert not certificate.certified
    assert "of an inactive inequality" in certificate.reason


def test_a_row_given_twice_shares_its_multiplier():
    problem = replace(filled(CAPS), constraints=(a <= c, 2 * a <= 2 * c, a**3 <= c**3))
    controls = np.minimum(CAPS, LEVEL)
    pull = LEVEL - controls
    point = along(problem, controls, LEVEL, pull)[:5]
    for shares in ((1, 0, 0), (0, 0.5, 0), (0.5, 0.25, 0)):
        certificate = certify(problem, *point, np.outer(shares, pull))
        assert certificate.certified, certificate.reason


# ---- second order ------------------------------------------------------------------------------


def pair(cost, **more) -> OptimalControlProblem:
    """One stage, x' = a + b with two controls."""
    return OptimalControlProblem(
        states=(x,), controls=(a, b), map=(a + b,), cost=cost, horizon=1, q_0=(0,), **more
    )


def still(problem, u, zeta=None):
    q, none = np.zeros((1, 1)), np.zeros((1, 1))
    u = np.array(u, float).reshape(2, 1)
    return certify(problem, q, u, problem.functions.map(q, u), none, none, zeta)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_saddle_on_the_active_set(sign):
    """a is held by its row; b is a minimum, or a maximum."""
    problem = pair(-(a**2) + sign * b**2 / 10, constraints=(a <= 1,))
    certificate = still(problem, (1, 0), np.array([[2.0]]))
    assert certificate.kkt_residual < 1e-15
    assert certificate.complementarity.strong == 1
    assert certificate.minimum is (Minimum.STRICT if sign > 0 else Minimum.NOT_A_MINIMUM)
    assert certificate.certified == (sign > 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_same_at_a_limit(sign):
    problem = pair(-(a**2) + sign * b**2 / 10, bounds={a: (-3, 1)})
    assert still(problem, (1, 0)).certified == (sign > 0)
    assert still(problem, (-3, 0)).certified == (sign > 0)
    inside = still(problem, (0, 0))
    assert inside.kkt_residual == 0
    assert inside.minimum is Minimum.NOT_A_MINIMUM


@pytest.mark.parametrize("dear", [1.5, 0.5])
def test_the_curvature_of_a_row_counts(dear):
    """(a^2 + dear b^2) / 2 outside a disc: at (r, 0) zeta is 1/2, the curvature in b dear - 1."""
    problem = pair((a**2 + dear * b**2) / 2, constraints=(a**2 + b**2 >= 0.16,))
    certificate = still(problem, (0.4, 0), np.array([[0.5]]))
    assert certificate.kkt_residual < 1e-15
    assert certificate.minimum is (Minimum.STRICT if dear > 1 else Minimum.NOT_A_MINIMUM)
    assert certificate.certified == (dear > 1)


def test_a_weakly_active_row_leaves_the_answer_open():
    """At a = 1 the slope vanishes and the cost falls to one side; a row may be on the other."""
    for edge in (a <= 1, a >= 1):
        problem = pair(b**2 - (a - 1) ** 2, constraints=(edge,))
        certificate = still(problem, (1, 0), np.array([[0.0]]))
        assert certificate.complementarity.weak == 1
        assert certificate.minimum is Minimum.NOT_SHOWN
        assert not certificate.certified
        assert "not proven" in certificate.reason
    certificate = still(pair(b**2 + (a - 1) ** 2, constraints=(a <= 1,)), (1, 0), np.array([[0.0]]))
    assert certificate.certified


# ---- what must not pass ------------------------------------------------------------------------


def test_a_cheap_control_cannot_hide_behind_its_limit():
    """w would rather be 1; that nobody pushes it there is lost in what u costs."""
    y, u, w = sp.symbols("y u w")
    problem = OptimalControlProblem(
        states=(x, y), controls=(u, w), dynamics=(1000 * u, w), dt=0.1, horizon=10,
        cost=u**2 + 1e-16 * (w - 1) ** 2, q_0=(0, 0), q_d=(1000, None),
    )  # fmt: skip
    limited = replace(problem, bounds={w: (0.5, None)})
    row = replace(problem, constraints=(w >= 0.5,))
    q = np.array([np.linspace(0, 1000, 11), np.linspace(0, 0.5, 11)])
    u = np.array([np.ones(10), np.full(10, 0.5)])
    mu = np.array([np.full(10, -0.02), np.zeros(10)])
    for declared in (limited, row):
        certificate = certify(declared, q[:, :-1], u, q[:, 1:], mu, -mu)
        assert certificate.kkt_residual < 1e-8
        assert not certificate.complementarity.reason
        assert certificate.newton_step > 1e-3
        assert not certificate.certified
    other = replace(problem, bounds={w: (None, 0.5)})  # there it is held by right
    assert certify(other, q[:, :-1], u, q[:, 1:], mu, -mu).newton_step < 1e-9


@pytest.mark.parametrize(
    ("row", "zeta"), [(a**2 <= 1, 5.0), (-(a**2) <= 0, -5.0), (a**2 <= 1e-6, 5.0)]
)
@pytest.mark.parametrize("away", [0.0, 1e-9])
def test_no_curvature_comes_from_rows_that_do_not_hold_anything(row, zeta, away):
    """The cost has a maximum at zero, whatever multipliers are told."""
    certificate = still(pair(b**2 - a**2, constraints=(row,)), (away, 0), np.array([[zeta]]))
    assert certificate.minimum is not Minimum.STRICT
    assert not certificate.certified


def test_inside_a_disc_there_is_no_slope_but_a_violation():
    certificate = still(
        pair(a**2 + b**2, constraints=(a**2 + b**2 >= 1,)), (0, 0), np.array([[0.0]])
    )
    assert certificate.complementarity.violation == np.inf
    assert not certificate.certified


@pytest.mark.parametrize("place", [0, 2, 3, 4, 5, 6])
def test_one_number_that_is_none_is_enough(place, optima):
    name = "free end"
    point = [values.copy() for values in optima[name].kkt]
    point[place][..., -1] = np.nan
    certificate = certify(PROBLEMS[name], *point)
    assert not certificate.certified
    assert not certificate.kkt_residual < 1e-8


# ---- shapes, units, records --------------------------------------------------------------------


def test_multipliers_of_another_shape_are_refused(optima):
    *point, zeta, zeta_end = optima["free end"].kkt
    problem = PROBLEMS["free end"]
    for wrong in (zeta[:1], zeta[:, :-1], zeta.T, zeta[0], np.zeros((0, 40))):
        with pytest.raises(ArgumentValueError, match=r"zeta: expected an array of shape \(2, 40\)"):
            certify(problem, *point, wrong, zeta_end)
    with pytest.raises(ArgumentValueError, match=r"zeta_end: expected an array of shape \(4,\)"):
        certify(problem, *point, zeta, zeta_end[:3])
    with pytest.raises(ArgumentValueError, match="zeta"):
        certify(CAR, *ipopt_point(CAR).kkt[:5], zeta)


def test_none_is_zero(optima):
    point = optima["free end"].kkt[:5]
    problem = PROBLEMS["free end"]
    zeros = certify(problem, *point, np.zeros((2, 40)), np.zeros(4))
    assert str(certify(problem, *point)) == str(zeros)


def test_without_inequalities_there_is_nothing_to_say():
    certificate = certify(CAR, *ipopt_point(CAR).kkt)
    assert certificate.certified
    assert certificate.complementarity is None
    assert "inequalities" not in str(certificate)


@pytest.mark.parametrize("name", PROBLEMS)
@seeds(3)
@pytest.mark.sampled
def test_other_units_change_nothing(name, seed, optima):
    problem, point = PROBLEMS[name], optima[name]
    units = Units.random(problem, seed, decades=3)
    other = written_in(problem, units)
    state, control = units.state[:, None], units.control[:, None]
    factors = dict(zip(map(str, problem.states), units.state))
    of_rows = [
        np.array([factors.get(row.name.rpartition("_")[0], 1.0) for row in rows])
        for rows in (problem.inequalities, problem.end_inequalities)
    ]
    there = certify(
        other, point.q / state, point.u / control, point.t / state,
        point.mu * state / units.cost, point.beta * state / units.cost,
        point.zeta * of_rows[0][:, None] / units.cost, point.zeta_end * of_rows[1] / units.cost,
    )  # fmt: skip
    here = certify(problem, *point.kkt)
    assert there.certified, there.reason
    kept, reported = here.complementarity, there.complementarity
    assert (reported.strong, reported.weak, reported.inactive) == (
        kept.strong,
        kept.weak,
        kept.inactive,
    )
    assert reported.product == pytest.approx(kept.product, abs=1e-10)
