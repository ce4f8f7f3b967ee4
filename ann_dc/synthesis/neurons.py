"""Neurons of a cell with their scales and saturation limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.network.cell import Limiter, Neuron, Role
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import Scales
from ann_dc.scale import Scale


def neurons_of(
    problem: OptimalControlProblem, scales: Scales, of_diodes: Mapping[str, Scale]
) -> tuple[Neuron, ...]:
    """Return neurons q, u, t, mu and beta of a problem, and its rectifying neurons.

    Time constants are one; limits of controls are saturation limits. ``of_diodes`` gives the
    multiplier scale by rectifying neuron.
    """
    states = list(zip(map(str, problem.states), scales.states, scales.multipliers))
    controls = zip(map(str, problem.controls), scales.controls, problem.control_limits)
    return (
        *(Neuron(name=f"q.{s}", role=Role.PRIMAL, scale=scale) for s, scale, _ in states),
        *(
            Neuron(name=f"u.{s}", role=Role.PRIMAL, scale=scale, limiter=_limiter(limits, scale))
            for s, scale, limits in controls
        ),
        *(Neuron(name=f"t.{s}", role=Role.PRIMAL, scale=scale) for s, scale, _ in states),
        *(
            Neuron(name=f"{population}.{s}", role=Role.DUAL, scale=scale)
            for population in ("mu", "beta")
            for s, _, scale in states
        ),
        *(Neuron(name=name, role=Role.DUAL, scale=scale) for name, scale in of_diodes.items()),
    )


def _limiter(limits: np.ndarray, scale: Scale) -> Limiter:
    """Return the saturation limits of a control, from limits (2,) in the user's units."""
    low, high = (float((limit - scale.offset) / scale.factor) for limit in limits)
    return Limiter(low=low, high=high)
