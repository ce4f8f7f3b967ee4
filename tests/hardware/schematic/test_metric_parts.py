"""Own integrators, put through the coupling, are the t and q of coordinators again."""

import numpy as np
from designs import designed

from ann_dc.backends import DOP853, OdeBackend
from ann_dc.evaluation import evaluator
from ann_dc.gain_design import WITHOUT_COORDINATORS, design
from ann_dc.hardware.schematic import coupling_of, own_integrals


def test_own_integrals_are_what_the_coordinators_add_up():
    """D' = d and z' = M d: the integrals, put through the metric, are t and q again."""
    network = designed("car").network
    run = OdeBackend(method=DOP853, verify=False).run(network).trajectory
    integrals = own_integrals(network, run.states)
    x, moved = run.states[0], run.states[10]
    drives = np.zeros(network.live.shape)
    for name, values in integrals.items():
        row = network.neuron_index[name.removeprefix("own.")]
        drives[row] = values[10] - values[0]
    chain = np.isin(network.places[:, 0], evaluator(network).tape.chains.ravel())
    change = (evaluator(network).metric @ network.pack(drives))[chain]
    np.testing.assert_allclose(change, (moved - x)[chain], atol=1e-12)


def test_without_coordinators_there_are_no_own_integrals():
    network = design(designed("double_integrator").network, recipe=WITHOUT_COORDINATORS).network
    assert own_integrals(network, network.start_state[None]) == {}
    assert coupling_of(network) is None
