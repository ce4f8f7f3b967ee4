"""Conversion of a network to a manifest, arrays and their descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from ann_dc.network.cell import Connection, Template
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.network.preconditioners.stiffness import Stiffness
from ann_dc.network.selection import clamped_rows
from ann_dc.scale import Scale
from ann_dc.weights.manifest import FORMAT, SCHEMA, weight_names

ABOUT = (
    "N equal cells in a row (stages 0 to N - 1): dx/ds = M d(x). The drive d of a neuron, and the"
    " value of a sum, is the sum of weight * value of the source over the connections that end "
    "there; `tensors` lists the weights in the order of `connections`. The template says in which"
    " cell the source is: the one before (previous), the same (self), the next one (next), or one"
    " so many stages away (a whole number). `one` is the constant 1, beyond the ends of the row "
    "too; every other source is 0 there, except that in front of stage 0 a node of "
    "`left_boundary` has the value of that input at stage 0. A product multiplies a and b, a "
    "function is that of x (log to base e; rectify is max(0, x)); blocks are listed in the order "
    "of evaluation, each in all cells before the next one. Value of an input = (given - offset) /"
    " factor with `input_scale` (without it: as given). A `fixed` neuron has the value of its "
    "input at that stage, an `omitted` one is 0; a shared one is a single neuron, in the last "
    "cell: all cells read it, and its drive is the sum of those of all cells. Limits: {limits}; "
    "after a step of finite length x is clipped to its limits. M acts on live neurons: d of "
    "fixed, omitted and other cells' shared ones is 0, and they do not move. States are in "
    "network units: user's value = scale_offset + scale_factor * state (offset 0 without the "
    "array). Connections compute multipliers too, and `duals`, `inequality_duals` and "
    "`objectives` name them only: m = mu + rho c of a PI multiplier neuron with residual c, m = "
    "max(0, z + w g) of a rectifying multiplier neuron z of a constraint g <= 0. "
)
"""Network equation as manifest text, with a placeholder for saturation; M follows."""

CUT = "d is 0 where x <= low and d < 0, or x >= high and d > 0; then M d likewise"
PROJECTED = (
    "the moves are v = M (d + r) with currents r of ideal diodes. Where x <= low, v >= 0, r >= "
    "0 and v r = 0; where x >= high, v <= 0, r <= 0 and v r = 0; elsewhere r = 0. So v is the "
    "argmin of v' M^-1 v / 2 - d' v over all v that exceed no limit. To find r, hold the "
    "neurons C at limits whose d points outward: v_C = 0 and r_C = -(M_CC)^-1 (M d)_C. Let go "
    "those whose r has the wrong sign, hold those whose v has, until there is none; after 10 "
    "rounds exchange the last of them only. A wrong r up to 1e-13 of the largest |d| + |r| of "
    "C counts as 0"
)
"""Manifest text on saturation limits of neurons that M does not couple, and of those it does."""

_PYRAMID = (
    "M = diag(1 / tau) + sum over levels l of H_l S_l H_l'. Each of the `chains` (q, t) has 2N "
    "positions p = 0, 1, 2, ...: q of stage 0, t of stage 0, q of stage 1, ... S_l is `gain/l` "
    "with G points, and H_l[p, a] = max(0, 1 - |p (G - 1) / (2N - 1) - a|) for every chain: "
    "move[i, p] += sum over a, j, r of H_l[p, a] S_l[a, i, j] H_l[r, a] d[j, r] for chains i, j."
)
_STIFFNESS = (
    "M = diag(1 / tau), but M = T^(1/2) S^-1 T^(1/2) between the primal neurons (role primal, in "
    "the order of `neurons`) of all stages, with T = diag(1 / tau). S is symmetric: "
    "`stiffness/own`[k] is its block within stage k, `stiffness/following`[k] that of stage k "
    "(rows) and stage k + 1 (columns), all others are 0; rows and columns of neurons that are not"
    " live are left out."
)
PRECONDITIONERS: dict[PreconditionerKind, str] = {
    PreconditionerKind.DIAGONAL: "M = diag(1 / tau).",
    PreconditionerKind.MULTILEVEL: _PYRAMID,
    PreconditionerKind.COUPLED_MULTILEVEL: _PYRAMID,
    PreconditionerKind.RESISTIVE_GRID: _STIFFNESS,
    PreconditionerKind.CYCLIC_REDUCTION: _STIFFNESS,
}
"""Manifest text on M for every preconditioner kind."""

WORDS: dict[str, tuple[str, str, str]] = {
    "tau": ("time constant of neuron {}", "network time", "stage"),
    "weight": ("weight of connection {}", "network units of target over source", "stage"),
    "input": ("value of input {}", "the user's", "stage"),
    "times": ("times of the samples of input {}", "network time", "sample"),
    "values": ("samples of input {} over time", "the user's", "sample stage"),
    "start": ("initial state of neuron {}", "network units", "stage"),
    "limits": ("lower and upper saturation limit of every neuron", "network units", "neuron end"),
    "scale_factor": ("user's value of a state of 1, of every neuron", "the user's", "neuron"),
    "scale_offset": ("user's value of a state of 0, of every neuron", "the user's", "neuron"),
    "input_scale": ("factor and offset of every input", "the user's", "input part"),
    "range": ("range of design: lowest and highest value", "the user's", "input end"),
    "gain": (
        "gains of the coarse-level neurons of level {}, 0 is the finest",
        "1 / network time",
        "point chain chain",
    ),
    "own": ("stiffness within every cell", "none, multiplied by the rates", "stage primal primal"),
    "following": (
        "stiffness between a cell and the next one",
        "none, multiplied by the rates",
        "stage primal primal",
    ),
}
"""Description, unit and axes of an array, by the first part of its name (stiffness: second)."""

STIFFNESSES: dict[PreconditionerKind, type[Stiffness]] = {
    PreconditionerKind.RESISTIVE_GRID: ResistiveGrid,
    PreconditionerKind.CYCLIC_REDUCTION: CyclicReduction,
}
"""Class of each stiffness, by its kind."""


def about(network: Network) -> str:
    """Return the network equation as text, for readers that have only the file."""
    limits = PROJECTED if len(clamped_rows(network)) else CUT
    return ABOUT.format(limits=limits) + PRECONDITIONERS[network.preconditioner.kind]


def manifest_of(network: Network) -> dict:
    """Return the names and wiring of a network as a JSON table, without numbers."""
    cell, preconditioner = network.cell, network.preconditioner
    table = {
        "format": FORMAT,
        "schema": SCHEMA,
        "title": network.title,
        "stages": network.stages,
        "neurons": [
            {"name": n.name, "role": n.role.value} | ({"shared": 1} if n.shared else {})
            for n in cell.neurons
        ],
        "inputs": list(cell.inputs),
        "blocks": [{"kind": type(b).__name__.lower(), **asdict(b)} for b in cell.blocks],
        "connections": [
            {"source": c.source, "target": c.target, "template": _template(c)}
            for c in cell.connections
        ],
        "duals": [asdict(dual) for dual in cell.duals],
        "inequality_duals": [asdict(dual) for dual in cell.inequality_duals],
        "objectives": [asdict(objective) for objective in cell.objectives],
        "chains": [list(chain) for chain in cell.chains],
        "fixed": [asdict(fixed) for fixed in network.fixed],
        "omitted": [asdict(omitted) for omitted in network.omitted],
        "left_boundary": dict(sorted(network.left_boundary.items())),
        "start": sorted(network.start),
        "preconditioner": {
            "kind": preconditioner.kind.value,
            "levels": len(preconditioner.gains) if isinstance(preconditioner, Multilevel) else 0,
        },
    }
    if is_shifted(network):
        table["shifted"] = 1
    if network.ranges:
        table["ranged"] = 1
    if network.waveforms:
        table["waveforms"] = {name: one.hold for name, one in sorted(network.waveforms.items())}
    return table


def arrays_of(network: Network) -> dict[str, object]:
    """Return all numbers of a network as arrays, by entry name."""
    cell = network.cell
    arrays: dict[str, object] = {
        "limits": [(n.limiter.low, n.limiter.high) for n in cell.neurons],
        "scale_factor": [n.scale.factor for n in cell.neurons],
    }
    arrays |= {f"tau/{n.name}": _one_or_each(n.tau, network) for n in cell.neurons}
    for name, connection in zip(weight_names(cell.connections), cell.connections):
        arrays[name] = _one_or_each(connection.weight, network)
    arrays |= {f"input/{name}": network.inputs[name] for name in cell.inputs}
    arrays |= {f"start/{name}": network.start[name] for name in sorted(network.start)}
    if is_shifted(network):
        arrays["scale_offset"] = [n.scale.offset for n in cell.neurons]
        arrays["input_scale"] = [network.input_scale(name) for name in cell.inputs]
    if network.ranges:
        open_ends = (-np.inf, np.inf)
        arrays["range"] = [network.ranges.get(name, open_ends) for name in cell.inputs]
    for name, one in sorted(network.waveforms.items()):
        arrays |= {f"times/{name}": one.times, f"values/{name}": one.values}
    return arrays | _preconditioner_arrays(network.preconditioner)


def words_of(network: Network, arrays: Mapping[str, object]) -> dict[str, dict]:
    """Return the description, unit and axis meanings of every array, by entry name."""
    cell = network.cell
    penalties = {f"weight/{d.path}": f"rho of {d.neuron}" for d in (*cell.duals, *cell.objectives)}
    penalties |= {f"weight/{d.path}": f"w of {d.neuron}" for d in cell.inequality_duals}
    table = {}
    for name, values in arrays.items():
        first, _, rest = name.partition("/")
        description, unit, axes = WORDS[rest if first == "stiffness" else first]
        rho = f", {penalties[name]}" if name in penalties else ""
        counted = axes.split()[: np.ndim(values)]  # type: ignore[arg-type]
        table[name] = {"description": description.format(rest) + rho, "unit": unit, "axes": counted}
    return table


def is_shifted(network: Network) -> bool:
    """Return True if a neuron has an offset or an input has a scale."""
    offsets = any(neuron.scale.offset for neuron in network.cell.neurons)
    return offsets or any(scale != Scale() for scale in network.input_scales.values())


def _template(connection: Connection) -> str | int:
    """Return the name of a neighbouring cell, or the stage distance to a farther cell."""
    if abs(connection.template) > 1:
        return int(connection.template)
    return Template(connection.template).name.lower()


def _preconditioner_arrays(preconditioner: Preconditioner) -> dict[str, object]:
    if isinstance(preconditioner, Multilevel):
        return {f"gain/{level}": gain for level, gain in enumerate(preconditioner.gains)}
    if isinstance(preconditioner, Stiffness):
        own, following = preconditioner.own, preconditioner.following
        return {"stiffness/own": own, "stiffness/following": following}
    return {}


def _one_or_each(value, network: Network) -> np.ndarray:
    """Return a single number, or one number per stage."""
    return np.asarray(value) if np.ndim(value) == 0 else np.broadcast_to(value, network.stages)
