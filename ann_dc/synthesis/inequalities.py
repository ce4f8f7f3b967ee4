r"""Diode neurons: every row g <= 0 of the stage equations gets one, z with m = max(0, z + w g).

A row is divided by the length of its gradient on its boundary, where the start comes nearest to it,
in the network's scales: one unit of g is one unit of way. Limits of controls are rails of their
integrators (a limiter that stops integrating outward), and no rows.

Objectives of which the largest is minimised are rows too, J_i - E <= 0, once for the whole row.
Their neurons are shared: J_i measures its objective, the sum of what all cells send it; z_i is that
of a diode neuron whose rectifier every cell has, and the level E falls until the shares zeta_i add
up to one. At a temperature an exponential stands in the rectifier's place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.decomposition.equations import StageEquations
from ann_dc.decomposition.inequalities import InequalityRow
from ann_dc.network.cell import ONE, Connection, Neuron
from ann_dc.network.duals import DiodeDual, ObjectiveDual
from ann_dc.problem.boundary import boundary_slopes
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import Start
from ann_dc.problem.scales import Scales
from ann_dc.problem.soft import Soft
from ann_dc.scale import IDENTITY, Scale
from ann_dc.synthesis.signals import Signal, add, divided, scaled
from ann_dc.synthesis.wiring import Wiring


def row_scales(equations: StageEquations, scales: Scales, start: Start) -> dict[str, Scale]:
    """How one in the network stands for a row's value in the user's units, by its diode neuron.

    Parameters
    ----------
    equations : StageEquations
    scales : Scales
    start : Start
        Whose points are the nearest to begin with.
    """
    factors = np.r_[scales.state_factors, scales.control_factors]
    lengths = boundary_slopes(equations.problem.functions, start.q, start.u, factors)
    names = [diode.neuron for diode in diode_duals((*equations.rows, *equations.end_rows))]
    return dict(zip(names, map(Scale, np.concatenate(lengths).tolist())))


def diode_duals(rows: Sequence[InequalityRow]) -> tuple[DiodeDual, ...]:
    """The nodes of every row's diode neuron; those of the end have names of their own."""
    return tuple(
        DiodeDual(
            neuron=f"z{place}",
            residual=f"g{place}",
            sum=f"s{place}",
            multiplier=f"zeta{place}",
            excess=f"excess{place}" if row.soft and np.isfinite(row.soft.price) else "",
        )
        for row, place in ((row, f"{'_end' if row.at_end else ''}.{row.name}") for row in rows)
    )


def objective_duals(problem: OptimalControlProblem) -> tuple[ObjectiveDual, ...]:
    """The nodes of every objective of a problem, by its name."""
    return tuple(
        ObjectiveDual(
            neuron=f"z_J.{n}", measure=f"J.{n}", level="E.max",
            residual=f"g_J.{n}", sum=f"s_J.{n}", multiplier=f"zeta_J.{n}",
            curve="exp" if problem.temperature else "rectify",
        )
        for n in problem.objective_names
    )  # fmt: skip


def objective_neurons(objectives: Sequence[ObjectiveDual], cost: float) -> tuple[Neuron, ...]:
    """Shared neurons of objectives: shares, then measures and the level, in units of ``cost``."""
    told = [objective.measure for objective in objectives]
    told += [objective.level for objective in objectives[:1]]
    scales = {objective.neuron: IDENTITY for objective in objectives}
    scales |= dict.fromkeys(told, Scale(cost))
    return tuple(Neuron(name=name, scale=scale, shared=True) for name, scale in scales.items())


def name_objective(wiring: Wiring, objective: ObjectiveDual, r: float, temperature: float) -> None:
    """The sum J - E - T z, z + r times that, and the rectifier or exponential, in every cell."""
    residual, share = wiring.named_sum(objective.residual), wiring.signal(objective.neuron)
    parts = (objective.measure, 1.0), (objective.level, -1.0)
    value = add(*(scaled(wiring.signal(name), weight) for name, weight in parts))
    if objective.is_softened:
        value = add(value, scaled(share, -temperature))
    wiring.fill(objective.residual, value)
    wiring.named_sum(objective.sum)
    wiring.fill(objective.sum, add(share, scaled(residual, r)))
    wiring.named_function(objective.multiplier, objective.curve, objective.sum)


def objective_wires(objectives: Sequence[ObjectiveDual], stages: int) -> list[Connection]:
    """What the shared neurons read in their own cell: zeta - z (or s - z), -J, and sum - 1."""
    ends = [(ONE, objective.level, -1.0) for objective in objectives[:1]]
    for o in objectives:
        ends += [(o.followed, o.neuron, 1.0), (o.neuron, o.neuron, -1.0)]
        ends += [(o.measure, o.measure, -1.0), (o.multiplier, o.level, 1.0)]
    last = np.eye(stages)[-1]
    return [Connection(source=s, target=t, weight=weight * last) for s, t, weight in ends]


def name_diode(
    wiring: Wiring, diode: DiodeDual, w: float, soft: Soft | None, multiplier: Scale
) -> None:
    """The sum g, which is filled later, z + w g, and m.

    Parameters
    ----------
    wiring : Wiring
    diode : DiodeDual
    w : float
    soft : Soft or None
        Of its row: its price is where the diode has an excess.
    multiplier : Scale
        What one of m stands for.
    """
    residual = wiring.named_sum(diode.residual)
    inside = wiring.named_sum(diode.sum)
    wiring.fill(diode.sum, add(wiring.signal(diode.neuron), scaled(residual, w)))
    if soft is None or not diode.excess:
        wiring.named_function(diode.multiplier, "rectify", diode.sum)
        return
    wiring.named_sum(diode.excess)
    wiring.fill(diode.excess, add(inside, {(): -soft.price / multiplier.factor}))
    place = diode.multiplier.removeprefix("zeta")
    for name, source in ((f"inside{place}", diode.sum), (f"beyond{place}", diode.excess)):
        wiring.named_function(name, "rectify", source)
    wiring.named_sum(diode.multiplier)
    beyond = scaled(wiring.signal(f"beyond{place}"), -1.0)
    wiring.fill(diode.multiplier, add(wiring.signal(f"inside{place}"), beyond))


def fill_residual(
    wiring: Wiring, diode: DiodeDual, g: Signal, soft: Soft | None, units: tuple[Scale, Scale]
) -> None:
    """The sum that z feels, g - d z, from g in the user's units; units: of the row and of z."""
    row, multiplier = (scale.factor for scale in units)
    value = divided(g, row)
    if soft is not None and soft.compliance:
        leak = soft.compliance * multiplier / row
        value = add(value, scaled(wiring.signal(diode.neuron), -leak))
    wiring.fill(diode.residual, value)


def diode_drive(wiring: Wiring, diode: DiodeDual, w: float) -> Signal:
    """Of z: (m - z) / w."""
    pull = diode.weights(w)
    ends = (diode.multiplier, diode.neuron)
    return add(*(scaled(wiring.signal(s), pull[f"{diode.neuron}<-{s}"]) for s in ends))


def absent_diodes(equations: StageEquations) -> list[tuple[str, int]]:
    """Diode neurons (name, stage) that do without: of the end, and where q_0 fixes all of g."""
    problem, last = equations.problem, equations.problem.horizon - 1
    free = {s for s, fixed in zip(problem.states, problem.fixed_start) if not fixed}
    moving = free | set(problem.controls)
    still = [row for row in equations.rows if not row.expression.free_symbols & moving]
    absent = [(diode.neuron, 0) for diode in diode_duals(still)]
    at_end = diode_duals(equations.end_rows)
    return absent + [(diode.neuron, k) for diode in at_end for k in range(last)]
