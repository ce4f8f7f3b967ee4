"""What is said to keep a circuit from ringing does."""

import re
from dataclasses import replace

import numpy as np
import pytest
from constrained import dint_v
from wired import neighbour_wired

from ann_dc import PreconditionerKind, design
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.sizing.bandwidth_margin import cure, is_stable, least_margin


def built(level, **given):
    """(circuit, settled state) with resistors or a margin that are given."""
    circuit, probe = SpiceBackend(level=level, **given).prepare(
        neighbour_wired("double_integrator", 4)
    )
    return circuit, probe.final


def numbers(said: str) -> list[float]:
    """All that are told to be taken."""
    return [float(n) for n in re.findall(r"(?:margin to|margin of|resistor of) (\S+)", said)]


@pytest.mark.slow
def test_resistors_and_margins_that_are_named_cure():
    level = presets.get("opa192_ad734")
    rings = replace(level, smallest_resistor=1e5)
    circuit, x = built(rings, bandwidth_margin=10.0)
    assert not is_stable(circuit, rings, x)
    said = cure(circuit, rings, x)
    assert said.startswith("raise the margin to ")
    assert said.endswith(" ohm, for the 1.1e-11 F at every virtual ground")
    bandwidth_margin, ohms = numbers(said)
    for given in (
        {"smallest_resistor": 1e5, "bandwidth_margin": bandwidth_margin},
        {"smallest_resistor": ohms},
    ):
        cured = replace(level, smallest_resistor=given.pop("smallest_resistor"))
        assert is_stable(built(cured, **({"bandwidth_margin": 10.0} | given))[0], cured, x)


@pytest.mark.slow
def test_smaller_resistors_and_a_larger_margin_are_named_together():
    level = presets.get("opa192_ad734")
    rings = replace(level, smallest_resistor=1e7)
    circuit, x = built(rings, bandwidth_margin=2.0)
    assert np.isinf(least_margin(circuit, rings, x))
    ohms, bandwidth_margin = numbers(cure(circuit, rings, x))
    cured = replace(level, smallest_resistor=ohms)
    assert not is_stable(built(cured, bandwidth_margin=2.0)[0], cured, x)
    assert is_stable(built(cured, bandwidth_margin=bandwidth_margin)[0], cured, x)


@pytest.mark.slow
def test_resistors_that_no_margin_suits_are_refused_with_some_that_do():
    level = presets.get("opa192_ad734")
    with pytest.raises(NetworkError, match="no margin makes the circuit stable; use a ") as refusal:
        built(replace(level, smallest_resistor=1e7))
    (ohms,) = numbers(str(refusal.value))
    cured = replace(level, smallest_resistor=ohms)
    circuit, x = built(cured)
    assert is_stable(circuit, cured, x)


@pytest.mark.slow
def test_a_faster_grid_is_named_where_margins_alone_do_not_cure():
    """Nodes lag by a share of network time, whatever the margin."""
    network = design(dint_v(), preconditioner=PreconditionerKind.RESISTIVE_GRID).network
    level = macro()
    circuit, probe = SpiceBackend(level=level).prepare(network)
    reported = cure(circuit, level, probe.final)
    (bandwidth_margin,) = numbers(reported)
    assert "node_lag of one tenth" in reported
    lag = SpiceBackend().node_lag
    for share, stable in ((1.0, False), (0.1, True)):
        cured, probe = SpiceBackend(
            level=level, bandwidth_margin=bandwidth_margin, node_lag=share * lag
        ).prepare(network)
        assert is_stable(cured, level, probe.final) == stable


def test_where_nothing_helps_other_op_amps_do(monkeypatch):
    cases = [
        (level, meant, *built(level))
        for level, meant in (
            (macro(Datasheet()), "use faster op amps"),
            (presets.get("opa192_ad734"), "use op amps with less capacitance"),
        )
    ]
    monkeypatch.setattr(
        "ann_dc.hardware.sizing.bandwidth_margin.least_margin", lambda *_, **__: np.inf
    )
    for level, meant, circuit, x in cases:
        assert cure(circuit, level, x) == f"no margin is sufficient; {meant}"
