"""What a network is wired of, as a table of text: in one cell, and in all of them."""

from __future__ import annotations

from collections import Counter

import numpy as np

from ann_dc.network.cell import Cell, Function, Product, Sum
from ann_dc.network.metrics.contract import Kind, Wires
from ann_dc.prefixes import counted


def listing(title: str, cell: Cell, live: np.ndarray, wires: Wires, kind: Kind) -> str:
    """How many neurons, blocks, connections and wires of the metric there are.

    Parameters
    ----------
    title : str
        Of the network.
    cell : Cell
    live : (neurons, N) booleans
        Which neurons are neither pinned nor absent.
    wires, kind : Wires and Kind
        Of the metric.

    Returns
    -------
    str
    """
    stages = live.shape[1]
    each_way = " each way" if wires.both_ways else ""
    rows = [
        ("neurons", len(cell.neurons), f"{int(live.sum())} live"),
        ("multipliers", cell.count(Product), cell.count(Product) * stages),
        ("function blocks", cell.count(Function), cell.count(Function) * stages),
        ("summing blocks", cell.count(Sum), cell.count(Sum) * stages),
        ("connections", len(cell.connections), len(cell.connections) * stages),
        ("nodes of the metric", "-", f"{wires.nodes}, of the {kind.value}"),
        ("wires of the metric", f"{wires.per_cell(stages):.0f}", f"{wires.count}{each_way}"),
    ]
    shared = sum(neuron.shared for neuron in cell.neurons)
    if shared:
        rows.insert(1, ("shared by all cells", "-", f"{shared}, in the last cell"))
    populations = Counter(neuron.population for neuron in cell.neurons)
    functions = Counter(b.function for b in cell.blocks if isinstance(b, Function))
    head = f"{title}: {counted(stages, 'cells')} of " + ", ".join(
        f"{count} {name}" for name, count in populations.items()
    )
    table = [f"{'':22}{'per cell':>10}  in all"]
    table += [f"  {name:20}{per!s:>10}  {total}" for name, per, total in rows]
    used = ", ".join(f"{count} {name}" for name, count in sorted(functions.items()))
    return "\n".join([head, *table, *([f"  functions: {used}"] if used else [])])
