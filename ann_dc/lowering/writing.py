"""Conversion of a network to a `Program`: nodes become words, what computes them operations."""

from __future__ import annotations

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import PRODUCT as TAPE_PRODUCT, SUM as TAPE_SUM
from ann_dc.lowering.preconditioner_sums import add_pyramid
from ann_dc.lowering.program import (
    DRIVE,
    FUNCTION,
    PRODUCT,
    RECTIFY,
    SUM,
    UPDATE,
    ZERO,
    Edges,
    Listing,
    Program,
)
from ann_dc.lowering.stiffness_sums import StiffnessSolve, substitution
from ann_dc.network.cell import ONE
from ann_dc.network.functions import CODE
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows


def program_of(network: Network, step: float, solve: StiffnessSolve = substitution) -> Program:
    """Return the operations of one step of length h in network time.

    A stiffness between neighbours is solved by ``solve``. Raises `ExportError` if the
    preconditioner couples neurons that have saturation limits.
    """
    check_limits(network, "integers")
    writer = _Writer(network)
    writer.blocks()
    writer.drives()
    writer.updates(step, solve)
    return writer.finished()


def check_limits(network: Network, parts: str) -> None:
    """Raise `ExportError` if the preconditioner couples neurons that have limits.

    Derivatives at saturation limits are a projection in the norm of M^{-1}. The saturated neurons
    are determined by pivoting, which the named ``parts`` (plural noun) of the format cannot do.
    """
    coupled = [network.cell.neurons[row].name for row in clamped_rows(network)]
    if coupled:
        raise ExportError(
            f"{network.title}: its {network.preconditioner.kind.value} couples neurons with "
            f"saturation limits ({', '.join(coupled)}), which {parts} support for uncoupled "
            "neurons only; design the network with preconditioner=PreconditionerKind.DIAGONAL "
            "(--preconditioner diagonal), or use dataclasses.replace(network, "
            "preconditioner=Diagonal())"
        )


class _Writer:
    """Words of nodes, and the operations that write them."""

    def __init__(self, network: Network) -> None:
        self.network, self.tape, self.listing = network, evaluator(network).tape, Listing()
        self.address = np.full(self.tape.values.shape, ZERO, np.int64)
        self.drive_words = np.full(self.tape.rates.shape, ZERO, np.int64)
        self.inputs: dict[str, np.ndarray] = {}
        self._places()

    def _places(self) -> None:
        """Create the words of inputs, of one and of neurons; other positions refer to these."""
        network, nodes, listing = self.network, self.network.node_index, self.listing
        self.address[nodes[ONE]] = listing.new(listing.row(ONE), [1.0])
        for name in network.cell.inputs:
            words = listing.new(listing.row(name), network.input_values[name])
            self.inputs[name] = self.address[nodes[name], 1:-1] = words
        for index, neuron in enumerate(network.cell.neurons):
            live = np.flatnonzero(network.live[index])
            own = listing.new(listing.row(neuron.name), np.zeros(len(live)))
            self.address[index, live + 1] = own
        self.address[network.shared, 1:-1] = self.address[network.shared, -2:-1]
        for pin in network.fixed:
            self.address[nodes[pin.neuron], pin.stage + 1] = self.inputs[pin.input][pin.stage]
        for node, source in network.left_boundary.items():
            self.address[nodes[node], 0] = self.inputs[source][0]

    def arriving(self, first: int, last: int, stage: int) -> Edges:
        """Return the contributions to a node of one cell from the tape's connections."""
        for edge in range(first, last):
            source, offset = self.tape.sources[edge]
            if 0 <= stage + 1 + offset < self.network.stages + 2:
                word = int(self.address[source, stage + 1 + offset])
                yield word, float(self.tape.weights[edge, stage])

    def blocks(self) -> None:
        names, listing = list(self.network.node_index), self.listing
        for kind, node, a, b in self.tape.blocks.tolist():
            words = listing.new(listing.row(names[node]), np.zeros(self.network.stages))
            self.address[node, 1:-1] = words
            for stage, word in enumerate(words.tolist()):
                if kind == TAPE_SUM:
                    listing.sum(SUM, word, self.arriving(a, b, stage))
                elif kind == TAPE_PRODUCT:
                    left, right = int(self.address[a, stage + 1]), int(self.address[b, stage + 1])
                    listing.operations.append((PRODUCT, word, left, right, -1))
                else:
                    of = RECTIFY if a == CODE["rectify"] else FUNCTION
                    argument = int(self.address[b, stage + 1])
                    listing.operations.append((of, word, a, argument, -1))

    def drives(self) -> None:
        """Append the net inputs of all neurons; a shared neuron sums over all cells."""
        network, shared = self.network, set(self.network.shared.tolist())
        rows = [self.listing.row(f"net input of {neuron.name}") for neuron in network.cell.neurons]
        for place, (neuron, stage) in enumerate(network.places.tolist()):
            self.drive_words[neuron, stage] = word = self.listing.word(rows[neuron])
            cells = range(network.stages) if neuron in shared else (stage,)
            first, last = self.tape.drives[neuron].tolist()
            edges = [edge for cell in cells for edge in self.arriving(first, last, cell)]
            self.listing.sum(DRIVE, word, edges, place)

    def updates(self, step: float, solve: StiffnessSolve) -> None:
        """Append the updates of all neurons by h times their derivatives."""
        rates, parts = self.tape.rates, (self.network, self.tape, self.listing, self.drive_words)
        derivatives = [
            [(int(self.drive_words[p, k]), float(rates[p, k]))] for p, k in self.network.places
        ]
        if len(self.tape.chains):
            add_pyramid(derivatives, *parts)
        solve(derivatives, *parts)
        for place, edges in enumerate(derivatives):
            scaled = [(word, step * weight) for word, weight in edges]
            self.listing.sum(UPDATE, place, scaled, place)

    def finished(self) -> Program:
        """Return the program without operations whose results are not read."""
        listing, (rows, stages) = self.listing, self.network.places.T
        return Program(
            operations=listing.needed(),
            sources=np.array(listing.sources, np.int64),
            weights=np.array(listing.weights),
            words=np.array(listing.values),
            rows=np.array(listing.rows, np.int64),
            names=tuple(listing.names),
            states=self.address[rows, stages + 1],
            start=self.network.start_state,
            limits=self.tape.limits[rows],
            inputs=self.inputs,
        )
