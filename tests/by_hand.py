"""Plants declared by hand, as users declare theirs: none of the package's, none of the suite's."""

from functools import cache

import sympy as sp

from ann_dc.gain_design.procedure import design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solver import synthesize


def river() -> OptimalControlProblem:
    """Across a river that flows faster the further one is: x' = s cos th + y / 2, y' = s sin th."""
    x, y, s, th = sp.symbols("x y s th", real=True)
    return OptimalControlProblem(
        name="river", states=(x, y), controls=(s, th), dt=0.2, horizon=10, q_0=(0, 0), q_d=(2, 1),
        dynamics=(s * sp.cos(th) + y / 2, s * sp.sin(th)), cost=s**2 / 2 + th**2 / 20,
    )  # fmt: skip


def fishing() -> OptimalControlProblem:
    """Prey and predators, fished towards one another: a' = a - a b - 0.4 a w."""
    a, b, w = sp.symbols("a b w", real=True)
    return OptimalControlProblem(
        name="fishing", states=(a, b), controls=(w,), dt=0.1, horizon=15,
        q_0=(0.5, 0.7), q_d=(None, None),
        dynamics=(a - a * b - 0.4 * a * w, -b + a * b - 0.2 * b * w),
        cost=((a - 1) ** 2 + (b - 1) ** 2 + w**2) / 2,
    )  # fmt: skip


def rocket() -> OptimalControlProblem:
    """A rocket that lands, and burns what it weighs: v' = T / m - 1, m' = -T / 5."""
    h, v, m, thrust = sp.symbols("h v m T", real=True)
    return OptimalControlProblem(
        name="rocket", states=(h, v, m), controls=(thrust,), dt=0.15, horizon=12,
        q_0=(1, -0.4, 1), q_d=(0, 0, None),
        dynamics=(v, thrust / m - 1, -thrust / 5), cost=thrust**2 / 2 + v**2 / 10,
    )  # fmt: skip


BY_HAND = {plant.__name__: plant for plant in (river, fishing, rocket)}


@cache
def wired_by_hand(name: str) -> Network:
    """With time constants alone."""
    return design(
        synthesize(BY_HAND[name]()), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
