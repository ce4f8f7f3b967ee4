"""A run that settled, one with inequalities, and one that diverged."""

import pytest
import sympy as sp

import ann_dc


@pytest.fixture(scope="session")
def car():
    return ann_dc.solve(ann_dc.plants.car(), backend=ann_dc.OdeBackend(verify=False))


@pytest.fixture(scope="session")
def diverged():
    return ann_dc.solve(
        ann_dc.plants.car(), form=ann_dc.switch("S1"), backend=ann_dc.OdeBackend(verify=False)
    )


@pytest.fixture(scope="session")
def held():
    """A cart with limited speed and acceleration, and half a plane of the two that is forbidden."""
    x, v, a, w = sp.symbols("x v a w")
    problem = ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, cost=a**2 / 2, horizon=20,
        q_0=(0, 0), q_d=(1, 0), inputs={w: 3.0},
        constraints={"slow": v <= 2 * x + 0.4, "far": x <= w}, bounds={a: (-5, 2), v: (-100, 0.65)},
    )  # fmt: skip
    return ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
