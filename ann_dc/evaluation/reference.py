"""Reference evaluator: a short, batched NumPy implementation of a network.

All other evaluators must agree with the reference evaluator. States may be complex: the imaginary
part of a complex step is the derivative to rounding, which checks the Jacobian independently.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, final

import numpy as np

from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.rules import RoleRows, is_defined, projected, pushes_out, residuals
from ann_dc.evaluation.tape import (
    BY_VALUE,
    BY_WEIGHT,
    FUNCTION,
    PRODUCT,
    SUM,
    Tape,
    build_tape,
    reading,
)
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network
from ann_dc.validation import checked


@checked
def evaluator(network: Network) -> ReferenceEvaluator:
    """Return the reference evaluator of a network.

    The evaluator is created once and cached as long as the network exists.

    Parameters
    ----------
    network : Network
        Network to evaluate.

    Returns
    -------
    ReferenceEvaluator
        Evaluator of the network.

    Examples
    --------
    >>> from ann_dc.network import Cell, Connection, Neuron
    >>> decay = Connection(source="x", target="x", weight=-2.0)
    >>> row = Network(stages=2, cell=Cell(neurons=(Neuron(name="x"),), connections=(decay,)))
    >>> evaluator(row).rhs([1.0, 3.0]).tolist()
    [-2.0, -6.0]
    """
    kept = vars(network)  # beside the cached properties of the record
    if _KEPT not in kept:
        kept[_KEPT] = ReferenceEvaluator(network)
    return kept[_KEPT]


_KEPT = "_reference_evaluator"


@final
class ReferenceEvaluator(Evaluator):
    """NumPy evaluator of one network.

    States, net inputs and state derivatives may be complex and have leading batch axes: (..., n)
    gives (..., nodes, N + 2), (..., neurons, N) and (..., n).

    Attributes
    ----------
    edges : dict of str to int
        Row of every connection in ``tape.weights``, by name.

    Examples
    --------
    Exact slopes without differences, by a complex step:

    >>> from ann_dc.network import Cell, Connection, Neuron
    >>> decay = Connection(source="x", target="x", weight=-2.0)
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=(decay,)))
    >>> float(evaluator(row).rhs(np.array([1.0 + 1e-30j])).imag[0] / 1e-30)
    -2.0
    """

    def __init__(self, network: Network) -> None:
        tape, self.edges = build_tape(network)
        super().__init__(network, tape)

    @cached_property
    def penalty_paths(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows in ``tape.weights`` and neuron rows of the PI dual and objective paths."""
        cell = self.network.cell
        paths = {dual.path: dual.neuron for dual in (*cell.duals, *cell.objectives)}
        there = [(self.edges[path], neuron) for path, neuron in paths.items() if path in self.edges]
        rows = [(row, self.network.neuron_index[neuron]) for row, neuron in there]
        first, second = np.array(rows, np.int64).reshape(-1, 2).T
        return first, second

    @cached_property
    def multipliers(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Neuron rows and multiplier rows by population (duals, diodes, objectives)."""
        rows: dict[str, list[tuple[int, int]]] = {}
        cell, index = self.network.cell, self.network.node_index
        for dual in (*cell.duals, *cell.inequality_duals, *cell.objectives):
            population = self.network.neuron(dual.neuron).population
            row = index[dual.neuron], index[dual.multiplier]
            rows.setdefault(population, []).append(row)
        return {name: tuple(np.array(found).T) for name, found in rows.items()}

    # ---- values ------------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (..., nodes, N + 2) of all nodes at states (..., n)."""
        return node_values(self.tape, x)

    def node(self, x: np.ndarray, name: str) -> np.ndarray:
        """Return the values (..., N) of a named node at states (..., n).

        Raises `KeyError` if the node does not exist.
        """
        return self.values(np.asarray(x, float))[..., self.network.node_index[name], 1:-1]

    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net inputs (..., neurons, N) at states (..., n), cut at limits."""
        arriving, outward = self._arriving(x)
        return np.where(outward, 0, arriving)

    def _arriving(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return uncut net inputs (..., neurons, N) and a mask of outward ones at limits."""
        values = self.values(x)
        arriving = np.stack(
            [_arriving(self.tape, values, first, last) for first, last in self.tape.drives], axis=-2
        )
        shared = self.tape.shared
        arriving[..., shared, -1] = arriving[..., shared, :].sum(axis=-1)
        state = np.real(values[..., : len(self.tape.drives), 1:-1])
        outward = pushes_out(state, np.real(arriving), *self.tape.limits.T[:, :, None])
        return np.where(self.network.live, arriving, 0), outward

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """Return dx/ds (..., n), the projection of M times the net inputs on the limits."""
        x = _state(x)
        preconditioner, row, pack = (
            self.network.preconditioner,
            self.network.layout,
            self.network.pack,
        )
        arriving, outward = self._arriving(x)
        drives = pack(np.where(outward & ~self._coupled, 0, arriving))
        derivatives = preconditioner.derivatives(row, drives)
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        coupled = pack(np.broadcast_to(self._coupled, row.rates.shape))
        at_limit = coupled & ((np.real(x) <= low) | (np.real(x) >= high))
        for sample in map(tuple, np.argwhere(at_limit.any(axis=-1))):
            state, drive = np.real(x[sample]), drives[sample]
            derivatives[sample] = projected(
                lambda held: preconditioner.clamp(row, held), drive, state, low, high, coupled
            )
        return derivatives

    @cached_property
    def _coupled(self) -> np.ndarray:
        """Mask (P, 1) of neurons that also move with the net inputs of other neurons."""
        return self.network.preconditioner.reach(self.network.layout)[:, None]

    def derivative(self, drive: np.ndarray) -> np.ndarray:
        """Multiply net inputs (..., n), real or complex, by M."""
        return self.network.preconditioner.derivatives(self.network.layout, _state(drive))

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Return the relative (constraint, stationarity) residuals."""
        drives, state = self.drives(x), self.network.unpack(x)
        constraint, stationarity = residuals(np, self._role_rows, drives, state)
        return float(constraint), float(stationarity)

    @cached_property
    def _role_rows(self) -> RoleRows:
        return RoleRows.of(self.tape.roles)

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """Return (block, stage) of the first block outside its domain, or (-1, -1)."""
        return outside_of(self.tape, self.values(x), guard)

    # ---- derivatives -------------------------------------------------------------------------

    def slot_values(self, x: np.ndarray) -> np.ndarray:
        """Return the slot derivatives (slots, N + 2) at one state (n,)."""
        values, tape, stages = self.values(x), self.tape, self.network.stages
        slots = tape.slot_start.astype(values.dtype)
        for target, source, offset, kind, index in tape.slots:
            if kind == BY_WEIGHT:
                factor = tape.weights[index]
            elif kind == BY_VALUE:
                factor = values[index, 1:-1]
            else:
                _, node, code, argument = tape.blocks[index]
                factor = FUNCTIONS[code].slope(values[argument, 1:-1], values[node, 1:-1])
            here, there = reading(offset, stages)
            slots[target, 1:-1][here] += factor[here] * slots[source, there]
        return slots

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Return the entries (nnz,) of d drive / dx; zero at a saturation limit."""
        slots = self.slot_values(np.asarray(x))
        entries = slots[self.tape.entries[:, 2], self.tape.entries[:, 3] + 1]
        saturated = self.saturated(x, self.drives(x))
        return np.where(saturated[self.tape.entries[:, 0]], 0, entries)

    @cached_property
    def preconditioner(self) -> Any:
        """Preconditioner M of dx/ds = M d, sparse (n, n), symmetric positive definite."""
        return self.network.preconditioner.factors(self.network.layout).matrix()

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return the dense Jacobian (n, n) of `rhs` with saturated neurons held.

        The Jacobian is the preconditioner restricted to the free neurons (`Preconditioner.clamp`)
        times the block-tridiagonal drive Jacobian.
        """
        x = _state(x)
        columns = self.drive_jacobian(x).toarray().T
        return self.clamped(self.saturated(x, self.drives(x)))(columns).T


def node_values(tape: Tape, x: np.ndarray) -> np.ndarray:
    """Return the values (..., nodes, N + 2) at real or complex states (..., n)."""
    x = np.asarray(x)
    values = np.empty((*x.shape[:-1], *tape.values.shape), x.dtype)
    values[...] = tape.values
    values[..., tape.places[:, 0], tape.places[:, 1] + 1] = x
    values[..., tape.shared, 1:-1] = values[..., tape.shared, -2:-1]
    for kind, node, a, b in tape.blocks:
        if kind == SUM:
            values[..., node, 1:-1] = _arriving(tape, values, a, b)
        elif kind == PRODUCT:
            values[..., node, 1:-1] = values[..., a, 1:-1] * values[..., b, 1:-1]
        else:
            values[..., node, 1:-1] = FUNCTIONS[a].value(values[..., b, 1:-1])
    return values


def _arriving(tape: Tape, values: np.ndarray, first: int, last: int) -> np.ndarray:
    stages = tape.rates.shape[1]
    total = np.zeros((*values.shape[:-2], stages), values.dtype)
    for edge in range(first, last):
        source, offset = tape.sources[edge]
        here, there = reading(offset, stages)
        total[..., here] += tape.weights[edge, here] * values[..., source, there]
    return total


def outside_of(tape: Tape, values: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
    """Return (block, stage) of the first block outside its domain, or (-1, -1).

    The node values have shape (nodes, N + 2).
    """
    for step, (kind, _, code, node) in enumerate(tape.blocks):
        if kind == FUNCTION:
            low, high = guard.domains[code]
            defined = is_defined(values[node, 1:-1], low, high, guard.signs[step])
            if not defined.all():
                return step, int(np.argmin(defined))
    return -1, -1


def _state(x) -> np.ndarray:
    """Convert a state to floating-point or complex numbers."""
    return np.asarray(x, dtype=np.result_type(np.asarray(x), float))


def tape_with_penalty(network: Network, rho: np.ndarray | float) -> Tape:
    """Return the tape of the network with other penalties rho.

    The penalty is one number for all PI duals, diode neurons and objectives, or an array (P,) with
    one entry for each neuron of the cell. Only the entries of these neurons are used.
    """
    own, index = evaluator(network), network.neuron_index
    weights, (paths, neurons) = own.tape.weights.copy(), own.penalty_paths
    given = np.broadcast_to(rho, len(index))
    weights[paths] = given[neurons, None]
    for diode in network.cell.inequality_duals:
        for name, weight in diode.weights(float(given[index[diode.neuron]])).items():
            if name in own.edges:
                weights[own.edges[name]] = weight
    return own.tape._replace(weights=weights)
