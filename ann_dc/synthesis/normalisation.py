"""Units in which a network is wired: its own control and objective, near one.

The network computes with v = u / s and E / E_0: s makes the largest |df/dv| along the default
start one, and E_0 the largest d2E/dv2. Then the same time constants and voltages suit any problem,
and the user's units come back through the unit that every neuron carries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import line_start


@dataclass(frozen=True, kw_only=True, eq=False)
class Normalisation:
    """Units of the network: u = control * v (one factor a control), E_network = objective * E."""

    control: tuple[float, ...]
    objective: float

    @classmethod
    def none(cls, problem: OptimalControlProblem) -> Normalisation:
        """The user's own units."""
        return cls(control=(1.0,) * problem.m, objective=1.0)


def normalise(problem: OptimalControlProblem) -> Normalisation:
    """Units from the plant's gain and the cost's curvature along the default start."""
    start = line_start(problem)
    still = np.zeros_like(start.u)
    _, B = problem.functions.map_jacobian(start.q[:, :-1], still)
    gain = np.sqrt((np.nan_to_num(B) ** 2).sum(axis=0)).max(axis=-1)
    control = np.where(gain > 0, 1.0 / np.where(gain > 0, gain, 1.0), 1.0)
    hessian = problem.functions.hessian(start.q[:, :-1], still, np.zeros_like(start.q[:, 1:]))
    second = np.nan_to_num(hessian.diagonal().T, posinf=0.0, neginf=0.0)[problem.n :]
    curvature = second.max(axis=-1) * control**2
    positive = curvature[curvature > 0]
    return Normalisation(
        control=tuple(float(s) for s in control),
        objective=float(1.0 / positive.max()) if positive.size else 1.0,
    )
