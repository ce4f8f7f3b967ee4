"""The smallest margin; what it is of plants without parasitics is tested with predictions."""

import pytest
from wired import neighbour_wired

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, switched_capacitor
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.sizing.bandwidth_margin import is_stable, least_margin


def test_more_capacitance_asks_for_more_margin():
    network = neighbour_wired("double_integrator", 4)
    circuit, probe = SpiceBackend(level=macro()).prepare(network)
    levels = [
        macro(Datasheet(a0=1e6, parasitics=Parasitics(stray_capacitance=farads)))
        for farads in (0.0, 10e-12, 30e-12)
    ]
    reported: list[str] = []
    none, some, much = (
        least_margin(circuit, level, probe.final, progress=reported.append) for level in levels
    )
    assert reported[0] == "smallest margin: is 1 enough?"
    assert none < some < much
    assert is_stable(
        circuit.slower(1.02 * much / circuit.scaling.bandwidth_margin), levels[2], probe.final
    )
    # it is of the resistors, whatever the margin and with it the capacitors are
    again = least_margin(circuit.slower(4.0), levels[2], probe.final)
    assert again == pytest.approx(much, rel=0.02)


def test_a_level_without_an_emulation_has_none():
    network = neighbour_wired("double_integrator", 4)
    circuit, probe = SpiceBackend(level=BEHAVIOURAL).prepare(network)
    with pytest.raises(NetworkError, match="not a network in continuous time"):
        least_margin(circuit, switched_capacitor(step=0.1), probe.final)
