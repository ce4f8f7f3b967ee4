"""Cell layers with gains of their own, and how near two tensors are."""

import numpy as np
import torch

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.network.cell import Connection, Template
from ann_dc.network.network import Network


def assert_close(actual, expected, relative=1e-12) -> None:
    expected = np.asarray(expected)
    scale = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def with_factors(network: Network, seed: int) -> CellLayer:
    """A layer whose gains have random factors between a half and two."""
    layer = CellLayer(network, trainable=True)
    with torch.no_grad():
        factors = np.random.default_rng(seed).uniform(-0.7, 0.7, len(layer.log_gain.rows))
        layer.log_gain.rows += torch.as_tensor(factors)
    return layer
