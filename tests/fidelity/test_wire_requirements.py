"""Requirements of a preconditioner on its wires: within them a network is at least half as fast."""

import numpy as np
import pytest
from preconditioner_networks import BEYOND, with_preconditioner
from wired import neighbour_wired

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.wire_requirements import preconditioner_demand
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.preconditioners.base import PreconditionerKind


def settled(network) -> np.ndarray:
    run = OdeBackend(method=DOP853, verify=False).run(network)
    return equilibrium(network, run.trajectory.final)


@pytest.mark.parametrize("kind", BEYOND)
def test_every_kind_demands_something(kind):
    network = with_preconditioner("double_integrator", kind, 6)
    found = preconditioner_demand(network, settled(network))
    assert found.kind == kind.value
    assert 1e-4 < found.lag <= 1
    assert 1e-3 < found.error <= 1
    assert kind.value in str(found)
    assert f"{found.error:.2g}" in str(found)


def test_a_grid_demands_more_than_a_pyramid():
    by_kind = {}
    for kind in (PreconditionerKind.MULTILEVEL, PreconditionerKind.RESISTIVE_GRID):
        network = with_preconditioner("car", kind, 5)
        by_kind[kind] = preconditioner_demand(network, settled(network))
    assert (
        by_kind[PreconditionerKind.RESISTIVE_GRID].lag < by_kind[PreconditionerKind.MULTILEVEL].lag
    )
    assert (
        by_kind[PreconditionerKind.RESISTIVE_GRID].error
        < by_kind[PreconditionerKind.MULTILEVEL].error
    )


def test_the_lag_is_that_of_the_nodes_of_a_grid():
    """Op amps that are far faster: half the rate at the lag that is told, within its tenth."""
    network = with_preconditioner("car", PreconditionerKind.RESISTIVE_GRID, 5)
    x = settled(network)
    found, ideal = preconditioner_demand(network, x), spectrum(network, x).abscissa
    for share, slower in ((0.9, False), (1.25, True)):
        backend = SpiceBackend(level=macro(), bandwidth_margin=1e6, node_lag=share * found.lag)
        circuit, probe = backend.prepare(network)
        rate = pole_spectrum(emulate(circuit, backend.level), probe.final).abscissa
        assert (rate > ideal / 2) == slower


def test_time_constants_demand_nothing():
    network = neighbour_wired("double_integrator")
    assert preconditioner_demand(network, settled(network)) is None
