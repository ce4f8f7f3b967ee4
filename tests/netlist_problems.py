"""Small problems that netlists are written of, with all that a circuit has besides plain cells."""

import pytest
import sympy as sp

import ann_dc


def _driven(**given) -> ann_dc.OptimalControlProblem:
    """A mass that is driven 18 cm, told in kelvin-like units: its state has an offset."""
    x, v, a = sp.symbols("x v a")
    return ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, cost=a**2 / 2, horizon=5,
        q_0=(300.0, 0.0), q_d=(300.18, 0.0), scales={x: ann_dc.Scale(1.0, 300.0)}, **given,
    )  # fmt: skip


A, V = sp.symbols("a v")

PROBLEMS = {
    "double integrator": lambda: ann_dc.plants.double_integrator(N=4),
    "unicycle": lambda: ann_dc.plants.unicycle(N=3),
    "pendulum": lambda: ann_dc.plants.pendulum(N=4),
    "van der Pol": lambda: ann_dc.plants.van_der_pol(N=4),
    "a diode neuron that conducts": lambda: _driven(constraints={"pace": V <= 0.5}),
    "a control at its rail": lambda: _driven(bounds={A: (-3.5, 3.5)}),
    "shared neurons": lambda: _driven(objectives={"effort": A**2 / 2, "haste": V**2}),
}
"""By what is in them."""

PLAIN = ("double integrator", "pendulum", "van der Pol")
CASES = [pytest.param(name, marks=pytest.mark.slow if name in PLAIN else ()) for name in PROBLEMS]
"""Their names, for tests; those that show nothing besides are slow."""
