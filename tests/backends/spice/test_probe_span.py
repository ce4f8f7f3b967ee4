"""How long circuits are simulated: as long as their slowest pole takes, up to a bound."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.probe import span_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize


@cache
def prepared(bandwidth_margin: float = 10.0):
    network = design(
        synthesize(plants.double_integrator(N=5)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    return SpiceBackend(level=macro(), bandwidth_margin=bandwidth_margin).prepare(network)


def cut_short(share: float):
    """The circuit, and its probe ended after a share of its time."""
    circuit, probe = prepared()
    steps = max(int(np.searchsorted(probe.time, share * probe.time[-1])), 1)
    ended = replace(probe, time=probe.time[:steps], states=probe.states[-steps:])
    return circuit, ended


def test_a_circuit_as_fast_as_its_network_runs_one_and_a_half_times_as_long():
    circuit, probe = prepared()
    for level in (macro(), BEHAVIOURAL):
        span = span_of(circuit, level, probe)
        assert span.duration == pytest.approx(1.5 * probe.time[-1])
        assert not span.cut


def test_a_circuit_that_is_slower_runs_for_fourteen_of_its_slowest_time_constants():
    circuit, short = cut_short(0.1)
    level = macro(a0=1e4)
    slowest = -1 / pole_spectrum(emulate(circuit, level), short.final).abscissa
    span = span_of(circuit, level, short)
    assert span.duration == pytest.approx(14 * slowest)
    assert span.duration > 1.5 * short.time[-1]
    assert not span.cut


@pytest.mark.parametrize("a0", [1e6, 1e8])
def test_span_of_circuit_with_small_error_leaves_a_fiftieth_of_it(a0):
    circuit, short = cut_short(0.1)
    instance = CircuitInstance(circuit=circuit, level=macro(a0=a0), probe=short)
    span = span_of(circuit, instance.level, short)
    left = np.exp(instance.modes.abscissa * span.duration) * short.control_reach
    assert left == pytest.approx(0.02 * instance.control_error * short.control_size, rel=1e-3)
    assert span.duration > span.wanted
    assert not span.cut


def test_beyond_twenty_times_the_network_it_is_cut_and_the_deck_says_so(monkeypatch):
    circuit, short = prepared()
    monkeypatch.setattr("ann_dc.backends.spice.probe._slowest", lambda *_: 10 * short.time[-1])
    span = span_of(circuit, macro(), short)
    assert span.duration == pytest.approx(20 * short.time[-1])
    assert "the slowest pole requires a run" in span.cut
    deck = SpiceBackend(level=macro()).deck(circuit, short, {})
    assert deck.cut == span.cut
    assert f"* {span.cut}\n" in deck.text


def test_where_a_pole_grows_the_probe_alone_says_how_long():
    circuit, probe = prepared(bandwidth_margin=1.0)
    assert pole_spectrum(emulate(circuit, macro()), probe.final).abscissa > 0
    assert span_of(circuit, macro(), probe).duration == pytest.approx(1.5 * probe.time[-1])


@pytest.mark.parametrize("level", [macro(), BEHAVIOURAL], ids=lambda level: level.name)
def test_span_of_circuit_at_rest_is_that_of_its_slowest_mode(level):
    """The probe starts at its end and takes no time; the ideal network's slowest mode does."""
    circuit, probe = prepared()
    still = replace(probe, time=np.array([0.0, 1e-6]), states=np.stack([probe.final, probe.final]))
    span = span_of(circuit, level, still)
    lifetimes = -span.duration * spectrum(probe.network, probe.final).abscissa
    assert 13.9 < lifetimes < 30
    assert not span.cut
