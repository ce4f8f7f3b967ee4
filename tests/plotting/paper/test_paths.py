"""Paths as plain numbers: what neurons say, where controls lead, and moments of a run."""

import numpy as np
import pytest

import ann_dc
from ann_dc.plotting.paper.paths import path_of, rolled_out, run_away
from ann_dc.problem import plants


@pytest.fixture(scope="module")
def car():
    return ann_dc.solve(plants.car(), backend=ann_dc.OdeBackend(verify=False))


def test_a_path_is_that_of_the_solution(car):
    path = path_of(car)
    np.testing.assert_array_equal(path.q[0], car["x"])
    np.testing.assert_array_equal(path.q[1], car["y"])
    np.testing.assert_array_equal(path.u, [car["nu"], car["eta"]])


def test_its_first_sample_is_the_line(car):
    path = path_of(car, 0)
    np.testing.assert_allclose(path.q[0], np.linspace(0, 5, 10), atol=1e-12)
    np.testing.assert_allclose(path.q[1], path.q[0], atol=1e-12)


def test_controls_lead_where_simulation_says(car):
    path, q = rolled_out(car), np.zeros(4)
    for k, (nu, eta) in enumerate(path.u.T):
        np.testing.assert_allclose(path.q[:, k], q[:2], atol=1e-9)
        _, _, phi, varphi = q
        push = [nu * np.cos(phi), nu * np.sin(phi), nu * np.tan(varphi), eta]
        q = 0.99 * q + 0.1 * np.array(push)
    np.testing.assert_allclose(path.q[:, -1], q[:2], atol=1e-9)


def test_moments_before_it_runs_away_stay_in_the_picture():
    form = ann_dc.switch("S1")
    backend = ann_dc.OdeBackend(verify=False)
    lost = ann_dc.solve(plants.car(), form=form, backend=backend)
    assert not lost.status.settled
    moments = run_away(lost, count=2)
    assert len(moments) == 2
    assert all(np.abs(path.q).max() < 1.6 * 5 for path in moments.values())
    assert next(iter(moments)).startswith("after ")
