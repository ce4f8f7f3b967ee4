"""Drawn circuits: what runs in ngspice, and what is said of those that did not settle."""

from types import SimpleNamespace

import numpy as np

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.fidelity import circuit_study as monte_carlo
from ann_dc.fidelity.circuit_study import measured_errors
from ann_dc.hardware.parts.levels import macro


def test_a_circuit_that_still_moves_has_no_error(monkeypatch):
    """As one that ngspice did not end."""
    runs = [
        SimpleNamespace(unsettled="", control_error=0.01),
        SimpleNamespace(unsettled="the controls still change", control_error=0.02),
        None,
    ]
    monkeypatch.setattr(monte_carlo, "measured_runs", lambda *given: runs)
    network = design(
        plants.double_integrator(N=3), preconditioner=PreconditionerKind.DIAGONAL
    ).network
    level = macro()
    errors = measured_errors(*_circuit(network, level), seeds=range(3))
    assert errors[0] == 0.01
    assert np.isnan(errors[1:]).all()


def _circuit(network, level):
    circuit, probe = SpiceBackend(level=level).prepare(network)
    return circuit, level, probe
