"""The suite: 23 problems with the optima that many starts of IPOPT find, best first.

Optima that the network found first stand apart. A settled network is right when it is a certified
second-order KKT point.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem


@dataclass(frozen=True)
class SuiteProblem:
    build: Callable[[], OptimalControlProblem]
    optima: tuple[float, ...]
    own: tuple[float, ...] = ()

    @cached_property
    def problem(self) -> OptimalControlProblem:
        return self.build()


def _entry(
    plant: Callable[..., OptimalControlProblem], *optima: float, own=(), **changes
) -> SuiteProblem:
    return SuiteProblem(partial(plant, **changes), optima, own)


CAR_G3 = (251.071, 264.5928, 279.2, 280.1725, 288.2)
"""The best takes some seventy starts of IPOPT."""
OWN_G3 = (293.2838, 294.4514, 304.8685)
"""Found by the network first; IPOPT started there stays there."""

SUITE: dict[str, SuiteProblem] = {
    "car": _entry(plants.car, 398.6315, 477.9, 496.7, 504.3, 601.8),
    "car_D.5": _entry(plants.car, 368.1893, D=0.5),
    "car_g2": _entry(plants.car, 68.3767, q_d=(3, 1, 0.5, 0)),
    "car_g3": _entry(plants.car, *CAR_G3, own=OWN_G3, q_d=(-2, 4, 1, 0)),
    "car_N18": _entry(plants.car, 802.5146, N=18, dt=0.9 / 18),
    "car_N36": _entry(plants.car, 1613.1646, N=36, dt=0.9 / 36),
    "car_N72": _entry(plants.car, 3235.1112, N=72, dt=0.9 / 72),
    "car_T5": _entry(plants.car, 97.845, 125.0291, N=50),
    "unicycle": _entry(plants.unicycle, 18.8128),
    "unicycle_obstacle": _entry(plants.unicycle_soft_obstacle, 3.1306, 3.799),
    "bicycle": _entry(plants.bicycle, 8.9550),
    "double_integrator": _entry(plants.double_integrator, 7.5188),
    "lq_stable": _entry(plants.lq, 16.1981),
    "lq_unst": _entry(plants.lq, 48.8784, seed=2, spectral_radius=1.2, state_weight=0.1),
    "lq_unst_nc": _entry(plants.lq, 18.1299, seed=3, spectral_radius=1.1, state_weight=0, N=15),
    "pendulum": _entry(plants.pendulum, 8.4490, 11.541),
    "pendulum_state_cost": _entry(plants.pendulum_state_cost, 140.057, 168.7275),
    "cart_pole": _entry(plants.cart_pole, 1.8057, 1.8332),
    "van_der_pol": _entry(plants.van_der_pol, 1.5467),
    "planar_quadrotor": _entry(plants.planar_quadrotor, 1.5076),
    "two_link_arm": _entry(plants.two_link_arm, 1.9616),
    "orbit_transfer": _entry(plants.orbit_transfer, 0.0634),
    "cstr": _entry(plants.cstr, 9.9036),
}
