"""Gains in closed form: rules that read rho, time constants and metric off a linearisation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
