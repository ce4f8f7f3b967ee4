"""Rectifying multiplier neurons: z with m = max(0, z + w g) for each row g <= 0.

A row is divided by the length of its gradient on its boundary, at the point nearest to the initial
guess, in the network's scales. One unit of g is then one unit of distance. Limits of controls are
saturation limits of their integrators (a limiter that stops integration outward) instead of rows.

Objectives of a minimax problem are also rows, J_i - E <= 0, once for the whole network. Their
neurons are shared. J_i measures its objective, the sum of contributions from all cells. z_i belongs
to a rectifying neuron with a rectifier in every cell. The level E falls until the coefficients
zeta_i sum to one. At a temperature an exponential replaces the rectifier.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.decomposition.equations import InequalityRow, StageEquations
from ann_dc.network.cell import ONE, Connection, Neuron
from ann_dc.network.duals import InequalityDual, ObjectiveDual
from ann_dc.problem.boundary import boundary_slopes
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.problem.scales import Scales
from ann_dc.problem.soft import Soft
from ann_dc.scale import IDENTITY, Scale
from ann_dc.synthesis.signals import Signal, add, divided, scaled
from ann_dc.synthesis.wiring import Wiring


def row_scales(
    equations: StageEquations, scales: Scales, initial_guess: InitialGuess
) -> dict[str, Scale]:
    """Return the scales of row values by rectifying neuron, in the user's units.

    The boundary points are those nearest to the points of the initial guess.
    """
    factors = np.r_[scales.state_factors, scales.control_factors]
    lengths = boundary_slopes(
        equations.problem.functions, initial_guess.q, initial_guess.u, factors
    )
    names = [diode.neuron for diode in inequality_duals((*equations.rows, *equations.end_rows))]
    return dict(zip(names, map(Scale, np.concatenate(lengths).tolist())))


def inequality_duals(rows: Sequence[InequalityRow]) -> tuple[InequalityDual, ...]:
    """Return the nodes of every row's rectifying neuron; end rows have distinct names."""
    return tuple(
        InequalityDual(
            neuron=f"z{place}",
            residual=f"g{place}",
            sum=f"s{place}",
            multiplier=f"zeta{place}",
            excess=f"excess{place}" if row.soft and np.isfinite(row.soft.weight) else "",
        )
        for row, place in ((row, f"{'_end' if row.at_end else ''}.{row.name}") for row in rows)
    )


def objective_duals(problem: OptimalControlProblem) -> tuple[ObjectiveDual, ...]:
    """Return the nodes of every objective of a problem, by its name."""
    return tuple(
        ObjectiveDual(
            neuron=f"z_J.{n}", measure=f"J.{n}", level="E.max",
            residual=f"g_J.{n}", sum=f"s_J.{n}", multiplier=f"zeta_J.{n}",
            curve="exp" if problem.temperature else "rectify",
        )
        for n in problem.objective_names
    )  # fmt: skip


def objective_neurons(objectives: Sequence[ObjectiveDual], cost: float) -> tuple[Neuron, ...]:
    """Return the shared neurons of objectives: z, then measures J and the level E.

    J and E are in units of ``cost``.
    """
    reported = [objective.measure for objective in objectives]
    reported += [objective.level for objective in objectives[:1]]
    scales = {objective.neuron: IDENTITY for objective in objectives}
    scales |= dict.fromkeys(reported, Scale(cost))
    return tuple(Neuron(name=name, scale=scale, shared=True) for name, scale in scales.items())


def name_objective(wiring: Wiring, objective: ObjectiveDual, r: float, temperature: float) -> None:
    """Add the sum J - E - T z, z + r times that, and the rectifier or exponential.

    The nodes exist in every cell.
    """
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
    """Return in-cell wires of shared neurons: zeta - z (or s - z), -J, and sum - 1."""
    ends = [(ONE, objective.level, -1.0) for objective in objectives[:1]]
    for o in objectives:
        ends += [(o.followed, o.neuron, 1.0), (o.neuron, o.neuron, -1.0)]
        ends += [(o.measure, o.measure, -1.0), (o.multiplier, o.level, 1.0)]
    last = np.eye(stages)[-1]
    return [Connection(source=s, target=t, weight=weight * last) for s, t, weight in ends]


def name_diode(
    wiring: Wiring, diode: InequalityDual, w: float, soft: Soft | None, multiplier: Scale
) -> None:
    """Add the sum g, which is filled later, z + w g, and m.

    ``soft`` is the soft constraint of the row; its penalty weight limits m if the neuron has an
    excess node. ``multiplier`` is the scale of m.
    """
    residual = wiring.named_sum(diode.residual)
    inside = wiring.named_sum(diode.sum)
    wiring.fill(diode.sum, add(wiring.signal(diode.neuron), scaled(residual, w)))
    if soft is None or not diode.excess:
        wiring.named_function(diode.multiplier, "rectify", diode.sum)
        return
    wiring.named_sum(diode.excess)
    wiring.fill(diode.excess, add(inside, {(): -soft.weight / multiplier.factor}))
    place = diode.multiplier.removeprefix("zeta")
    for name, source in ((f"inside{place}", diode.sum), (f"beyond{place}", diode.excess)):
        wiring.named_function(name, "rectify", source)
    wiring.named_sum(diode.multiplier)
    beyond = scaled(wiring.signal(f"beyond{place}"), -1.0)
    wiring.fill(diode.multiplier, add(wiring.signal(f"inside{place}"), beyond))


def fill_residual(
    wiring: Wiring, diode: InequalityDual, g: Signal, soft: Soft | None, units: tuple[Scale, Scale]
) -> None:
    """Fill the sum g - d z that drives z, from g in the user's units.

    The units are the scales of the row and of z.
    """
    row, multiplier = (scale.factor for scale in units)
    value = divided(g, row)
    if soft is not None and soft.compliance:
        leak = soft.compliance * multiplier / row
        value = add(value, scaled(wiring.signal(diode.neuron), -leak))
    wiring.fill(diode.residual, value)


def diode_drive(wiring: Wiring, diode: InequalityDual, w: float) -> Signal:
    """Return the net input (m - z) / w of z."""
    pull = diode.weights(w)
    ends = (diode.multiplier, diode.neuron)
    return add(*(scaled(wiring.signal(s), pull[f"{diode.neuron}<-{s}"]) for s in ends))


def absent_diodes(equations: StageEquations) -> list[tuple[str, int]]:
    """Return omitted rectifying neurons (name, stage).

    End rows exist at the last stage only. A row is omitted at stage 0 if q_0 fixes all of g.
    """
    problem, last = equations.problem, equations.problem.horizon - 1
    free = {s for s, fixed in zip(problem.states, problem.fixed_start) if not fixed}
    moving = free | set(problem.controls)
    still = [row for row in equations.rows if not row.expression.free_symbols & moving]
    absent = [(diode.neuron, 0) for diode in inequality_duals(still)]
    at_end = inequality_duals(equations.end_rows)
    return absent + [(diode.neuron, k) for diode in at_end for k in range(last)]
