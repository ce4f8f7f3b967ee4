"""Four problems that are known to be slow, declared as the literature has them.

They stand beside the suite and in its form. Units are scaled so that all numbers lie near one.
The optima are those that IPOPT finds from a line, from noisy lines and from rollouts, best first:
of 240 starts each that ended at a minimum gave one of the table, but for some of the ship's.
"""

import numpy as np
import sympy as sp
from problems import SuiteProblem

from ann_dc.problem.declaration import OptimalControlProblem

HALF = sp.Rational(1, 2)


def coupled_pendula(
    *, stiffness=0.5, dt=0.1, N=50, q_0=(1, 0, -1, 0), q_d=(0, 0, 0, 0)
) -> OptimalControlProblem:
    """Two equal pendula joined by a weak spring; a torque on the first brings both to rest.

    Time is in units of sqrt(length / gravity), so that gravity's share of the stiffness is 1. The
    pendula start a radian to either side: what swings in the second leaves only by the spring.

    Parameters
    ----------
    stiffness : float
        Of the spring, relative to gravity.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.

    References
    ----------
    Fradkov and Andrievsky, "Synchronization and phase relations in the motion of two-pendulum
    system", International Journal of Non-Linear Mechanics 42 (2007), without its friction.
    """
    states = sp.symbols("x1:5")
    angle, rate, other, other_rate = states
    torque = sp.Symbol("torque")
    pull = stiffness * (other - angle)
    return OptimalControlProblem(
        name="coupled_pendula", states=states, controls=(torque,),
        dynamics=(rate, -sp.sin(angle) + pull + torque, other_rate, -sp.sin(other) - pull),
        cost=HALF * torque**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def ship(
    *, gain=4.5, lag=31 / 9, cubic=16.2, dt=0.4, N=40, q_0=(0, 0, 0), q_d=(0, np.pi, 0)
) -> OptimalControlProblem:
    r"""Steer a ship at constant speed back onto its own track (a Williamson turn), least rudder.

    Nomoto's first-order model with Norrbin's cubic damping,
    :math:`T \dot r + r + n_3 r^3 = K \delta`, offset y from the track, heading psi, yaw rate r.
    Lengths are in ship lengths L and times in L / U: the speed is 1.

    Parameters
    ----------
    gain, lag, cubic : float
        K, T and n_3 of the Zeefakkel (L = 45 m) at U = 5 m/s: 0.5 / s, 31 s and 0.4 s^2 / deg^2.
        The last is read as of degrees: then a rudder of 35 degrees turns in four lengths.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target; 16 lengths are enough for 30 degrees of rudder.

    Notes
    -----
    Two optima have a counterpart at a smaller ``dt``: the wide turn outright, and away first, then
    back over the track. In between lies the second with a kick of the rudder at the end, where
    Euler's step overshoots the cubic. Kicks in the middle, of 70 degrees and more, make dozens of
    strict minima from 2.8 on, which are the sampling's and not the ship's: none is in the table.

    References
    ----------
    Nomoto et al., "On the steering qualities of ships", International Shipbuilding Progress 4
    (1957). Norrbin, "On the design and analysis of the zig-zag test on base of quasi-linear
    frequency response" (1963). Van Amerongen, "Adaptive steering of ships", thesis, Delft (1982):
    the parameters.
    """
    states = sp.symbols("y psi r")
    _, psi, r = states
    rudder = sp.Symbol("rudder")
    return OptimalControlProblem(
        name="ship", states=states, controls=(rudder,),
        dynamics=(sp.sin(psi), r, (gain * rudder - r - cubic * r**3) / lag),
        cost=HALF * rudder**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def epidemic(
    *, contact=3.0, burden=5.0, dt=0.2, N=30, q_0=(0.95, 0.05), q_d=None
) -> OptimalControlProblem:
    """Vaccinate against an epidemic (SIR): the infected and the square of the effort cost.

    Time is in units of the mean time to recovery. Vaccination reaches its share of the susceptible
    in unit time; both ends are free. Over a step a susceptible escapes infection and vaccine with
    probability exp(-dt (contact infected + vaccination)), as in the Reed-Frost model, not with
    Euler's 1 - dt (...): Euler's step may take the infected below zero, where they earn, so that
    this cost would have no minimum.

    Parameters
    ----------
    contact : float
        Infections that one case causes among the susceptible (the basic reproduction number).
    burden : float
        Cost of the infected in unit time, beside vaccination**2 / 2.
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target; shares of the population.

    References
    ----------
    Lenhart and Workman, "Optimal Control Applied to Biological Models" (2007), lab 7, without
    incubation, births and deaths. Abbey, "An examination of the Reed-Frost theory of epidemics",
    Human Biology 24 (1952).
    """
    susceptible, infected = states = sp.symbols("susceptible infected")
    vaccination = sp.Symbol("vaccination")
    escape = sp.exp(-dt * contact * infected)
    return OptimalControlProblem(
        name="epidemic", states=states, controls=(vaccination,),
        map=(
            susceptible * sp.exp(-dt * (contact * infected + vaccination)),
            (1 - dt) * infected + susceptible * (1 - escape),
        ),
        cost=burden * infected + HALF * vaccination**2, dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


def brockett(*, dt=0.1, N=30, q_0=(0, 0, 0), q_d=(0.2, 0, 1)) -> OptimalControlProblem:
    """Brockett's nonholonomic integrator, along its shortest path.

    z grows by twice the area that the path of (x, y) sweeps. A target on the z axis would have a
    circle of optima, one turned into the other, so the target stands a little beside it.

    Parameters
    ----------
    dt, N, q_0, q_d
        Sampling interval, horizon, start, target.

    References
    ----------
    Brockett, "Asymptotic stability and feedback stabilization", in Differential Geometric Control
    Theory (1983): the plant. Brockett, "Control theory and singular Riemannian geometry" (1982):
    the cost, whose paths are arcs of a circle.
    """
    x, y, _ = states = sp.symbols("x y z")
    v_x, v_y = sp.symbols("v_x v_y")
    return OptimalControlProblem(
        name="brockett", states=states, controls=(v_x, v_y),
        dynamics=(v_x, v_y, x * v_y - y * v_x),
        cost=HALF * (v_x**2 + v_y**2), dt=dt, horizon=N, q_0=q_0, q_d=q_d,
    )  # fmt: skip


LITERATURE: dict[str, SuiteProblem] = {
    "coupled_pendula": SuiteProblem(coupled_pendula, (107.6181,)),
    "ship": SuiteProblem(ship, (1.8589, 1.8598, 1.8653)),
    "epidemic": SuiteProblem(epidemic, (9.4544,)),
    "brockett": SuiteProblem(brockett, (8.9114,)),
}
