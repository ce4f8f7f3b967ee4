"""Deviations: draws that stay put, several at once, and what makes no sense."""

from functools import cache

import numpy as np
import pytest
from designs import small
from hypothesis import given, settings, strategies as st

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.deviations import checked_deviations, combined, draw
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import Kind, Tolerances
from ann_dc.hardware.parts.levels import macro

FULL = Tolerances(resistor=0.01, capacitor=0.02, offset=1e-3, gain=0.03, product_offset=2e-3)


@cache
def prepared(name: str):
    network = design(small(name), gain_rule=DIAGONAL_RULE).network
    return SpiceBackend(level=macro()).prepare(network)


@cache
def known(name: str):
    return prepared(name)[0].parameters


# ---- draws ---------------------------------------------------------------------------------------


def same(a, b) -> bool:
    return a.keys() == b.keys() and all((a[name] == b[name]).all() for name in a)


@pytest.mark.slow
@settings(deadline=None)  # the first example designs the car
@given(seed=st.integers(0, 2**32))
def test_the_same_seed_gives_the_same_errors_and_another_others(seed):
    first = draw(known("car"), FULL, seed)
    assert same(first, draw(known("car"), FULL, seed))
    other = draw(known("car"), FULL, seed + 1)
    assert not any((first[name] == other[name]).any() for name in first if known_all(name))


def known_all(name: str) -> bool:
    """Whether every cell of the car has that parameter."""
    return next(p for p in known("car") if p.name == name).present.all()


@pytest.mark.parametrize("kind", Kind)
def test_the_size_of_one_kind_leaves_the_other_kinds_as_they_are(kind):
    sizes = {k.value: getattr(FULL, k.value) for k in Kind}
    plain = draw(known("car"), FULL, 3)
    moved = draw(known("car"), Tolerances(**(sizes | {kind.value: 2 * sizes[kind.value]})), 3)
    for p in known("car"):
        factor = 2.0 if p.kind is kind else 1.0
        np.testing.assert_array_equal(moved[p.name], factor * plain[p.name])
    without = draw(known("car"), Tolerances(**(sizes | {kind.value: 0.0})), 3)
    rest = {name for name in plain if next(p for p in known("car") if p.name == name).kind is kind}
    assert without.keys() == plain.keys() - rest
    assert same(without, {name: plain[name] for name in without})


def test_no_spread_draws_nothing():
    assert draw(known("car"), Tolerances(), 1) == {}


def test_errors_are_of_their_sizes_and_where_the_parts_are():
    drawn = [draw(known("car"), FULL, seed) for seed in range(30)]
    for kind in Kind:
        mine = [p for p in known("car") if p.kind is kind]
        errors = np.concatenate([d[p.name][p.present] for d in drawn for p in mine])
        size = FULL.deviation(kind)
        assert errors.std() == pytest.approx(size, rel=4 / np.sqrt(2 * len(errors)))
        assert abs(errors.mean()) < 4 * size / np.sqrt(len(errors))
        assert all((d[p.name][~p.present] == 0).all() for d in drawn for p in mine)


@pytest.mark.parametrize("kind", Kind)
def test_resistors_and_capacitors_keep_within_their_bounds_and_nothing_else_does(kind):
    drawn = [draw(known("car"), FULL, seed) for seed in range(30)]
    mine = [p for p in known("car") if p.kind is kind]
    errors = np.concatenate([d[p.name][p.present] for d in drawn for p in mine])
    sizes = np.sort(np.abs(errors)) / getattr(FULL, kind.value)
    assert (sizes[-1] <= 1) == kind.bounded
    half = np.searchsorted(sizes, 0.5) / len(sizes)  # uniform 0.5, normal 0.383
    assert half == pytest.approx(0.5 if kind.bounded else 0.3829, abs=2 / np.sqrt(len(sizes)))


DRIFTING = Tolerances(resistor=1e-3, offset=1e-4, gain=0.03, resistor_drift=1e-4, offset_drift=1e-5)


def drawn_at(celsius: float, seed: int = 3) -> dict[str, np.ndarray]:
    return draw(known("car"), DRIFTING.at(Conditions(temperature=celsius)), seed)


def test_parts_drift_as_far_one_way_in_heat_as_the_other_way_in_cold():
    cold, room, hot, hotter = (drawn_at(celsius) for celsius in (-23.0, 27.0, 77.0, 127.0))
    assert same(room, draw(known("car"), DRIFTING, 3))
    for p in known("car"):
        if p.kind is Kind.CAPACITOR or p.kind is Kind.PRODUCT_OFFSET:
            continue
        drift = hot[p.name] - room[p.name]
        np.testing.assert_allclose(cold[p.name] - room[p.name], -drift, atol=1e-15)
        np.testing.assert_allclose(hotter[p.name] - room[p.name], 2 * drift, atol=1e-15)
        assert drift[p.present].any() == (p.kind in (Kind.RESISTOR, Kind.OFFSET))


@pytest.mark.parametrize("celsius", [-23.0, 77.0])
@pytest.mark.parametrize("kind", [Kind.RESISTOR, Kind.OFFSET])
def test_drifts_have_either_sign_whatever_the_error_and_add_up_to_the_size_told(kind, celsius):
    pairs = [(drawn_at(27.0, seed), drawn_at(celsius, seed)) for seed in range(30)]
    mine = [p for p in known("car") if p.kind is kind]
    room, there = (
        np.concatenate([pair[n][p.name][p.present] for pair in pairs for p in mine]) for n in (0, 1)
    )
    drift, few = there - room, 4 / np.sqrt(len(room))
    assert abs((drift > 0).mean() - 0.5) < few / 2
    assert abs(np.corrcoef(room, drift)[0, 1]) < few
    sizes = DRIFTING.at(Conditions(temperature=celsius))
    assert there.std() == pytest.approx(sizes.deviation(kind), rel=few)
    assert (np.abs(there).max() <= sizes.size(kind)) == kind.bounded


def test_parts_that_only_drift_are_drawn_away_from_room_temperature():
    drifting = Tolerances(offset_drift=1e-6)
    assert draw(known("car"), drifting, 1) == {}
    there = draw(known("car"), drifting.at(Conditions(temperature=37.0)), 1)
    assert there.keys() == {p.name for p in known("car") if p.kind is Kind.OFFSET}


def test_relative_errors_multiply_and_volts_add_up():
    both = combined(
        known("car"), {"r_q_x_0": 0.1, "vos_q_x": 1e-3}, {"r_q_x_0": 0.2, "vos_q_x": 2e-3}
    )
    assert both["r_q_x_0"] == pytest.approx(1.1 * 1.2 - 1)
    assert both["vos_q_x"] == pytest.approx(3e-3)


# ---- what is refused -----------------------------------------------------------------------------


def test_one_number_stands_for_all_cells():
    found = checked_deviations(known("car"), {"vos_q_x": 1e-3})
    np.testing.assert_array_equal(found["vos_q_x"], np.full(4, 1e-3))


@pytest.mark.parametrize(
    ("given", "error", "meaning"),
    [
        ({"vos_nothing": 0.0}, UnknownNameError, "vos_nothing.*does not exist.*vos_q_x"),
        ({"vos_q_x": np.nan}, NetworkError, "vos_q_x: expected finite"),
        ({"r_q_x_0": np.inf}, NetworkError, "r_q_x_0: expected finite"),
        ({"r_q_x_0": [0, 0, -1.0, 0]}, NetworkError, "r_q_x_0: expected finite numbers above -1"),
        ({"c_q_x": -2.0}, NetworkError, "c_q_x: expected finite numbers above -1"),
    ],
)
def test_a_deviation_that_makes_no_sense_is_named(given, error, meaning):
    with pytest.raises(error, match=meaning):
        checked_deviations(known("car"), given)
