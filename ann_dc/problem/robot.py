"""Robots that drive in a plane: dynamics, limits and cost weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp

from ann_dc.errors import ScenarioError, such_as
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.functions import ProblemFunctions
from ann_dc.validation import NotNegative, Positive, checked


@such_as("ann_dc.problem.car_robot()")
@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """Robot in continuous time, dq/dt = F(q, u), with position (x, y) as first states.

    It must not move if all controls are zero, because it brakes in this way. Bounds are those of a
    problem, finite for controls. `radius` is that of the disc that contains the robot. `effort` is
    the cost rate of a control or a state: weight times its square over two, per second. `rolling`
    is the smallest magnitude of a control at which F is linearised; a stationary car cannot steer.
    Raises `ScenarioError` if the position is missing, a control has no limits, or the robot moves
    with zero controls.
    """

    states: Sequence[sp.Symbol]
    controls: Sequence[sp.Symbol]
    dynamics: Sequence[sp.Expr]
    bounds: Mapping[str, Sequence[float | None]]
    radius: float
    effort: Mapping[str, float] = field(default_factory=dict)
    rolling: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.states) < 2:
            raise ScenarioError("states: expected x, y and further states, got fewer than two")
        if not np.isfinite(self.limits).all():
            raise ScenarioError(
                "bounds: every control needs a lower and an upper one; "
                f"got {dict(self.bounds)!r} for {', '.join(map(str, self.controls))}"
            )
        still = [sp.sympify(F).subs(dict.fromkeys(self.controls, 0)) for F in self.dynamics]
        if any(sp.simplify(F) != 0 for F in still):
            raise ScenarioError(
                "dynamics: expected a robot at rest if all controls are zero (it brakes in "
                f"this way), got {still}"
            )

    @cached_property
    def limits(self) -> np.ndarray:
        """Lowest and highest value (m, 2) of every control."""
        return self._bounds(self.controls)

    @cached_property
    def state_limits(self) -> np.ndarray:
        """Lowest and highest value (n, 2) of every state."""
        return self._bounds(self.states)

    def _bounds(self, symbols: Sequence[sp.Symbol]) -> np.ndarray:
        pairs = [self.bounds.get(symbol.name, (None, None)) for symbol in symbols]
        ends = (-np.inf, np.inf)
        return np.array([[e if p is None else p for p, e in zip(pair, ends)] for pair in pairs])

    def stepped(self, dt: float | sp.Symbol) -> tuple[sp.Expr, ...]:
        """Return q after dt by the midpoint rule."""
        step = sp.sympify(dt)
        half = {q: q + sp.sympify(F) * step / 2 for q, F in zip(self.states, self.dynamics)}
        middle = [sp.sympify(F).xreplace(half) for F in self.dynamics]
        return tuple(q + step * F for q, F in zip(self.states, middle))

    def steps(self, dt: float) -> ProblemFunctions:
        """Return the numerical midpoint rule with derivatives, compiled once per step dt."""
        return _steps(self, dt)


@lru_cache(maxsize=32)
def _steps(robot: Robot, dt: float) -> ProblemFunctions:
    problem = OptimalControlProblem(
        states=robot.states,
        controls=robot.controls,
        map=robot.stepped(dt),
        cost=sp.Add(*(u**2 for u in robot.controls)),
        horizon=1,
        q_0=(0,) * len(robot.states),
    )
    return problem.functions


@checked
def car_robot(
    *,
    wheel_base: Positive = 0.5,
    radius: Positive = 0.15,
    speed: Positive = 2.0,
    reverse: NotNegative = 0.0,
    steering: Positive = 0.6,
    steering_rate: Positive = 3.0,
) -> Robot:
    """Return the paper's car: x, y, heading phi, steering varphi; controls nu and eta.

    Parameters
    ----------
    wheel_base : float
        Wheel base D in metres.
    radius : float
        Radius of the enclosing disc in metres.
    speed, reverse : float
        Largest forward and backward speed nu in m/s.
    steering : float
        Largest abs(varphi) in rad.
    steering_rate : float
        Largest abs(eta) in rad/s.

    References
    ----------
    Paper equation (22), without its friction.

    Examples
    --------
    >>> car_robot(reverse=0.5).limits.tolist()
    [[-0.5, 2.0], [-3.0, 3.0]]
    """
    x, y, phi, varphi, nu, eta = sp.symbols("x y phi varphi nu eta")
    return Robot(
        states=(x, y, phi, varphi),
        controls=(nu, eta),
        dynamics=(sp.cos(phi) * nu, sp.sin(phi) * nu, sp.tan(varphi) / wheel_base * nu, eta),
        bounds={
            "nu": (-reverse or 0.0, speed),
            "eta": (-steering_rate, steering_rate),
            "varphi": (-steering, steering),
        },
        radius=radius,
        effort={"nu": 0.1, "eta": 0.05, "varphi": 0.1},
        rolling={"nu": speed / 2},
    )


@checked
def unicycle_robot(
    *,
    radius: Positive = 0.15,
    speed: Positive = 2.0,
    reverse: NotNegative = 0.0,
    turning: Positive = 2.5,
) -> Robot:
    """Return a two-wheeled robot: x, y and heading theta; controls nu and omega.

    Radius in metres, largest forward and backward speed nu in m/s, largest abs(omega) (``turning``)
    in rad/s.
    """
    x, y, theta, nu, omega = sp.symbols("x y theta nu omega")
    return Robot(
        states=(x, y, theta),
        controls=(nu, omega),
        dynamics=(sp.cos(theta) * nu, sp.sin(theta) * nu, omega),
        bounds={"nu": (-reverse or 0.0, speed), "omega": (-turning, turning)},
        radius=radius,
        effort={"nu": 0.1, "omega": 0.1},
        rolling={"nu": speed / 2},
    )
