"""Margins of circuits with a metric; the smallest one of others is tested with predictions."""

import pytest
from metric_networks import with_metric
from wired import prepared

from ann_dc.backends.spice import SpiceBackend
from ann_dc.fidelity import fitting_margin, smallest_margin
from ann_dc.hardware.parts import macro
from ann_dc.network.metrics import Kind


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Kind.PYRAMID, Kind.TREE])
def test_a_metric_asks_for_faster_op_amps(kind):
    circuit, probe = SpiceBackend(level=macro()).prepare(with_metric("double_integrator", kind, 5))
    margin = smallest_margin(circuit, macro(), probe)
    assert 1 < margin < 1000
    assert fitting_margin(circuit, macro(), probe) == 1.5 * margin


def test_without_a_metric_the_usual_margin_fits():
    assert fitting_margin(*prepared_for_macro()) == pytest.approx(10, rel=0.25)


def prepared_for_macro():
    circuit, probe = prepared(False)
    return circuit, macro(), probe
