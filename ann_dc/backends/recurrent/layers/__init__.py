"""Recurrent layers in torch: many steps, each sample until it has settled, differentiable."""

import lazy_loader

from ann_dc.backends.recurrent.cell import torch as torch

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
