"""Wires beyond neighbours in generated code, if a lane is a stage."""

import numpy as np
from hypothesis import given, settings, strategies as st
from random_networks import far_wired

from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator
from ann_dc.evaluation.reference import evaluator


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_network_with_far_wires_is_the_reference(seed):
    network = far_wired(seed)
    ours, own = GeneratedEvaluator(network), evaluator(network)
    x = network.start_state + 0.1 * np.random.default_rng(seed).standard_normal(network.size)
    expected = own.rhs(x)
    np.testing.assert_allclose(ours.rhs(x), expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(ours.residuals(x), own.residuals(x), rtol=1e-10)
    entries = own.jacobian_entries(x)
    atol = 1e-12 * np.abs(entries).max(initial=1.0)
    np.testing.assert_allclose(ours.jacobian_entries(x), entries, atol=atol)
