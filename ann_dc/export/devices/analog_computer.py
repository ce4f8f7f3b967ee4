r"""Analog-computer circuit as JSON: elements and their coefficient matrix.

The output X_e of element e lies between -1 and 1 machine unit and represents S_e X_e. With machine
time T = beta s and network time s,

.. math::
    \frac{dX_i}{dT} = \sum_j c_{ij} X_j, \quad X_i = \sum_j c_{ij} X_j, \quad X_i = X_a X_b, \quad
    X_i = g(S_a X_a) / S_i

at an integrator, a sum, a product and a function. S_e is the largest value observed in a run, times
the headroom. For a product S_e is S_a S_b; for a sum S_e is larger if a coefficient would be too
large. The time scale beta limits the coefficients at integrators. A coefficient is a potentiometer
setting up to 1, multiplied by an input gain of 1 or of the largest coefficient.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.status import Outcome
from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.devices.elements import (
    CONSTANT,
    FUNCTION,
    INTEGRATOR,
    PRODUCT,
    SUM,
    Element,
    Machine,
    elements_of,
)
from ann_dc.export.reference.sidecar import Places, check_vector, notes_of, vector_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector, compare
from ann_dc.lowering.stiffness_sums import reduction
from ann_dc.lowering.writing import check_limits, program_of
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked
from ann_dc.weights.manifest import Table

FORMAT = "ann_dc analog computer"
SCHEMA = 1
CIRCUIT = "analog_computer.json"
SAMPLES = 500
"""Number of states of a run from which the value ranges are computed."""
LEAST = 40
"""Minimum integration time of the check in vector steps: one step of a time constant settles at
once, a continuous flow needs 14 time constants.
"""
LONGER = 1.2
"""Integration time of the check relative to the duration of the vector's iteration."""
NEAR = 1e-3
"""Tolerance of the end state, relative to the largest state of the vector's end."""
MOST = 300_000
"""Maximum number of evaluations in the check."""
_VALUES = {INTEGRATOR: "start", CONSTANT: "value"}
"""Name of the value of each kind."""


@checked
def analog_computer_files(
    network: Network,
    vector: ReferenceVector,
    *,
    largest: PositiveFinite = 10.0,
    headroom: PositiveFinite = 1.5,
) -> dict[str, bytes]:
    """Export a network as the circuit of an analog computer.

    ``analog_computer.json`` contains ``elements``, ordered such that each element reads only
    earlier elements (integrators read any element). It also contains the ``matrix`` as rows
    (target, source, coefficient, gain), the ``time_scale`` beta, and the ``count`` of every element
    kind. Input gains are 1 or ``largest``, the largest coefficient; the machine unit is
    ``headroom`` times the largest observed value.

    Raises `ExportError` if an option is below 1, the preconditioner couples neurons that have
    saturation limits, the network does not settle in continuous time and the vector has no
    duration, or the vector is another's.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.pendulum(N=3)).network
    >>> files = analog_computer_files(network, reference_vector(network))
    >>> json.loads(files["analog_computer.json"])["count"]["integrator"] == network.size
    True
    """
    for name, given in (("largest", largest), ("headroom", headroom)):
        if given < 1:
            raise ExportError(f"{name}: expected a number of at least 1, got {given:g}")
    check_vector(network, vector)
    check_limits(network, "integrators of an analog computer")
    labels = [network.label(i) for i in range(network.size)]
    elements = elements_of(program_of(network, 1.0, reduction), labels)
    scales = _scales(elements, headroom * _peaks(network, elements, vector.duration), largest)
    beta = _time_scale(elements, scales, largest)
    table = {
        "wiring": vector.wiring,
        "content": vector.content,
        "largest_coefficient": largest,
        "headroom": headroom,
        "time_scale": beta,
        "count": _count(elements),
        "places": Places.of(network).pairs,
        **_table_of(elements, scales, beta, largest),
    }
    table = {"format": FORMAT, "schema": SCHEMA, "sha256": _hash(table), **table}
    return {CIRCUIT: (json.dumps(table) + "\n").encode(), VECTOR: vector.as_json()}


@checked
def analog_computer_check(files: Mapping[str, bytes]) -> str:
    """Integrate the exported elements and compare the result with the test vector.

    Raises `FileFormatError` if a file is missing or changed, or other states are reached.
    """
    vector, table = vector_of(files), notes_of(files, CIRCUIT, FORMAT, SCHEMA)
    _check_whose(table, vector)
    machine, beta = _machine_of(table), table.get("time_scale", float)
    if table.get("count", dict) != _count(machine.elements):
        raise FileFormatError(
            f"{CIRCUIT}.count: differs from the number of elements; export the network again"
        )
    if not 0 < beta < np.inf:
        raise FileFormatError(f"{CIRCUIT}.time_scale: expected a positive number, got {beta!r}")
    places = Places.read(table.get("places", list), vector.start.shape, f"{CIRCUIT}.places")
    if len(places) != len(machine.integrators):
        raise FileFormatError(f"{CIRCUIT}.places: expected one per integrator")
    runner = _Runner(machine, places, vector)

    def walk(start: np.ndarray, count: int) -> np.ndarray:
        return runner.after(start, count, vector.step * beta)

    worst = compare(vector, walk)
    steps = f"{max(vector.early)} steps within {worst:.0e} of the vector"
    known = f"{len(machine.elements)} elements; {steps}"
    if not vector.settles:
        return known
    off, peak = runner.settled(LONGER * max(vector.steps, LEAST) * vector.step * beta)
    if not off <= NEAR:
        raise FileFormatError(f"{CIRCUIT}: integrated, it ends {off:.1e} from the vector's end")
    return f"{known}; integrated to within {off:.0e} of its end, {peak:.2f} machine units at most"


# ---- scaling ---------------------------------------------------------------------------------


def _peaks(network: Network, elements: Sequence[Element], duration: float | None) -> np.ndarray:
    """Return the largest magnitude (E,) of every element in a continuous-time run."""
    run = OdeBackend(verify=False, duration=duration).run(network)
    if run.status.outcome not in (Outcome.SETTLED, Outcome.COMPLETED):
        raise ExportError(
            f"{network.title}: {run.status}; ranges are taken from a run in continuous time, so "
            "design the network first, or set the duration of a run (duration=T or --duration "
            "T)"
        )
    machine, states = Machine(elements), run.trajectory.states
    chosen = np.unique(np.linspace(0, len(states) - 1, SAMPLES).astype(int))
    return np.max([np.abs(machine.values(states[k])) for k in chosen], axis=0)


def _scales(elements: Sequence[Element], wanted: np.ndarray, largest: float) -> np.ndarray:
    """Return the values (E,) that one machine unit of every element represents."""
    scales = np.where(wanted > 0, wanted, 1.0)
    for k, e in enumerate(elements):
        if e.kind == PRODUCT:
            scales[k] = scales[e.reads[0]] * scales[e.reads[1]]
        elif e.kind == CONSTANT:
            scales[k] = abs(e.value) or 1.0
        elif e.kind == SUM:
            arriving = max((abs(w) * scales[p] for p, w in e.wires.items()), default=0.0)
            least = arriving / largest
            scales[k] = max(wanted[k], least) or 1.0
        elif e.kind == INTEGRATOR:
            ends = [abs(end) for end in (e.low, e.high) if np.isfinite(end)]
            scales[k] = max(wanted[k], *ends, 0.0) or 1.0
    return scales


def _time_scale(elements: Sequence[Element], scales: np.ndarray, largest: float) -> float:
    """Compute beta, the slowdown that limits the coefficients at the integrators."""
    sizes = [
        abs(w) * scales[p] / scales[k]
        for k, e in enumerate(elements)
        if e.kind == INTEGRATOR
        for p, w in e.wires.items()
    ]
    return float(max(sizes, default=largest) / largest)


# ---- tables --------------------------------------------------------------------------------------


def _table_of(elements: Sequence[Element], scales: np.ndarray, beta: float, largest: float) -> dict:
    """Convert elements to the tables ``elements`` and ``matrix`` in machine units."""
    rows, matrix = [], []
    for k, e in enumerate(elements):
        rows.append(_row(e, float(scales[k])))
        slower = beta if e.kind == INTEGRATOR else 1.0
        for place, weight in e.wires.items():
            coefficient = float(weight * scales[place] / scales[k] / slower)
            gain = 1.0 if abs(coefficient) <= 1 else largest
            matrix.append([k, place, coefficient / gain, gain])
    return {"elements": rows, "matrix": matrix}


def _row(e: Element, scale: float) -> dict:
    row = {"name": e.name, "kind": e.kind, "scale": scale}
    if e.kind in _VALUES:
        row[_VALUES[e.kind]] = e.value / scale
    if e.kind == INTEGRATOR:
        ends = {"low": e.low / scale, "high": e.high / scale}
        row |= {name: float(end) for name, end in ends.items() if np.isfinite(end)}
    if e.kind == FUNCTION:
        row["function"] = e.function
    if e.reads:
        row["reads"] = list(e.reads)
    return row


def _machine_of(table: Table) -> Machine:
    """Build the machine that the tables of `_table_of` describe."""
    rows = list(table.rows("elements"))
    wires: list[dict[int, float]] = [{} for _ in rows]
    for target, source, coefficient, gain in table.get("matrix", list):
        wires[target][source] = coefficient * gain
    elements = [_element(row, own) for row, own in zip(rows, wires)]
    return Machine(elements, np.array([row.get("scale", float) for row in rows]))


def _element(row: Table, wires: dict[int, float]) -> Element:
    kind = row.get("kind", str)
    return Element(
        name=row.get("name", str),
        kind=kind,
        wires=wires,
        reads=tuple(row.given.get("reads", ())),
        function=row.given.get("function", ""),
        value=row.get(_VALUES[kind], float) if kind in _VALUES else 0.0,
        low=row.given.get("low", -np.inf),
        high=row.given.get("high", np.inf),
    )


# ---- checking --------------------------------------------------------------------------------


def _check_whose(table: Table, vector: ReferenceVector) -> None:
    """Check that the table is unmodified and belongs to the network of the vector."""
    plain = {k: v for k, v in table.given.items() if k not in ("format", "schema", "sha256")}
    if _hash(plain) != table.get("sha256", str):
        raise FileFormatError(f"{CIRCUIT}: the file was changed; export the network again")
    if (table.get("wiring", str), table.get("content", str)) != (vector.wiring, vector.content):
        raise FileFormatError(f"{CIRCUIT}: belongs to another network than {VECTOR}")


class _Runner:
    """Machine that starts at the initial state of a test vector."""

    def __init__(self, machine: Machine, places: Places, vector: ReferenceVector) -> None:
        self.machine, self.places, self.vector = machine, places, vector
        self.units = machine.scales[machine.integrators]
        self.signals = np.flatnonzero([e.kind != CONSTANT for e in machine.elements])

    def _states(self, x: np.ndarray) -> np.ndarray:
        """Return the states (P, N) in network units."""
        return self.places.unpack(self.units * x, self.vector.start)

    def after(self, start: np.ndarray, count: int, step: float) -> np.ndarray:
        """Return the states (P, N) after ``count`` steps from the start (P, N)."""
        x = self.places.pack(start) / self.units
        with np.errstate(all="ignore"):
            for _ in range(count):
                x = self.machine.within(x + step * self.machine.derivatives(x))
        return self._states(x)

    def settled(self, time: float) -> tuple[float, float]:
        """Return the distance to the vector's end after a time, and the largest element output."""
        from scipy.integrate import RK23

        machine, peak = self.machine, 0.0
        solver = RK23(
            lambda _, x: machine.derivatives(machine.within(x)),
            0.0,
            machine.start,
            time,
            rtol=1e-5,
            atol=1e-8,
        )
        with np.errstate(all="ignore"):
            while solver.status == "running" and solver.nfev < MOST:
                solver.step()
                values = machine.values(machine.within(solver.y))[self.signals]
                peak = max(peak, float(np.abs(values).max()))
        if solver.status != "finished":
            raise FileFormatError(f"{CIRCUIT}: the integration does not end")
        end = self.vector.end
        gap = np.abs(self._states(machine.within(solver.y)) - end).max()
        return float(gap / max(1.0, np.abs(end).max())), peak


def _count(elements: Sequence[Element]) -> dict[str, int]:
    return dict(Counter(e.kind for e in elements))


def _hash(table: Mapping) -> str:
    return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()
