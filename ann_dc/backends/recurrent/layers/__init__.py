"""Recurrent layers in torch: differentiable runs of samples until they settle."""

import lazy_loader

import ann_dc.backends.recurrent.cell  # noqa: F401 - raises the ImportError that names the extra

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
