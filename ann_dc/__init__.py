"""Optimal control on an analog neural network.

An optimal-control problem becomes one network description, from which every realisation is derived.

>>> import sympy as sp, ann_dc
>>> x, v, a = sp.symbols("x v a")
>>> problem = ann_dc.OptimalControlProblem(
...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1,
...     cost=a**2 / 2, horizon=20, q_0=(0, 0), q_d=(1, 0))
>>> solution = ann_dc.solve(problem)
>>> solution.status.settled
True

Names are loaded on first use, so that importing the package is fast.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
