"""Networks in fixed point for tests, and a machine of their own to compare with.

The machine is written from the words of the README alone, with Python's integers, which do not
overflow.
"""

import shutil
import subprocess
from functools import cache
from pathlib import Path

import constrained
import minimax
import pytest

import ann_dc
from ann_dc.export.fixed_point.golden import FixedPoint
from ann_dc.export.fixed_point.widths import fixed_point
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS

PROBLEMS = {
    "double_integrator": lambda: ann_dc.plants.double_integrator(N=4),
    "car": ann_dc.plants.car,
    "van_der_pol": lambda: ann_dc.plants.van_der_pol(N=12),
    "two_link_arm": lambda: ann_dc.plants.two_link_arm(N=10),
    "cstr": lambda: ann_dc.plants.cstr(N=10),
    "free time": ann_dc.plants.pendulum_free_time,
    "bounds": constrained.dint_u,
    "obstacle": constrained.bryson,
    "objectives": minimax.small,
    "softened": lambda: minimax.small(temperature=0.05),
}
"""Ten problems: products, functions near a pole, diodes, rails, and shared neurons."""


@cache
def walked(
    name: str, kind: ann_dc.PreconditionerKind | None = None
) -> tuple[Network, ReferenceVector]:
    problem = PROBLEMS[name]()
    # integers hold rails one by one: no preconditioner may couple them
    kinds = [ann_dc.PreconditionerKind.MULTILEVEL] if problem.bounds else ALL_KINDS
    network = ann_dc.design(problem, preconditioner=kinds if kind is None else [kind]).network
    return network, reference_vector(network)


def pressed() -> tuple[Network, ReferenceVector]:
    """A neuron that starts and stays at its rail, which a drive of 20 presses it against."""
    weights = {"x": -1.0, "a": 40.0}
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=0.0, high=1.0)),),
        inputs=("a",),
        connections=tuple(
            Connection(source=source, target="x", weight=weight)
            for source, weight in weights.items()
        ),
    )
    network = Network(cell=cell, stages=1, inputs={"a": 0.5}, start={"x": 1.0})
    return network, reference_vector(network)


@cache
def in_integers(name: str, bits: int = 0) -> FixedPoint:
    return fixed_point(*walked(name), bits=bits, accuracy=1e-3)


def walk(model: FixedPoint, steps: int) -> list[int]:  # noqa: C901 - one branch an operation
    """The words of the neurons after so many steps, computed in another way."""
    machine = model.machine
    bits, guard = machine.bits, machine.guard
    top = 2 ** (bits + guard - 1) - 1
    words, edges = machine.words.tolist(), machine.edges.tolist()
    tables, entries = machine.tables.tolist(), machine.entries.tolist()
    neurons = machine.neurons.tolist()

    def rounded(a: int, shift: int) -> int:
        return (2 * a + 2**shift) // 2 ** (shift + 1) if shift > 0 else a * 2**-shift

    def looked_up(table: list[int], x: int) -> int:
        low, high, spacing, first = table
        cell, share = divmod(min(max(x, low), high) - low, 2**spacing)
        left, right = entries[first + cell], entries[first + cell + 1]
        return left + rounded((right - left) * share, spacing)

    def computed(kind: int, a: int, b: int, shift: int) -> int:
        if kind == 1:
            return rounded(rounded(words[a], guard) * rounded(words[b], guard), shift)
        if kind == 2:
            return looked_up(tables[a], rounded(words[b], guard))
        if kind == 3:
            return rounded(max(words[b], 0), shift)
        return rounded(sum(w * 2**exponent * words[at] for at, w, exponent in edges[a:b]), shift)

    for _ in range(steps):
        for kind, target, a, b, shift, neuron in machine.operations.tolist():
            value, place = computed(kind, a, b, shift), target
            assert abs(value) < 2**62, "no 64 bits hold it"
            least, most = -top - 1, top
            if kind == 5:
                place, _, least, most, *_ = neurons[neuron]
                value += words[place]
            value = min(max(value, least), most)
            if kind == 4:
                own, _, low, high, *_ = neurons[neuron]
                out = (words[own] <= low and value < 0) or (words[own] >= high and value > 0)
                value = 0 if out else value
            words[place] = value
    return [words[place] for place, *_ in neurons]


def written(files: dict[str, bytes], folder: Path) -> Path:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def needs(tool: str) -> None:
    if not shutil.which(tool):
        pytest.skip(f"{tool} is not installed")


def said(folder: Path, *command: str, timeout: float = 300) -> tuple[int, str]:
    run = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False
    )
    return run.returncode, run.stdout + run.stderr
