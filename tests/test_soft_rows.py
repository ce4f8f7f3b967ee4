"""Soft rows, from declaration to certificate, against IPOPT with slacks."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from constrained import CONSTRAINED, a, integrator, v
from reference import ipopt
from simulator import needs_ngspice

import ann_dc
from ann_dc import Soft
from ann_dc.decomposition.latex import as_latex
from ann_dc.evaluation.populations import kkt_point
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.solution.solution import certificate_of

PRICED = Soft(weight=1, compliance=0.02)


def softened(name, soft):
    return replace(CONSTRAINED[name].problem, soft=soft)


SOFT = {
    "a price below the multiplier": lambda: softened("dint_v", 0.5),
    "a price above it": lambda: softened("dint_v", 30),
    "compliance": lambda: softened("dint_v", Soft(compliance=0.01)),
    "price and compliance": lambda: softened("dint_v", PRICED),
    "steering": lambda: softened("car_steer", {"phi_low": 2, "phi_high": Soft(weight=3)}),
    "a curved row": lambda: softened("lander", {"thrust": 1e-3}),
    "a disc at the end": lambda: softened("end_disc", Soft(weight=2, compliance=0.05)),
    "a free start": lambda: softened("free_start", {"x_low": 0.05}),
    "not to be met": lambda: integrator(N=30, dt=0.1, bounds={v: (None, 0.3)}, soft=5),
}
QUICK = ("price and compliance",)
"""The others run with the slow tests."""


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SOFT]
)
def test_the_network_settles_at_the_optimum_of_the_softened_problem(name):
    problem = SOFT[name]()
    solution = ann_dc.solve(problem)
    assert solution.certified, solution.certificate
    q, u, t, *_ = kkt_point(solution.network, solution.trajectory.final)
    again = ipopt(problem, guess=(np.column_stack([q, t[:, -1]]), u))
    assert again.success
    assert solution.certificate.objective == pytest.approx(again.objective, rel=1e-6)
    np.testing.assert_allclose(u, again.u, atol=2e-4 * np.abs(again.u).max())


@pytest.mark.slow
@pytest.mark.parametrize("compliance", [1e-6, 1e-9, 1e-12])
def test_next_to_no_compliance_is_next_to_a_hard_row(compliance):
    """To second order too: a curvature of the inverse is a row that holds."""
    soft = ann_dc.solve(softened("end_disc", Soft(compliance=compliance)))
    hard = ann_dc.solve(CONSTRAINED["end_disc"].problem)
    assert soft.certified, soft.certificate
    assert soft.certificate.minimum is hard.certificate.minimum
    gained = hard.certificate.objective - soft.certificate.objective
    zeta = hard["z_end.near"][-1]
    assert gained == pytest.approx(compliance * zeta**2 / 2, rel=0.05, abs=1e-6)
    np.testing.assert_allclose(soft["u"], hard["u"], atol=1e-6 + 1e3 * compliance)


@pytest.mark.slow
def test_a_price_above_the_multiplier_gives_the_hard_optimum():
    """The L1 penalty is exact."""
    soft, hard = ann_dc.solve(softened("dint_v", 30)), ann_dc.solve(CONSTRAINED["dint_v"].problem)
    np.testing.assert_allclose(soft["u"], hard["u"], atol=1e-7)
    exact = [
        certificate_of(s.problem, s.network, ann_dc.equilibrium(s.network, s.trajectory.final))
        for s in (soft, hard)
    ]
    assert exact[0].objective == pytest.approx(exact[1].objective, rel=1e-8)
    kept = exact[0].soft_rows
    assert (kept.at_price, kept.yielding, kept.worst, kept.cost) == (
        0, 0, "", pytest.approx(0, abs=1e-8)
    )  # fmt: skip
    assert "all satisfied" in str(soft.certificate)


@pytest.mark.slow
def test_a_price_below_the_multiplier_leaves_the_row_exceeded():
    problem = softened("dint_v", 0.5)
    solution = ann_dc.solve(problem)
    q, u, *_, zeta, _ = kkt_point(solution.network, solution.trajectory.final)
    over = np.maximum(q[1] - 0.4, 0.0)
    broken = solution.certificate.soft_rows
    assert broken.at_price == (over > 1e-6).sum() > 5
    assert broken.worst == "v_high"
    assert broken.excess == pytest.approx(over.max(), rel=1e-9)
    assert broken.stage == np.argmax(over)
    assert broken.cost == pytest.approx(0.5 * over.sum(), rel=1e-6)
    assert zeta.max() == pytest.approx(0.5, rel=1e-14)
    effort = problem.functions.objective(solution.certificate.rollout, u)
    assert solution.certificate.objective == pytest.approx(effort + broken.cost, rel=1e-6)
    assert f"v_high most, by {over.max():.4g} at stage {broken.stage}" in str(solution.certificate)


def test_a_compliant_row_gives_way_in_proportion():
    solution = ann_dc.solve(softened("dint_v", PRICED))
    q, *_, zeta, _ = kkt_point(solution.network, solution.trajectory.final)
    over, pressed = q[1] - 0.4, zeta[0] > 1e-6
    at_price = zeta[0] > 1 - 1e-9
    np.testing.assert_allclose(over[pressed & ~at_price], 0.02 * zeta[0][pressed & ~at_price])
    assert (over[at_price] >= 0.02 * (1 - 1e-9)).all()
    reported = solution.certificate.soft_rows
    assert (reported.at_price, reported.yielding) == (at_price.sum(), (pressed & ~at_price).sum())
    assert reported.at_price > 0
    assert reported.yielding > 0


@pytest.mark.parametrize(
    "kind",
    ["dear", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("violated", "cheap"))],
)
def test_what_is_no_optimum_is_not_certified(kind):
    """Multipliers above the price, and rows that are exceeded below it."""
    problem = softened("dint_v", 0.5)
    point = ann_dc.solve(problem)
    *primal, mu, beta, zeta, end = kkt_point(point.network, point.trajectory.final)
    other = {"violated": CONSTRAINED["dint_v"].problem, "dear": softened("dint_v", 0.6)}
    problem = other.get(kind, softened("dint_v", 0.4))
    certificate = ann_dc.certify(problem, *primal, mu, beta, zeta, end)
    assert not certificate.certified
    assert certificate.complementarity is not None
    assert (certificate.complementarity.wrong_sign > 1e-3) == (kind == "cheap")
    assert certificate.complementarity.violation > 1e-3


@pytest.mark.parametrize("name", QUICK)
def test_backends_agree(name, tmp_path):
    """Continuous time in generated code and in SciPy, recurrent steps, and a saved network."""
    network = ann_dc.design(
        SOFT[name](), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    ).network
    ann_dc.save(network, tmp_path / "soft.npz")
    runs = [
        ann_dc.OdeBackend(verify=False).run(network),
        ann_dc.OdeBackend(verify=False, method=ann_dc.ode.RK45).run(network),
        ann_dc.RecurrentBackend().run(network),
        ann_dc.OdeBackend(verify=False).run(ann_dc.load(tmp_path / "soft.npz")),
    ]
    first = kkt_point(network, runs[0].trajectory.final)
    for run in runs:
        assert run.status.settled, run.status
        for mine, its in zip(first, kkt_point(network, run.trajectory.final)):
            np.testing.assert_allclose(its, mine, atol=1e-5 * max(np.abs(mine).max(initial=0), 1))
    np.testing.assert_array_equal(runs[3].trajectory.states, runs[0].trajectory.states)


def test_many_samples_at_once_are_each_as_if_alone():
    """Targets that break the row more and more, in lanes and in layers."""
    network = ann_dc.design(
        SOFT["price and compliance"](), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    ).network
    targets = {"q_d.x": np.linspace(0.8, 1.2, 5)}
    runs = [backend.run_batch(network, targets) for backend in (
        ann_dc.OdeBackend(verify=False), ann_dc.RecurrentBackend(),
    )]  # fmt: skip
    for batch in runs:
        assert batch.settled.all()
        np.testing.assert_allclose(batch.states, runs[0].states, atol=1e-6)
    multipliers = [
        kkt_point(network.with_inputs({"q_d.x": x}), final)[5].max()
        for x, final in zip(targets["q_d.x"], runs[0].states)
    ]
    assert multipliers[0] < 1 == pytest.approx(multipliers[-1])


CONTRADICTIONS = {
    "a bound of a state": (integrator(N=30, dt=0.1, bounds={v: (None, 0.3)}), "v_high: v - 0.3"),
    "a limit of a control": (
        integrator(N=22, dt=0.1, bounds={a: (-0.4, 0.4)}),
        "within a from -0.4",
    ),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_rows_that_contradict_each_other_are_named(name):
    problem, words = CONTRADICTIONS[name]
    solution = ann_dc.solve(problem)
    assert not solution.certified
    assert str(solution.status).startswith("infeasible: ")
    assert words in str(solution.status)


@pytest.mark.slow
@pytest.mark.parametrize("backend", [ann_dc.OdeBackend(), ann_dc.RecurrentBackend()], ids=type)
def test_a_frozen_network_names_the_multipliers_that_grow(backend):
    """Once its target is out of reach; with a soft row it settles and says by how much."""
    far = {"q_d.x": 1.5}
    hard = ann_dc.design(CONSTRAINED["dint_v"].problem).network
    reported = backend.run(hard.with_inputs(far)).status
    assert not reported.settled
    assert "; multipliers z.v_high, " in str(reported)
    near = backend.run(hard.with_inputs({"q_d.x": 1.02})).status
    assert near.settled
    soft = ann_dc.design(softened("dint_v", 20)).network.with_inputs(far)
    run = backend.run(soft)
    assert run.status.settled, run.status
    problem = softened("dint_v", 20).with_inputs(q_d=(1.5, 0))
    certificate = ann_dc.certify(problem, *kkt_point(soft, run.trajectory.final))
    assert certificate.certified
    assert certificate.soft_rows.excess > 0.1


@pytest.mark.slow
def test_what_is_slow_but_feasible_is_not_said_to_contradict_itself():
    network = ann_dc.design(CONSTRAINED["dint_v"].problem).network
    run = ann_dc.OdeBackend(limit=30.0).run(network)
    assert not run.status.settled
    assert "grow" not in str(run.status)


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    "soft",
    [
        PRICED,
        *(pytest.param(s, marks=pytest.mark.slow) for s in (Soft(weight=1), Soft(compliance=0.05))),
    ],
    ids=str,
)
@pytest.mark.parametrize("level", [ann_dc.levels.BEHAVIOURAL, ann_dc.levels.macro()])
def test_soft_rows_as_circuits(soft, level):
    problem = integrator(N=8, dt=0.25, bounds={v: (None, 0.6)}, soft=soft)
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    run = ann_dc.SpiceBackend(level=level).run(network)
    assert run.settled()
    fused = run.circuit.schematic.count(PICell) - len(network.cell.duals) * network.stages
    assert fused == (0 if np.isfinite(soft.weight) else network.stages)
    zeta = kkt_point(network, run.probe.final)[5]
    assert (zeta.max() == pytest.approx(1)) == np.isfinite(soft.weight)
    if level.name == "behavioural":
        assert run.control_error < 1e-6
    else:
        foreseen = predict(run.circuit, level, run.probe)
        assert run.control_error == pytest.approx(foreseen.control_error, rel=0.05)
        assert run.settling_time() == pytest.approx(foreseen.settling_time, rel=0.02)
        assert run.control_error < 5e-5


def test_what_is_exceeded_is_told_and_kept(tmp_path):
    solution = ann_dc.solve(softened("dint_v", PRICED))
    solution.save(tmp_path / "soft")
    again = ann_dc.load_solution(tmp_path / "soft")
    assert again.problem.soft == {"v_high": PRICED}
    assert asdict(again.certificate.soft_rows) == asdict(solution.certificate.soft_rows)
    assert solution.as_dict()["soft_rows"]["worst"] == "v_high"
    assert r"\min(1.0, \max(0, " in as_latex(solution.equations)
    assert "soft (1 per unit, compliance 0.02)" in str(solution.equations)


def test_a_start_outside_of_a_soft_bound():
    """It costs what it costs; nothing that is chosen could change it."""
    problem = integrator(N=12, dt=0.2, q_0=(0, 0.6), bounds={v: (None, 0.55)}, soft=3)
    solution = ann_dc.solve(problem)
    assert solution.certified
    assert solution.certificate.objective == pytest.approx(ipopt(problem).objective, rel=1e-6)
