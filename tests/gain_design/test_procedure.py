"""Designs against measured runs."""

from dataclasses import replace

import numpy as np
import pytest
from constrained import CONSTRAINED
from designs import designed, slower
from hypothesis import given, settings, strategies as st
from problems import SUITE

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.errors import DesignError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design import trial_run as freeze
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.knowledge import Knowledge
from ann_dc.gain_design.procedure import design
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.certificate import certify
from ann_dc.problem import plants
from ann_dc.solver import design as design_problem, synthesize
from ann_dc.weights.hashes import content_hash

MEASURED = ("car", "unicycle", "bicycle", "van_der_pol", "double_integrator")
SLOW = ("unicycle", "bicycle", "van_der_pol")


WITHOUT_GRID = (
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.DIAGONAL,
)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in MEASURED],
)
def test_settling_is_predicted(name):
    found = design(synthesize(SUITE[name].problem), preconditioner=WITHOUT_GRID)
    assert found.settled
    run = OdeBackend(verify=False).run(found.network)
    assert run.status.settled
    np.testing.assert_allclose(run.settling_time, found.predicted_settling(), rtol=0.25)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", MEASURED)
def test_settling_on_a_grid_is_predicted(name):
    """Near the limit the modes are alike, so that the slowest one need not lead."""
    found = designed(name)
    assert found.best.kind is PreconditionerKind.RESISTIVE_GRID
    run = OdeBackend(verify=False).run(found.network)
    assert run.status.settled
    assert 0.5 < run.settling_time / found.predicted_settling() < 1.25


def test_the_fastest_from_the_start_won():
    found = designed("car")
    assert len(found.candidates) >= 6
    assert found.best is found.candidates[0]
    assert found.best.settling == np.nanmin([c.settling for c in found.candidates])
    run = OdeBackend(verify=False).run(found.network)
    measured = run.settling_time * found.spectrum.radius
    np.testing.assert_allclose(found.best.settling, measured, rtol=0.1)
    assert measured < 70  # settling independent of N needs tens, not thousands


def test_near_the_limit_nothing_slower_is_compared():
    assert {c.kind for c in designed("car").candidates} == {PreconditionerKind.RESISTIVE_GRID}
    assert designed("car").reason.startswith("resistive grid settles in")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", PreconditionerKind)
def test_only_what_is_allowed_is_chosen(kind):
    network = synthesize(plants.unicycle(N=8))
    found = design(network, preconditioner=[kind])
    assert found.settled
    assert found.network.preconditioner.kind is found.best.kind is kind
    assert OdeBackend(verify=False).run(found.network).status.settled


def test_all_that_is_allowed_has_a_reason():
    found = design(
        synthesize(plants.pendulum(N=10)),
        preconditioner=[PreconditionerKind.DIAGONAL, PreconditionerKind.COUPLED_MULTILEVEL],
    )
    first, second = found.reason.split("; ")
    assert first.startswith("coupled multilevel settles in")
    assert second.startswith("diagonal")
    assert found.reason in str(found)


def test_reason_begins_with_the_kind_that_was_chosen():
    found = design(
        synthesize(plants.pendulum(N=10)),
        preconditioner=[PreconditionerKind.DIAGONAL, PreconditionerKind.COUPLED_MULTILEVEL],
    )
    assert {c.kind for c in found.candidates} == {
        PreconditionerKind.DIAGONAL,
        PreconditionerKind.COUPLED_MULTILEVEL,
    }
    for best in found.candidates:
        first, other = replace(found, best=best).reason.split("; ")
        assert first.startswith(f"{best.kind.value} ")
        assert not other.startswith(f"{best.kind.value} ")


@pytest.mark.parametrize("kinds", [[], [3], [PreconditionerKind.RESISTIVE_GRID, None]])
def test_kinds_that_are_none(kinds):
    with pytest.raises(
        DesignError, match=r"preconditioner: expected one or more of PreconditionerKind\.DIAGONAL"
    ):
        design(synthesize(plants.double_integrator(N=3)), preconditioner=kinds)


def test_the_only_kind_says_why_it_is_none():
    low = replace(freeze.GAIN_RULES[PreconditionerKind.RESISTIVE_GRID], penalty=0.01)
    with pytest.raises(DesignError, match=r"needs penalties above rho\*"):
        design(synthesize(plants.pendulum(N=10)), gain_rule=low)


def test_network_carries_the_gains():
    found = designed("car")
    network, gains = found.network, found.gains
    assert network.preconditioner is gains.preconditioner
    for row, neuron in enumerate(network.cell.neurons):
        tau = np.broadcast_to(neuron.tau, network.stages)
        np.testing.assert_allclose(1 / tau, gains.rate[row], rtol=1e-14)
    paths = {c.name: c.weight for c in network.cell.connections}
    for dual in network.cell.duals:
        rho = gains.rho[network.neuron_index[dual.neuron]]
        assert paths[f"{dual.multiplier}<-{dual.residual}"] == rho


def test_design_says_what_it_did():
    found = designed("car")
    text = str(found)
    assert text.startswith("scheduled run  settled in ")
    for word in ("selected", f"rho* = {found.rho_star:.3g}", "radius", "abscissa", "predicted"):
        assert word in text


def test_design_without_duals():
    leak = Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            connections=(Connection(source="x", target="x", weight=-1.0),),
        ),
        stages=2,
    )
    with pytest.raises(DesignError, match=r"no PI dual neurons.*manually"):
        design(leak)


def test_a_fixed_recipe_is_kept():
    found = design(synthesize(plants.double_integrator(N=4)), gain_rule=DIAGONAL_RULE)
    assert found.best.gain_rule is DIAGONAL_RULE
    assert found.network.preconditioner.kind is PreconditionerKind.DIAGONAL


def test_progress_is_told():
    meaning = []
    design(synthesize(plants.double_integrator(N=3)), progress=meaning.append)
    assert meaning[0].startswith("gain-scheduled run: step ")
    assert meaning[-1].startswith("trial run: candidate ")


@settings(max_examples=6, deadline=None)
@given(c=st.floats(0.05, 20.0))
def test_time_scaling(c):
    network = designed("double_integrator").network
    backend = OdeBackend(verify=False, settling=Settling(tolerance=1e-4))
    base, scaled = backend.run(network), backend.run(slower(network, c))
    assert scaled.status.settled
    np.testing.assert_allclose(scaled.settling_time, c * base.settling_time, rtol=0.01)
    x = network.start_state
    np.testing.assert_allclose(
        evaluator(slower(network, c)).rhs(x), evaluator(network).rhs(x) / c, rtol=1e-10
    )


@pytest.mark.slow
def test_a_run_that_does_not_settle_has_no_grid():
    found = design(
        synthesize(plants.pendulum()), preconditioner=PreconditionerKind.RESISTIVE_GRID, limit=50
    )
    assert not found.settled
    assert found.best.kind is PreconditionerKind.MULTILEVEL
    assert found.reason.startswith("no settled point for a grid")


def test_one_kind_is_a_list_of_one():
    network = synthesize(plants.double_integrator(N=3))
    one = design(network, preconditioner=PreconditionerKind.MULTILEVEL)
    several = design(network, preconditioner=[PreconditionerKind.MULTILEVEL])
    assert content_hash(one.network) == content_hash(several.network)


@pytest.mark.slow
def test_a_run_that_is_near_keeps_the_largest_penalty():
    """With hardly any control free, smaller ones swing for ever close to the optimum."""
    problem = CONSTRAINED["vdp_u"].problem
    found = design(synthesize(problem), preconditioner=PreconditionerKind.MULTILEVEL)
    assert (found.settled, found.first.penalty_factor) == (True, 64.0)
    certificate = certify(problem, *kkt_point(found.network, found.state))
    assert certificate.certified
    assert certificate.objective == pytest.approx(2.03317, abs=1e-5)
    assert found.best.settling < np.inf


@pytest.mark.slow
def test_a_faster_network_is_not_taken_where_it_settles_to_what_costs_more():
    """The same, were costs gains."""
    problem = CONSTRAINED["car_disc4"].problem
    network = synthesize(problem)
    cost = lambda x: certify(problem, *kkt_point(network, x)).objective  # noqa: E731
    known = Knowledge(cost=cost), Knowledge(cost=lambda x: -cost(x))
    taken, kept = (design(network, knowledge=own) for own in known)
    assert taken.best.settling < kept.best.settling < np.inf
    assert cost(taken.state) < cost(kept.state) - 1.0


def test_a_design_that_is_ended_early_keeps_to_the_kinds():
    """No controls within the bounds reach the target, so that nothing is compared."""
    problem = plants.double_integrator()
    narrow = replace(problem, bounds={problem.controls[0]: (-0.2, 0.2)})
    found = design_problem(narrow, preconditioner=PreconditionerKind.DIAGONAL)
    assert found.first.ended is not None
    assert found.network.preconditioner.kind is PreconditionerKind.DIAGONAL
