"""Amplitude and time scaling: everything within full scale, and the way back."""

from functools import cache

import numpy as np
import pytest
from designs import designed
from hypothesis import given, strategies as st

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.network.cell import Product


@cache
def probe(name: str):
    """(network, trajectory, radius) of a settled run."""
    network = designed(name).network
    run = OdeBackend(method=DOP853, verify=False).run(network).trajectory
    return network, run, spectrum(network, run.final).radius


def probe_run(run, radius: float) -> ProbeRun:
    return ProbeRun(states=run.states, times=run.time, radius=radius)


def scaled(name: str, **settings):
    network, run, radius = probe(name)
    return scale(network, probe_run(run, radius), ScalingRules(**settings))


@pytest.mark.parametrize("name", ["car", "double_integrator", "cstr"])
def test_every_node_stays_within_full_scale_on_the_whole_way(name):
    network, run, _ = probe(name)
    scaling = scaled(name, headroom=1.1)
    values = evaluator(network).values(run.states)[..., 1:-1]
    for node, row in network.node_index.items():
        if node != "one":
            assert np.abs(scaling.volts(node, values[:, row])).max() <= 1 / 1.1 + 1e-12


@pytest.mark.slow
@given(value=st.floats(-1e3, 1e3), full_scale=st.floats(0.1, 15))
def test_volts_lead_back_to_values(value, full_scale):
    scaling = scaled("double_integrator", full_scale=full_scale)
    for node in scaling.unit:
        assert scaling.value(node, scaling.volts(node, value)) == pytest.approx(value, rel=1e-12)


def test_a_multiplier_computes_the_product_of_its_factors_over_full_scale():
    scaling = scaled("car", full_scale=10.0)
    for block in scaling.network.cell.blocks:
        if isinstance(block, Product):
            a, b = 0.3 * scaling.unit[block.a], -0.7 * scaling.unit[block.b]
            volts = scaling.volts(block.a, a) * scaling.volts(block.b, b) / scaling.full_scale
            assert scaling.volts(block.name, a * b) == pytest.approx(volts)


def test_time_is_scaled_by_the_fastest_mode_and_the_op_amps():
    _, _, radius = probe("car")
    scaling = scaled("car", gbw=5e6, bandwidth_margin=8.0)
    fastest = scaling.time / radius  # seconds
    assert fastest * 2 * np.pi * 5e6 == pytest.approx(8.0)


def test_the_report_names_the_tightest_and_the_loosest_node():
    scaling = scaled("car")
    used = {node: scaling.used(node) for node in scaling.peaks}
    assert used[scaling.tightest] == max(used.values()) == pytest.approx(1 / 1.2)
    assert scaling.tightest in str(scaling)
    assert scaling.loosest in str(scaling)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("gbw", 0.0),
        ("bandwidth_margin", -1.0),
        ("full_scale", np.nan),
        ("headroom", 0.5),
        ("gbw", np.inf),
    ],
)
def test_a_setting_out_of_range_is_named(setting, value):
    with pytest.raises(NetworkError, match=setting):
        scaled("double_integrator", **{setting: value})


def test_a_run_that_is_not_finite_cannot_scale():
    _, run, radius = probe("double_integrator")
    with pytest.raises(NetworkError, match="it has to settle"):
        ProbeRun(states=np.full_like(run.states, np.nan), times=run.time, radius=radius)
    for value in (0.0, -1.0, np.nan):
        with pytest.raises(NetworkError, match=r"^radius: expected"):
            probe_run(run, value)


# ---- declared intervals --------------------------------------------------------------------------


def test_a_declared_interval_counts_instead_of_the_probe_run():
    network, run, _ = probe("double_integrator")
    seen = scale(network, probe_run(run, 1.0))
    scale_of_a = network.neuron("u.a").scale
    wide = {"u.a": (-100.0, 50.0)}
    declared = scale(network, probe_run(run, 1.0), ScalingRules(intervals=wide))
    assert declared.unit["u.a"] == pytest.approx(1.2 * abs(scale_of_a.network(-100.0)))
    assert declared.unit["q.x"] == seen.unit["q.x"]
    for interval, meaning in (
        ({"u.b": (-1, 1)}, "u.b"),
        ({"u.a": (1.0, -1.0)}, "low < high"),
        ({"u.a": (-1e-6, 1e-6)}, "the probe run went from"),
    ):
        with pytest.raises((NetworkError, UnknownNameError), match=meaning):
            scale(network, probe_run(run, 1.0), ScalingRules(intervals=interval))
