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
    "load_problem": "ann_dc.problem.toml_file",
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
    "synthesize": "ann_dc.solver",
    "design": "ann_dc.solver",
    "hand_gains": "ann_dc.gain_design.gains",
    "apply_gains": "ann_dc.gain_design.gains",
    "Recipe": "ann_dc.gain_design.recipe",
    "WITHOUT_COORDINATORS": "ann_dc.gain_design.recipe",
    "spectrum": "ann_dc.analysis.spectra",
    "save": "ann_dc.export.weights.network_file",
    "load": "ann_dc.export.weights.network_file",
    "OdeBackend": "ann_dc.backends.ode",
    "Settling": "ann_dc.backends.settling",
    "RecurrentBackend": "ann_dc.backends.recurrent.backend",
    "RecurrentLayer": "ann_dc.backends.recurrent.layer",
    "CellLayer": "ann_dc.backends.recurrent.cell.layer",
    "SIMULTANEOUS": "ann_dc.backends.recurrent.orders",
    "TWO_PHASE": "ann_dc.backends.recurrent.orders",
    "STAGE_BY_STAGE": "ann_dc.backends.recurrent.orders",
    "FixedStep": "ann_dc.backends.recurrent.steps",
    "AdaptiveStep": "ann_dc.backends.recurrent.steps",
    "Anderson": "ann_dc.backends.recurrent.acceleration",
    "TwoLevelLayer": "ann_dc.two_level.layer",
    "UpperMap": "ann_dc.two_level.upper_gains",
    "theorem_IV_2": "ann_dc.two_level.theorem",
    "SpiceBackend": "ann_dc.backends.spice.backend",
    "emulate": "ann_dc.hardware.emulation.emulation",
    "circuits_path": "ann_dc.resources",
    "Solution": "ann_dc.solution",
    "solve": "ann_dc.solver",
}
_MODULES = {
    "plants": "ann_dc.problem.plants",
    "defects": "ann_dc.hardware.emulation.defects",
    "ode": "ann_dc.backends.ode",
    "levels": "ann_dc.hardware.parts.levels",
    "presets": "ann_dc.hardware.parts.presets",
    "two_level": "ann_dc.two_level.layer",
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
