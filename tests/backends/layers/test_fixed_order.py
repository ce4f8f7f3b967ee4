"""Sums in a fixed order: right, and with the same bits wherever a sample stands."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from ann_dc.backends.layers.fixed_order import LIBRARY, applied, total

CURVES = ("sin", "cos", "tan", "exp", "tanh", "sinh", "cosh", "arctan", "arcsin", "arccos")
places = st.lists(st.integers(0, 99), min_size=1, max_size=70)


def columns(*shape: int, dtype=torch.float64) -> torch.Tensor:
    """A hundred samples, between -1 and 1."""
    rng = np.random.default_rng(len(shape))
    return torch.as_tensor(rng.uniform(-1, 1, (*shape, 100))).to(dtype)


@pytest.mark.parametrize("rows", [1, 2, 3, 7, 8, 50])
def test_total_is_the_sum(rows):
    values = columns(rows, 3)
    np.testing.assert_allclose(total(values), values.sum(0), rtol=1e-12, atol=1e-12)


def test_applied_is_the_product():
    matrices, vectors = columns(4, 5)[..., :3], columns(4, 3)
    np.testing.assert_allclose(applied(matrices, vectors), matrices @ vectors, atol=1e-14)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@settings(max_examples=30)
@given(chosen=places)
def test_a_sample_has_the_same_bits_in_any_company(dtype, chosen):
    values, matrices = columns(18, dtype=dtype), columns(7, dtype=dtype)[:, :18]
    weights = columns(18, dtype=dtype)[:, :1]
    for work in (
        total,
        lambda some: applied(matrices, some),
        lambda some: torch.addcmul(some, weights, some),
        lambda some: torch.exp(0.05 * torch.log(some.abs())),
        *(getattr(LIBRARY, name) for name in CURVES),
    ):
        assert torch.equal(work(values[:, chosen]), work(values)[..., chosen])


@pytest.mark.parametrize("name", ["sinh", "cosh"])
def test_hyperbolic_functions_are_exact_near_zero_and_far_from_it(name):
    x = np.concatenate([-np.logspace(-12, 2.84, 50), [0.0], np.logspace(-12, 2.84, 50)])
    np.testing.assert_allclose(
        getattr(LIBRARY, name)(torch.as_tensor(x)), getattr(np, name)(x), rtol=1e-15 * 4
    )
