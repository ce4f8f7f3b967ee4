"""The function blocks in torch, with their slopes; the table of `ann_dc.network.functions`."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch

from ann_dc.network.functions import FUNCTIONS


class TorchFunction(NamedTuple):
    """y = value(x) and dy/dx = slope(x, y)."""

    value: Callable[[torch.Tensor], torch.Tensor]
    slope: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


_BY_NAME = {
    "sin": TorchFunction(torch.sin, lambda x, y: torch.cos(x)),
    "cos": TorchFunction(torch.cos, lambda x, y: -torch.sin(x)),
    "tan": TorchFunction(torch.tan, lambda x, y: 1 + y * y),
    "exp": TorchFunction(torch.exp, lambda x, y: y),
    "log": TorchFunction(torch.log, lambda x, y: 1 / x),
    "sqrt": TorchFunction(torch.sqrt, lambda x, y: 0.5 / y),
    "reciprocal": TorchFunction(torch.reciprocal, lambda x, y: -y * y),
    "tanh": TorchFunction(torch.tanh, lambda x, y: 1 - y * y),
    "sinh": TorchFunction(torch.sinh, lambda x, y: torch.cosh(x)),
    "cosh": TorchFunction(torch.cosh, lambda x, y: torch.sinh(x)),
    "atan": TorchFunction(torch.atan, lambda x, y: 1 / (1 + x * x)),
    "asin": TorchFunction(torch.asin, lambda x, y: torch.rsqrt(1 - x * x)),
    "acos": TorchFunction(torch.acos, lambda x, y: -torch.rsqrt(1 - x * x)),
    "rectify": TorchFunction(torch.relu, lambda x, y: (x > 0).to(x.dtype)),
}

TORCH_FUNCTIONS: tuple[TorchFunction, ...] = tuple(_BY_NAME[block.name] for block in FUNCTIONS)
"""In the order of the catalogue, so that a function's code is its position."""
