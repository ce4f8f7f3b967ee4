"""ann_dc: optimal control on an analog neural network.

An optimal-control problem becomes one network description; every realisation is read off it.

>>> import sympy as sp, ann_dc
>>> x, v, a = sp.symbols("x v a")
>>> problem = ann_dc.OptimalControlProblem(
...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1,
...     cost=a**2 / 2, horizon=20, q_0=(0, 0), q_d=(1, 0))
>>> solution = ann_dc.solve(problem)
>>> solution.status.settled
True

Names are loaded when first used, so that importing the package stays fast.
"""

from __future__ import annotations

import importlib

__version__ = "0.1.0"

_HOME = {
    "OptimalControlProblem": "ann_dc.problem.declaration",
    "load_problem": "ann_dc.problem.files",
    "Start": "ann_dc.problem.start",
    "line_start": "ann_dc.problem.start",
    "zero_start": "ann_dc.problem.start",
    "random_start": "ann_dc.problem.start",
    "Form": "ann_dc.decomposition.form",
    "CORRECTED": "ann_dc.decomposition.form",
    "PRINTED": "ann_dc.decomposition.form",
    "SWITCHES": "ann_dc.decomposition.form",
    "switch": "ann_dc.decomposition.form",
    "StageEquations": "ann_dc.decomposition.equations",
    "decompose": "ann_dc.decomposition.equations",
    "Network": "ann_dc.network.network",
    "synthesize": "ann_dc.network.synthesis",
    "design": "ann_dc.network.design",
    "hand_gains": "ann_dc.network.gains",
    "apply_gains": "ann_dc.network.gains",
    "Recipe": "ann_dc.network.gains",
    "WITHOUT_COORDINATORS": "ann_dc.network.gains",
    "spectrum": "ann_dc.network.spectrum",
    "save": "ann_dc.network.files",
    "load": "ann_dc.network.files",
    "OdeBackend": "ann_dc.backends.ode",
    "Settling": "ann_dc.backends.run",
    "RecurrentBackend": "ann_dc.backends.recurrent.backend",
    "RecurrentLayer": "ann_dc.backends.recurrent.layer",
    "CellLayer": "ann_dc.backends.recurrent.cell",
    "SIMULTANEOUS": "ann_dc.backends.recurrent.orders",
    "TWO_PHASE": "ann_dc.backends.recurrent.orders",
    "STAGE_BY_STAGE": "ann_dc.backends.recurrent.orders",
    "FixedStep": "ann_dc.backends.recurrent.steps",
    "AdaptiveStep": "ann_dc.backends.recurrent.steps",
    "Anderson": "ann_dc.backends.recurrent.acceleration",
    "TwoLevelLayer": "ann_dc.backends.recurrent.two_level",
    "UpperMap": "ann_dc.network.upper_map",
    "theorem_IV_2": "ann_dc.network.theorem",
    "SpiceBackend": "ann_dc.backends.spice.backend",
    "emulate": "ann_dc.network.emulation",
    "circuits_path": "ann_dc.resources",
    "Solution": "ann_dc.solution",
    "solve": "ann_dc.solver",
}
_MODULES = {
    "plants": "ann_dc.problem.plants",
    "defects": "ann_dc.network.defects",
    "ode": "ann_dc.backends.ode",
    "levels": "ann_dc.backends.spice.levels",
    "two_level": "ann_dc.backends.recurrent.two_level",
    "errors": "ann_dc.errors",
    "plotting": "ann_dc.plotting",
}

__all__ = sorted([*_HOME, *_MODULES, "__version__"])  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
    elif name in _MODULES:
        value = importlib.import_module(_MODULES[name])
    else:
        raise AttributeError(f"module 'ann_dc' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
