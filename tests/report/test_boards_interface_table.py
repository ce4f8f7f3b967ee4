"""Converters in words: the circuit itself counts, and has to settle."""

import math

import pytest
from rich.console import Console

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.interface import Interface, InterfaceCost
from ann_dc.report.boards import InterfaceTable


@pytest.mark.parametrize(
    ("circuit_error", "noise", "settling_time", "good", "reported"),
    [
        (1e-3, math.nan, 1e-5, True, "nearby inputs included; 1.00e-03 from the circuit"),
        (1e-3, 9e-3, 1e-5, True, "noise of 9.0e-03 rms in addition"),
        (1e-3, 1e-2, 1e-5, False, "noise of 1.0e-02 rms in addition"),
        (9e-3, 1e-4, 1e-5, False, "1.10e-02 at most"),
        (1e-3, 1e-4, math.nan, False, "the circuit does not reach its equilibrium"),
        (math.nan, math.nan, math.nan, False, "the circuit oscillates"),
    ],
)
def test_the_verdict_is_of_the_circuit(circuit_error, noise, settling_time, good, reported):
    cost = InterfaceCost(
        interface=Interface(adc_bits=10), rounded={}, input_error=0.0, worst_input_error=0.0,
        output_error=2e-3, error=2e-3, circuit_error=circuit_error, noise=noise,
        settling_time=settling_time, cold_settling_time=math.nan, other_equilibrium="",
    )  # fmt: skip
    table = InterfaceTable(cost=cost, backend=SpiceBackend())
    console = Console(width=200)
    with console.capture() as said:
        console.print(*table.tables())
    assert table.good == good
    assert reported in said.get()
