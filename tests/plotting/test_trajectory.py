"""The plan in the plane, and states over time."""

import sympy as sp

import ann_dc
from ann_dc import plotting


def test_units_given_stand_on_the_axes(car):
    labels = [axes.get_ylabel() for axes in plotting.trajectory(car, {"y": "m"}).axes]
    assert labels[0] == "y (m)"
    assert labels[-1] == "varphi\n(problem units)"


def test_plane_needs_two_states():
    x, u = sp.symbols("x u")
    problem = ann_dc.OptimalControlProblem(
        states=(x,), controls=(u,), map=(x + u,), cost=u**2, horizon=4, q_0=(0,), q_d=(1,)
    )
    solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
    assert len(plotting.trajectory(solution).axes) == 1
    assert len(plotting.controls(solution).axes) == 1
