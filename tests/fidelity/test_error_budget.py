"""What errors of parts cost: the linear budget against draws, and resistors from a series."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.error_budget import budget, sensitivity, total_error
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.deviations import draw, rounded_to_series
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.datasheet import TYPICAL, Datasheet, Tolerances
from ann_dc.hardware.parts.e_series import (
    E12,
    E24,
    E24_PAIRS,
    E96,
    E96_PAIRS,
    EXACT,
    SERIES,
    Series,
)
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

HARDWARE = Datasheet(a0=1e6)


@cache
def prepared():
    """(components, probe run) of the double integrator over five stages."""
    problem = plants.double_integrator(N=5)
    network = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    return SpiceBackend(level=macro()).prepare(network)


def settled(deviations=None):
    """(emulation, its equilibrium)."""
    circuit, probe = prepared()
    emulation = emulate(circuit, macro(HARDWARE), deviations)
    return emulation, equilibrium(emulation.network, emulated_state(emulation, probe.final))


def controls(deviations=None) -> np.ndarray:
    """In the user's units."""
    emulation, x = settled(deviations)
    network = emulation.network
    return network.user_units(x)[network.of_population("u")]


def moved(deviations) -> np.ndarray:
    """How far the controls move, over the largest one."""
    return (controls(deviations) - controls()) / np.abs(controls()).max()


@cache
def found():
    return sensitivity(*settled())


# ---- the budget ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("tolerances", [TYPICAL, Tolerances(offset=1e-3)], ids=["all", "offsets"])
def test_the_total_is_the_spread_of_circuits_that_are_drawn(tolerances):
    known = prepared()[0].parameters
    shifts = np.array([moved(draw(known, tolerances, seed)) for seed in range(60)])
    assert shifts.std(axis=0).max() == pytest.approx(total_error(found(), tolerances), rel=0.2)


def test_an_item_is_one_parameter_in_all_its_cells():
    """By finite differences, of the item that costs most and of one that costs little."""
    items = budget(found())
    for item in (items[0], items[-1]):
        name, present = item.parameter.name, item.parameter.present
        step = 1e-4 if item.parameter.kind.unit == "1" else 1e-5
        each = [moved({name: step * (np.arange(5) == k)}) / step for k in np.flatnonzero(present)]
        error = item.size * np.sqrt(np.square(each).sum(axis=0)).max()
        assert item.error == pytest.approx(error, rel=5e-3, abs=1e-8)


def test_shares_add_up_and_the_worst_comes_first():
    items = budget(found())
    assert sum(item.share for item in items) == pytest.approx(1)
    assert [item.share for item in items] == sorted((i.share for i in items), reverse=True)
    assert {item.parameter.name for item in items} == {p.name for p in found().parameters}
    assert not [item for item in items if item.parameter.kind.value == "capacitor"]
    worst = total_error(found()) ** 2  # of one control; an item tells of the one it hurts most
    assert all(item.error**2 >= item.share * worst * (1 - 1e-9) for item in items)


def test_errors_add_up_as_squares():
    apart = [
        replace(Tolerances(), **{kind: getattr(TYPICAL, kind)}) for kind in ("resistor", "offset")
    ]
    both = replace(apart[0], offset=TYPICAL.offset)
    total = np.sqrt(sum(total_error(found(), tolerances) ** 2 for tolerances in apart))
    assert total_error(found(), both) == pytest.approx(total, rel=0.05)
    twice = replace(both, resistor=2 * both.resistor, offset=2 * both.offset)
    assert total_error(found(), twice) == pytest.approx(2 * total_error(found(), both))


def test_parts_without_a_spread_cost_nothing():
    assert budget(found(), Tolerances()) == ()
    assert total_error(found(), Tolerances()) == 0
    assert budget(found(), Tolerances(capacitor=0.1)) == ()  # capacitors move no settled point
    kinds = {item.parameter.kind.value for item in budget(found(), Tolerances(offset=1e-3))}
    assert kinds == {"offset"}


def test_the_shift_is_linear_and_that_of_newtons_method():
    known = prepared()[0].parameters
    a, b = (draw(known, Tolerances(resistor=1e-5, offset=1e-6), seed) for seed in (1, 2))
    both = {name: 2 * a[name] - 3 * b[name] for name in a}
    shift = found().shift
    np.testing.assert_allclose(shift(both), 2 * shift(a) - 3 * shift(b), atol=1e-15)
    np.testing.assert_allclose(shift(a), moved(a), rtol=1e-3, atol=1e-8)
    assert not shift({}).any()
    capacitor = next(p.name for p in known if p.kind.value == "capacitor")
    assert not shift({capacitor: np.full(5, 0.1)}).any()
    one = {budget(found())[0].parameter.name: 1e-3}  # a number for all cells
    np.testing.assert_allclose(shift(one), shift({n: np.full(5, v) for n, v in one.items()}))


# ---- resistors that can be bought ----------------------------------------------------------------

OHMS = st.floats(1.0, 1e9)
SINGLES, PAIRS = (E12, E24, E96), (E24_PAIRS, E96_PAIRS)


def nearest(series: Series, ohms: float) -> float:
    return float(series.nearest(np.array(ohms)))


def off(series: Series, ohms: float) -> float:
    return abs(np.log(nearest(series, ohms) / ohms))


def values(series: Series, ohms: float, decades: int = 5) -> np.ndarray:
    """All values of a series up to 100 times a resistance."""
    powers = 10.0 ** (np.floor(np.log10(ohms)) + np.arange(1 - decades, 2))
    return np.outer(powers, series.mantissas).ravel()


def test_the_preferred_numbers_are_those_of_iec_60063():
    assert E12.mantissas == (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)
    assert len(E24.mantissas) == 24
    assert set(E12.mantissas) < set(E24.mantissas)
    assert len(E96.mantissas) == 96
    assert E96.mantissas[:5] + E96.mantissas[-2:] == (1.0, 1.02, 1.05, 1.07, 1.1, 9.53, 9.76)
    assert SERIES.keys() == {"exact", "E12", "E24", "E96", "E24 pairs", "E96 pairs"}


@pytest.mark.parametrize("series", SINGLES, ids=lambda series: series.name)
@given(ohms=OHMS)
@settings(max_examples=60, deadline=None)
def test_nothing_in_a_series_is_nearer(series, ohms):
    there = values(series, ohms)
    assert np.isclose(there, nearest(series, ohms), rtol=1e-12).any()
    assert off(series, ohms) <= np.abs(np.log(there / ohms)).min() + 1e-12


@pytest.mark.parametrize("series", PAIRS, ids=lambda series: series.name)
@given(ohms=OHMS)
@settings(max_examples=30, deadline=None)
def test_no_two_of_a_series_are_nearer(series, ohms):
    there = values(series, ohms)
    sums = np.concatenate([there, np.add.outer(there, there).ravel()])
    chosen = nearest(series, ohms)
    assert np.isclose(sums, chosen, rtol=1e-12).any()
    assert abs(chosen - ohms) <= 1.01 * np.abs(sums - ohms).min() + 1e-9 * ohms


@given(ohms=OHMS)
@settings(max_examples=60, deadline=None)
def test_two_resistors_are_as_near_as_one_at_least(ohms):
    assert off(E24_PAIRS, ohms) <= off(E24, ohms) + 1e-4  # nearest by difference, not by ratio
    assert off(E96_PAIRS, ohms) <= off(E96, ohms) + 1e-12
    assert off(E96_PAIRS, ohms) < 1e-3


@pytest.mark.parametrize("series", [*SINGLES, *PAIRS], ids=lambda series: series.name)
@given(mantissa=st.floats(1.0, 9.99), decade=st.integers(0, 8))
@settings(max_examples=30, deadline=None)
def test_ten_times_the_resistor_is_ten_times_the_choice(series, mantissa, decade):
    once, later = off(series, mantissa), off(series, mantissa * 10.0**decade)
    assert later == pytest.approx(once, abs=1e-12)


@pytest.mark.parametrize("series", SERIES.values(), ids=SERIES.keys())
def test_shapes_and_infinite_ones_stay(series):
    ohms = np.array([[np.inf, 10e3, 12.34e3], [15e3, np.inf, 1e6]])
    chosen = series.nearest(ohms)
    assert chosen.shape == ohms.shape
    np.testing.assert_array_equal(np.isinf(chosen), np.isinf(ohms))
    kept = chosen[[0, 1, 1], [1, 0, 2]]
    np.testing.assert_allclose(kept, [10e3, 15e3, 1e6])
    np.testing.assert_array_equal(series.nearest(ohms.T), chosen.T)


def half_step(series: Series) -> float:
    steps = np.diff(np.log([*series.mantissas, 10.0]))
    return 0.5 * float(steps.max())


@pytest.mark.parametrize("series", SINGLES, ids=lambda series: series.name)
def test_a_resistor_is_off_by_half_a_step_at_most(series):
    deviations = {
        n: d for n, d in rounded_to_series(prepared()[0], series).items() if n.startswith("r")
    }
    assert deviations
    largest = max(np.abs(np.log1p(d)).max() for d in deviations.values())
    assert 0.1 * half_step(series) < largest <= half_step(series) + 1e-12


def test_what_is_snapped_can_be_bought():
    circuit, _ = prepared()
    alias = circuit.alias
    deviations = rounded_to_series(circuit, E24)
    assert deviations.keys() <= {p.name for p in circuit.parameters}
    for part, ohms in circuit.resistors.items():
        for number, row in enumerate(ohms):
            there = np.isfinite(row)
            bought = row * (1 + deviations.get(f"r_{alias[part]}_{number}", np.zeros(5)))
            np.testing.assert_allclose(bought[there], E24.nearest(row[there]), rtol=1e-12)
    for part, ohms in circuit.feedback.items():
        bought = ohms * (1 + deviations.get(f"rf_{alias[part]}", np.zeros(5)))
        np.testing.assert_allclose(bought, nearest(E24, ohms), rtol=1e-12)


@pytest.mark.parametrize(
    ("series", "bought"),
    [(E12, E12), (E24, E24), (E96, E24), (E96_PAIRS, E24)],
    ids=lambda of: of.name,
)
def test_capacitors_are_of_a_coarser_series_and_move_no_control(series, bought):
    circuit, _ = prepared()
    deviations = rounded_to_series(circuit, series)
    off = {name: each for name, each in deviations.items() if name.startswith("c_")}
    listed = [p for p in circuit.parameters if p.name in off]
    assert {p.part for p in listed} == {*circuit.capacitors}
    for parameter in listed:
        farads, there = circuit.capacitors[parameter.part], parameter.present
        values = farads * (1 + off[parameter.name])
        np.testing.assert_allclose(values[there], bought.nearest(farads[there]), rtol=1e-12)
    np.testing.assert_allclose(moved(off), 0.0, atol=1e-9)


@pytest.mark.parametrize("series", [*SINGLES, *PAIRS], ids=lambda series: series.name)
def test_the_same_resistor_is_off_by_the_same_in_every_cell(series):
    circuit, _ = prepared()
    deviations, alias = rounded_to_series(circuit, series), circuit.alias
    for part, ohms in circuit.resistors.items():
        for number, row in enumerate(ohms):
            name = f"r_{alias[part]}_{number}"
            for value in np.unique(row[np.isfinite(row)]):
                same = deviations.get(name, np.zeros(5))[row == value]
                assert np.ptp(same) == 0, name
            assert not deviations.get(name, np.zeros(5))[np.isinf(row)].any()


def test_exact_resistors_are_not_off():
    assert rounded_to_series(prepared()[0], EXACT) == {}
    np.testing.assert_array_equal(EXACT.nearest(np.array([1.234, np.inf])), [1.234, np.inf])


def test_pairs_move_the_controls_less_and_the_slopes_say_how_far():
    shifts = {}
    for series in (E24, E96, E96_PAIRS):
        deviations = rounded_to_series(prepared()[0], series)
        shifts[series], predicted = moved(deviations), found().shift(deviations)
        size = max(np.abs(d).max() for n, d in deviations.items() if n.startswith("r"))
        np.testing.assert_allclose(
            predicted, shifts[series], atol=5 * size * np.abs(predicted).max()
        )
    worst = [float(np.abs(shift).max()) for shift in shifts.values()]
    assert worst[2] < 0.1 * worst[1] < worst[1] < worst[0]
