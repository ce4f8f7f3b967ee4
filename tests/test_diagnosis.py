"""The diagnosis of a design: remedies are what was compared, words say what the numbers say."""

from dataclasses import replace

import numpy as np
import pytest
from designs import designed

import ann_dc
from ann_dc.analysis.slowness import LIMIT, Cause
from ann_dc.analysis.spectra import Spectrum
from ann_dc.diagnosis import HELPS, Diagnosis, Remedy, diagnose
from ann_dc.errors import DesignError
from ann_dc.gain_design.gains import manual_gains
from ann_dc.network.preconditioners.base import PreconditionerKind

NAMES = ("car", "pendulum", "cstr", "double_integrator", "planar_quadrotor")


def diagnosis(name: str) -> Diagnosis:
    return diagnose(designed(name))


def with_ratio(found: Diagnosis, ratio: float) -> Diagnosis:
    values = Spectrum(eigenvalues=np.array([-ratio, -1.0]))
    return replace(found, slowness=replace(found.slowness, spectrum=values))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NAMES)
def test_it_fits_on_a_page(name):
    lines = str(diagnosis(name)).splitlines()
    assert len(lines) <= 25
    assert max(map(len, lines)) <= 110
    assert lines[0].startswith(f"{designed(name).network.title}: stiffness ratio ")
    assert lines[-1].startswith("advice: ")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NAMES)
def test_remedies_are_candidates_or_the_exact_preconditioner(name):
    found, ratios = diagnosis(name), {c.ratio for c in designed(name).candidates}
    assert found.slowness.ratio == designed(name).spectrum.stiffness_ratio
    compared = [remedy for remedy in found.remedies if remedy.compared]
    assert compared
    for remedy in compared:
        assert remedy.ratio in ratios
        assert remedy.gain == pytest.approx(found.slowness.ratio / remedy.ratio)
    kinds = {c.gain_rule.kind.value for c in designed(name).candidates}
    own = designed(name).best.gain_rule.kind.value
    assert kinds - {own} <= {remedy.change for remedy in compared}
    assert found.remedies[-1].ratio == pytest.approx(LIMIT)


@pytest.mark.parametrize("name", NAMES)
def test_penalties_are_told_apart_from_metrics(name):
    design = designed(name)
    same = [
        c.gains.rho.sum() / design.gains.rho.sum()
        for c in design.candidates
        if c.gain_rule == design.best.gain_rule
    ]
    changes = {remedy.change for remedy in diagnosis(name).remedies}
    assert ("larger penalty" in changes) == any(factor > 1.01 for factor in same)
    assert ("smaller penalty" in changes) == any(factor < 0.99 for factor in same)


def test_other_row_weights_are_told():
    design = designed("double_integrator")
    rows = replace(
        design.best,
        gains=replace(design.best.gains, rho=design.gains.rho * np.arange(len(design.gains.rho))),
        spectrum=Spectrum(eigenvalues=np.array([-3.0, -1.0])),
    )
    found = diagnose(replace(design, candidates=(design.best, rows)))
    (remedy,) = (r for r in found.remedies if r.compared)
    assert (remedy.change, remedy.ratio) == ("other row weights", 3.0)
    reported = with_ratio(replace(found, remedies=(replace(remedy, gain=10.0),)), 30.0)
    assert reported.advice.startswith("other row weights: 10 times faster near the optimum")


def test_reasons_name_the_row():
    found = replace(diagnosis("pendulum"))
    slowest = found.slowness.modes[0]
    row = max(found.slowness.rows, key=lambda r: dict(zip(slowest.names, slowest.shares))[r.neuron])

    def reason(**changes) -> str:
        modes = (replace(slowest, **changes), *found.slowness.modes[1:])
        changed = replace(found, slowness=replace(found.slowness, modes=modes))
        return with_ratio(changed, 30.0).reason

    component = row.neuron.partition(".")[2]
    weak = reason(dual_share=0.5, sensitivity=9.0)
    assert weak.startswith(f"constraint {component} is weakly reachable")
    assert f"{9 * row.penalty:.3g} along the mode, penalty {row.penalty:.3g}" in weak
    assert f"of constraint {component} is low for the curvature" in reason(
        dual_share=0.5, sensitivity=-9.0
    )
    assert slowest.leading[0] in reason(dual_share=0.0)
    assert reason(dual_share=0.0).startswith("the preconditioner does not couple")


def test_nothing_helps_near_the_limit():
    near = with_ratio(diagnosis("car"), 3.0)
    assert near.advice.startswith("none: ")
    assert near.reason.startswith("none")


def test_advice_is_what_gains_most():
    found = with_ratio(diagnosis("car"), 30.0)
    exact = tuple(remedy for remedy in found.remedies if not remedy.compared)
    better = Remedy(change="larger penalty", ratio=10.0, gain=3.0, compared=True)
    worse = Remedy(change="smaller penalty", ratio=60.0, gain=0.5, compared=True)
    assert better.helps
    assert not worse.helps
    assert replace(found, remedies=(better, worse, *exact)).advice.startswith("larger penalty: 3 ")
    other = replace(found, remedies=(worse, *exact), kind=PreconditionerKind.MULTILEVEL)
    assert other.advice.startswith("another preconditioner")
    assert replace(other, kind=PreconditionerKind.RESISTIVE_GRID).advice.startswith(
        "a smaller path weight"
    )


@pytest.mark.parametrize(
    ("settling", "outcome"),
    [
        (120.4, "settles in 120 tau_min"),
        (np.inf, "does not settle, or settles later"),
        (np.nan, "was not"),
    ],
)
def test_what_was_passed_over_has_an_outcome(settling, outcome):
    found = with_ratio(diagnosis("car"), 30.0)
    better = Remedy(change="resistive grid", ratio=3.0, gain=10.0, compared=True, settling=settling)
    assert f"from the initial guess it {outcome}" in replace(found, remedies=(better,)).advice


def test_advice_tells_where_penalty_and_preconditioner_are_needed_together():
    found = diagnosis("car")
    low = replace(found.slowness, lowest=-3.0, highest=6.0)
    assert low.exact_ratio() == float("inf")
    remedies = (Remedy(change="larger penalty", ratio=60.0, gain=0.5, compared=True),)
    reported = with_ratio(
        replace(found, slowness=low, remedies=remedies, kind=PreconditionerKind.MULTILEVEL), 30.0
    )
    assert reported.advice == (
        "another preconditioner with 6 times the penalties; neither is sufficient alone"
    )
    high = replace(reported.slowness, lowest=0.0)
    assert HELPS * high.exact_ratio() < 30.0
    assert (
        replace(reported, slowness=high).advice == "another preconditioner; then larger penalties"
    )


def test_a_solution_is_analysed_by_its_design():
    problem = ann_dc.plants.double_integrator(N=5)
    solution = ann_dc.solve(problem, preconditioner=PreconditionerKind.MULTILEVEL)
    found = ann_dc.diagnose(solution)
    assert solution.design is not None
    assert str(found) == str(ann_dc.diagnose(solution.design))
    slowest = found.slowness.modes[0]
    assert slowest.cause in (Cause.REACH, Cause.PRECONDITIONER)
    reported = {
        Cause.REACH: "is weakly reachable",
        Cause.PRECONDITIONER: "the preconditioner does not couple",
    }
    assert reported[slowest.cause] in found.reason


def test_gains_by_hand_are_refused():
    problem = ann_dc.plants.double_integrator(N=3)
    gains = manual_gains(ann_dc.synthesize(problem), rho=1.0)
    solution = ann_dc.solve(problem, gains=gains, backend=ann_dc.OdeBackend(verify=False))
    with pytest.raises(DesignError, match=r"given manually.*slowness_of"):
        ann_dc.diagnose(solution)


def test_a_design_that_did_not_settle_is_refused():
    with pytest.raises(DesignError, match=r"did not settle in 25 steps.*limit="):
        ann_dc.diagnose(ann_dc.design(ann_dc.plants.double_integrator(N=5), limit=25))
