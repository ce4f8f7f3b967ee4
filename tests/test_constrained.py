"""Problems with inequalities, from declaration to certificate, against IPOPT."""

import numpy as np
import pytest
from constrained import CONSTRAINED
from reference import ipopt

import ann_dc
from ann_dc.evaluation.populations import kkt_point

HARD = {"goddard"}
"""Whose first run does not settle: a singular arc."""
QUICK = ("dint_u", "end_disc")
"""Solved within a second; the others run with the slow tests."""


def point(solution):
    """States with the end, and controls."""
    q, u, t, *_ = kkt_point(solution.network, solution.trajectory.final)
    return np.column_stack([q, t[:, -1]]), u


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow)
        for name in CONSTRAINED
        if name not in HARD
    ],
)
def test_the_frozen_network_settles_at_an_optimum(name):
    solution = ann_dc.solve(CONSTRAINED[name].problem)
    assert solution.certified, solution.certificate
    again = ipopt(CONSTRAINED[name].problem, guess=point(solution))
    assert solution.certificate.objective <= again.objective + 1e-5 * abs(again.objective)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", QUICK)
def test_backends_agree(name):
    """Continuous time, recurrent steps, and SciPy's integrator."""
    network = ann_dc.design(
        CONSTRAINED[name].problem, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    ).network
    backends = (
        ann_dc.OdeBackend(verify=False),
        ann_dc.OdeBackend(verify=False, method=ann_dc.ode.RK45),
        ann_dc.RecurrentBackend(),
    )
    first, *others = (backend.run(network) for backend in backends)
    assert first.status.settled
    for other in others:
        assert other.status.settled, other.status
        for mine, its in zip(
            kkt_point(network, first.trajectory.final), kkt_point(network, other.trajectory.final)
        ):
            np.testing.assert_allclose(its, mine, atol=1e-5 * max(np.abs(mine).max(initial=0), 1))


@pytest.mark.slow
def test_multipliers_have_the_names_of_their_rows():
    solution = ann_dc.solve(CONSTRAINED["end_disc"].problem)
    *_, zeta, zeta_end = kkt_point(solution.network, solution.trajectory.final)
    assert zeta.size == 0
    assert solution["z_end.near"][-1] == pytest.approx(zeta_end[0], rel=1e-5) != 0
    solution = ann_dc.solve(CONSTRAINED["lander"].problem)
    *_, zeta, _ = kkt_point(solution.network, solution.trajectory.final)
    for row, values in zip(solution.problem.inequalities, zeta):
        np.testing.assert_allclose(solution[f"z.{row.name}"], values, atol=1e-5 * zeta.max())
    assert solution["z"].shape == (50, 3)
