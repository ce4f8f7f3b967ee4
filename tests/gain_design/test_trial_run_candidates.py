"""The freeze: which candidates are compared."""

from dataclasses import replace

import numpy as np
import pytest
from constrained import CONSTRAINED
from designs import designed

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.spectra import spectrum
from ann_dc.errors import AnnDcError, DesignError
from ann_dc.gain_design import penalty_search, trial_run as freeze, trial_run as rehearsal
from ann_dc.gain_design.gain_rule import GainRule
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.penalty_search import downhill
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.trial_run import candidate_of, compare
from ann_dc.network.cell import Limiter
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.progress import Paced, Stopped
from ann_dc.solver import synthesize

BOOST = 4.0


def factors(ratio) -> list[float]:
    """Factors that are tried, where ``ratio`` is of the factor."""
    tried = []

    def reported(penalty_factor: float) -> float:
        tried.append(penalty_factor / BOOST)
        return ratio(tried[-1])

    downhill(reported, BOOST)
    return tried


def test_downhill_to_the_smallest_ratio():
    """Octaves, and half an octave on either side of the last one."""
    half = penalty_search.HALF_OCTAVE
    assert factors(lambda f: abs(np.log2(f / 8))) == [1, 0.5, 2, 4, 8, 16, 8 * half, 8 / half]
    down = [1, 0.5, 2, 0.25, 0.125, 0.25 * half, 0.25 / half]
    assert factors(lambda f: abs(np.log2(f * 4))) == down
    between = 32 / half
    assert downhill(
        lambda penalty_factor: abs(np.log2(penalty_factor / between)), BOOST
    ) == pytest.approx(between)
    assert downhill(lambda penalty_factor: abs(np.log2(penalty_factor / 32)), BOOST) == 32


def test_where_the_first_run_froze_unstable_the_penalty_grows():
    found = factors(lambda f: np.inf if f < 4 else f)
    assert found == [1, 2, 4, 8, 4 * penalty_search.HALF_OCTAVE, 4 / penalty_search.HALF_OCTAVE]


@pytest.mark.parametrize(
    ("ratio", "furthest", "last"),
    [
        (lambda f: 1 / f, max, 2 * penalty_search.LARGEST_FACTOR),
        (lambda f: f, min, 0.5 / penalty_search.LARGEST_FACTOR),
        (lambda f: np.inf, max, 2 * penalty_search.LARGEST_FACTOR),
    ],
    ids=["up", "down", "never stable"],
)
def test_a_descent_ends_either_way(ratio, furthest, last):
    """The octave next to the largest factor is looked at, and none beyond it."""
    assert furthest(factors(ratio)) == last


def settled(name: str) -> SettledPoint:
    found = designed(name)
    return SettledPoint(Linearisation(found.network).at(found.state), found.state)


def test_grids_are_compared_with_gentler_inequality_rows_too():
    limited = design(synthesize(CONSTRAINED["dint_v"].problem))
    point = SettledPoint(Linearisation(limited.network).at(limited.state), limited.state)
    found = compare(point, PreconditionerKind.RESISTIVE_GRID, 1.0)
    assert {candidate.gain_rule.inequality for candidate in found} == {1.0, freeze.GENTLE}
    gentle = next(candidate for candidate in found if candidate.gain_rule.inequality != 1)
    assert "inequality factor 0.1" in str(gentle)
    plain = candidate_of(point, replace(gentle.gain_rule, inequality=1.0), 1.0)
    index = point.network.neuron_index
    duals = [index[dual.neuron] for dual in point.network.cell.duals]
    diode = np.flatnonzero(point.linear.diode)
    gentler, plainer = gentle.gains.rho, plain.gains.rho
    common = gentler[duals] / plainer[duals]
    assert np.ptp(common) < 1e-9 * common[0]
    assert gentler[diode] == pytest.approx(freeze.GENTLE * common[0] * plainer[diode])


@pytest.mark.slow
def test_path_terms_of_grids_fall_as_long_as_that_helps():
    found = compare(settled("cart_pole"), PreconditionerKind.RESISTIVE_GRID, 1.0)
    finer = [
        candidate for candidate in found if candidate.gain_rule.path_weight < min(freeze.PATHS)
    ]
    same = [
        c
        for c in found
        if c.gain_rule == replace(finer[0].gain_rule, path_weight=min(freeze.PATHS))
    ]
    ratios = [candidate.ratio for candidate in (*same, *finer)]
    assert len(finer) == 2
    assert ratios[1] < freeze.HELPS * ratios[0]
    assert ratios[2] > freeze.HELPS * ratios[1]
    assert {
        c.gain_rule.path_weight
        for c in compare(settled("unicycle"), PreconditionerKind.RESISTIVE_GRID, 1.0)
    } == {*freeze.PATHS}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", PreconditionerKind)
def test_every_kind_is_compared_with_equal_and_equilibrated_rows(kind):
    found = compare(settled("unicycle"), kind, 1.0)
    assert {candidate.kind for candidate in found} == {kind}
    assert {candidate.gain_rule.equilibration_sweeps for candidate in found} == {0, 16, 60}
    for candidate in found:
        assert candidate.gains.preconditioner.kind is kind
        assert kind.value in str(candidate)
        assert np.isnan(candidate.settling)


@pytest.mark.parametrize("kind", [PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.MULTILEVEL])
def test_on_a_long_row_one_choice_is_made_after_the_other(kind, monkeypatch):
    """All weights of the rows at one path term or penalty, and the rest with the best of them."""
    point = settled("car")
    every = {
        (c.gain_rule.equilibration_sweeps, c.gain_rule.by_reachability, c.gain_rule.path_weight)
        for c in compare(point, kind, 1.0)
    }
    monkeypatch.setattr(freeze, "LONG_ROW", point.network.stages - 1)
    found = compare(point, kind, 1.0)
    if kind is PreconditionerKind.RESISTIVE_GRID:
        damped = [
            candidate for candidate in found if candidate.gain_rule.path_weight == max(freeze.PATHS)
        ]
        best = min(damped, key=lambda candidate: candidate.ratio).gain_rule.equilibration_sweeps
        rest = [c.gain_rule.equilibration_sweeps for c in found if c not in damped]
        assert rest == [best] * (len(freeze.PATHS) - 1)
        assert {c.gain_rule.equilibration_sweeps for c in damped} == {
            equilibration_sweeps for equilibration_sweeps, _, _ in every
        }
    else:
        first = [candidate for candidate in found if not candidate.gain_rule.equilibration_sweeps]
        first = [candidate for candidate in first if not candidate.gain_rule.by_reachability]
        best = min(first, key=lambda candidate: candidate.ratio).penalty_factor
        rest = [candidate for candidate in found if candidate not in first]
        assert [candidate.penalty_factor for candidate in rest] == [best] * 3
    monkeypatch.setattr(freeze, "LONG_ROW", point.network.stages)
    assert len(compare(point, kind, 1.0)) > len(found)


@pytest.mark.parametrize("name", ["car", "unicycle", "van_der_pol", "cstr"])
def test_what_a_long_row_chooses_settles_nearly_as_fast(name, monkeypatch):
    """Against each weight with each path term, and a rehearsal of every network that may win."""
    network, thorough = designed(name).network, designed(name)
    monkeypatch.setattr(freeze, "LONG_ROW", 1)
    monkeypatch.setattr(rehearsal, "LONG_ROW", 1)
    found = design(network)
    assert len(found.candidates) < len(thorough.candidates)
    assert found.best.settling < 1.15 * thorough.best.settling


@pytest.mark.parametrize("reported", ["spectrum: product", "trial run: after"])
def test_a_comparison_can_be_ended_in_the_middle(reported, monkeypatch):
    """Of a spectrum or of a rehearsal, which take seconds on a long row."""
    monkeypatch.setattr(Paced.__init__, "__defaults__", (0.0,))
    monkeypatch.setattr("ann_dc.analysis.spectra.DENSE_LIMIT", 10)

    def stop(line: str) -> None:
        if line.startswith(reported):
            raise Stopped("enough")

    point = settled("car")
    with pytest.raises(Stopped, match="enough"):
        rehearsal.with_trial_runs(
            point, compare(point, PreconditionerKind.RESISTIVE_GRID, 1.0, stop), stop
        )


def test_a_fixed_recipe_is_compared_by_its_penalties_only():
    gain_rule = GainRule(equilibration_sweeps=7, target=1.1)
    found = compare(settled("unicycle"), PreconditionerKind.MULTILEVEL, 1.0, gain_rule=gain_rule)
    assert all(candidate.gain_rule is gain_rule for candidate in found)
    assert len({candidate.penalty_factor for candidate in found}) == len(found) >= 3


def test_a_candidate_tells_the_spectrum_of_its_network():
    point = settled("car")
    found = candidate_of(point, freeze.GAIN_RULES[PreconditionerKind.CYCLIC_REDUCTION], 1.0)
    flow = apply_gains(point.network, found.gains)
    assert flow.preconditioner.kind is PreconditionerKind.CYCLIC_REDUCTION
    assert found.ratio == found.spectrum.stiffness_ratio < 10


def test_a_grid_below_the_threshold_says_which_penalty_it_needs():
    point, gain_rule = settled("pendulum"), freeze.GAIN_RULES[PreconditionerKind.RESISTIVE_GRID]
    low = replace(gain_rule, penalty=0.5)
    with pytest.raises(DesignError, match=r"above rho\* = .* gain rule with penalty > ") as caught:
        candidate_of(point, low, 1.0)
    needed = float(str(caught.value).partition("penalty > ")[2].partition(" ")[0])
    candidate_of(point, replace(gain_rule, penalty=1.01 * needed), 1.0)
    with pytest.raises(DesignError):
        candidate_of(point, replace(gain_rule, penalty=0.99 * needed), 1.0)
    assert not compare(point, PreconditionerKind.RESISTIVE_GRID, 1.0, gain_rule=low)


def test_where_nothing_attracts_the_next_rows_begin_where_these_did():
    assert downhill(lambda penalty_factor: np.inf, BOOST) == BOOST


def test_grid_leaves_a_neuron_at_its_rail_alone_and_settles():
    network = synthesize(plants.double_integrator(N=8))
    free = design(network)
    index = network.neuron_index["u.a"]
    limit = 0.9 * np.abs(free.network.unpack(free.state)[index]).max()
    neurons = tuple(
        replace(n, limiter=Limiter(low=-limit, high=limit)) if n.name == "u.a" else n
        for n in network.cell.neurons
    )
    with_limits = replace(network, cell=replace(network.cell, neurons=neurons))
    found = design(with_limits, preconditioner=PreconditionerKind.RESISTIVE_GRID)
    assert found.settled
    saturated = np.abs(with_limits.unpack(found.state)[index]) >= limit
    assert 0 < saturated.sum() < with_limits.stages
    own = found.gains.preconditioner.own
    row = list(with_limits.layout.primal).index(index)
    coupled = np.abs(own[:, row]).sum(axis=1) - own[:, row, row]
    assert not coupled[saturated].any()
    assert coupled[~saturated].all()
    assert found.best.settling < np.inf


@pytest.mark.parametrize("kind", list(PreconditionerKind))
def test_what_is_compared_is_what_the_network_will_do(kind):
    """To the bit, though of a candidate only a tape is made."""
    settled = SettledPoint(Linearisation(designed("car").network), designed("car").state)
    settled = SettledPoint(settled.linear.at(settled.state), settled.state)
    gains = candidate_of(settled, freeze.GAIN_RULES[kind], 1.0).gains
    frozen = spectrum(apply_gains(settled.network, gains), settled.state)
    assert (freeze.spectrum_with(settled, gains).eigenvalues == frozen.eigenvalues).all()


@pytest.mark.parametrize("rate", [0.0, -1.0, np.inf, np.nan])
def test_gains_that_no_network_can_have_have_no_spectrum(rate):
    found = designed("car")
    settled = SettledPoint(Linearisation(found.network).at(found.state), found.state)
    rates = found.gains.rate.copy()
    rates[3, 2] = rate
    for refusing in (freeze.spectrum_with, lambda at, gains: apply_gains(at.network, gains)):
        with pytest.raises(AnnDcError):
            refusing(settled, replace(found.gains, rate=rates))
