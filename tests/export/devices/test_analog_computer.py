"""Circuits for analog computers: the list alone, element by element, against the network."""

import hashlib
import json
import math
from collections import defaultdict
from dataclasses import replace
from functools import cache

import constrained
import minimax
import numpy as np
import pytest
from clamped_runs import with_limits
from designs import wired_with
from hypothesis import given, settings, strategies as st
from random_networks import free_of_coupled_limits, random_network
from scipy.integrate import solve_ivp

import ann_dc
from ann_dc.errors import ExportError, FileFormatError
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.devices.analog_computer import analog_computer_check, analog_computer_files
from ann_dc.export.devices.elements import Machine, elements_of
from ann_dc.export.reference.vector import reference_vector
from ann_dc.lowering.stiffness_sums import reduction, substitution
from ann_dc.lowering.writing import program_of
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

FUNCTIONS = {"sin": math.sin, "cos": math.cos, "tan": math.tan, "rectify": lambda x: max(x, 0.0)}


def circuit_of(files) -> dict:
    return json.loads(files["analog_computer.json"])


class Loops:
    """The list as loops over its elements, one after the other."""

    def __init__(self, circuit) -> None:
        self.elements = circuit["elements"]
        self.wires = defaultdict(list)
        for target, source, coefficient, gain in circuit["matrix"]:
            self.wires[target].append((source, coefficient * gain))
        self.start = [e["start"] for e in self.elements if e["kind"] == "integrator"]

    def values(self, x) -> list[float]:
        said = list(x)
        for place, e in enumerate(self.elements[len(said) :], len(said)):
            said.append(self._value(place, e, said))
        return said

    def _value(self, place, e, said) -> float:
        read = [said[p] for p in e.get("reads", ())]
        if e["kind"] == "constant":
            return e["value"]
        if e["kind"] == "sum":
            return sum(c * said[p] for p, c in self.wires[place])
        if e["kind"] == "product":
            return read[0] * read[1]
        argument = read[0] * self.elements[e["reads"][0]]["scale"]
        return FUNCTIONS[e["function"]](argument) / e["scale"]

    def _stands(self, place, x, push) -> bool:
        ends = self.elements[place]
        low, high = ends.get("low", -math.inf), ends.get("high", math.inf)
        return (x <= low and push < 0) or (x >= high and push > 0)

    def derivatives(self, x) -> list[float]:
        said = self.values(x)
        derivatives = [sum(c * said[p] for p, c in self.wires[i]) for i in range(len(x))]
        return [0.0 if self._stands(i, x[i], m) else m for i, m in enumerate(derivatives)]


CASES = {
    "functions": (ann_dc.plants.pendulum(N=4), {}),
    "pyramid": (
        ann_dc.plants.unicycle(N=4),
        {"preconditioner": ann_dc.PreconditionerKind.MULTILEVEL},
    ),
    "time constants": (
        ann_dc.plants.car(N=3),
        {"preconditioner": ann_dc.PreconditionerKind.DIAGONAL},
    ),
    "tree": (
        ann_dc.plants.car(N=4),
        {"preconditioner": ann_dc.PreconditionerKind.CYCLIC_REDUCTION},
    ),
    "shared neurons": (minimax.small(4), {}),
    "inequalities": (constrained.integrator(N=5, dt=0.6, bounds={constrained.v: (None, 0.6)}), {}),
}


@cache
def exported(case):
    """A network, its vector, and its files."""
    problem, settings = CASES[case]
    network = ann_dc.design(problem, **settings).network
    vector = reference_vector(network)
    return network, vector, analog_computer_files(network, vector)


@pytest.mark.parametrize(
    "case",
    [c if c in ("functions", "tree") else pytest.param(c, marks=pytest.mark.slow) for c in CASES],
)
def test_the_list_alone_settles_where_the_network_does(case):
    network, vector, files = exported(case)
    circuit = circuit_of(files)
    loops, beta = Loops(circuit), circuit["time_scale"]
    x, step = np.array(loops.start), vector.step * beta
    for _ in range(50):
        x = x + step * np.array(loops.derivatives(x))
        for i, e in enumerate(circuit["elements"][: len(x)]):
            x[i] = min(max(x[i], e.get("low", -math.inf)), e.get("high", math.inf))
    units = np.array([e["scale"] for e in circuit["elements"][: len(x)]])
    np.testing.assert_allclose(units * x, network.pack(vector.early[50]), rtol=0, atol=1e-10)
    if case == "functions":
        time = 1.5 * vector.steps * step
        run = solve_ivp(
            lambda _, x: loops.derivatives(x), (0, time), loops.start, method="LSODA", rtol=1e-8
        )
        end = network.pack(vector.end)
        np.testing.assert_allclose(units * run.y[:, -1], end, atol=1e-4 * np.abs(end).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", CASES)
def test_its_check_integrates_to_the_end(case):
    found = analog_computer_check(exported(case)[2])
    assert "of its end" in found
    assert 0.3 < float(found.split(" of its end, ")[1].split()[0]) < 1


@pytest.mark.parametrize("largest", [1.0, 10.0])
def test_everything_is_within_machine_units(largest):
    network = ann_dc.design(ann_dc.plants.car()).network
    vector = reference_vector(network)
    circuit = circuit_of(analog_computer_files(network, vector, largest=largest, headroom=2.0))
    coefficients, gains = np.array(circuit["matrix"])[:, 2:].T
    assert np.abs(coefficients).max() <= 1
    assert set(gains) <= {1.0, largest}
    loops = Loops(circuit)
    places = network.places
    for states in (vector.start, *vector.early.values(), vector.end):
        units = [e["scale"] for e in circuit["elements"][: network.size]]
        said = loops.values(states[places[:, 0], places[:, 1]] / units)
        signals = [v for v, e in zip(said, circuit["elements"]) if e["kind"] != "constant"]
        assert max(map(abs, signals)) <= 0.75
    at_integrators = np.abs(coefficients * gains)[np.array(circuit["matrix"])[:, 0] < network.size]
    assert at_integrators.max() == pytest.approx(largest)


@pytest.mark.parametrize(
    "kind", [ann_dc.PreconditionerKind.RESISTIVE_GRID, ann_dc.PreconditionerKind.CYCLIC_REDUCTION]
)
def test_rails_of_coupled_neurons_are_refused_by_name(kind):
    network = with_limits(wired_with("double_integrator", kind), 0.5, "u")
    vector = reference_vector(network)
    with pytest.raises(
        ExportError, match=rf"its {kind.value} couples neurons with saturation limits \(u\.a\)"
    ):
        analog_computer_files(network, vector)


def test_neurons_that_no_preconditioner_couples_stop_at_their_rails():
    problem = ann_dc.plants.double_integrator(N=4)
    bounded = replace(problem, bounds={problem.controls[0]: (-27, 27)})
    network = ann_dc.design(bounded, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL).network
    vector = reference_vector(network)
    controls = network.of_population("u")
    limit = network.neuron("u.a").limiter.high
    stands = np.abs(network.pack(vector.end)[controls]) == limit
    np.testing.assert_array_equal(stands, [True, False, False, True])
    files = analog_computer_files(network, vector)
    assert [e.get("high") is None for e in circuit_of(files)["elements"][: network.size]] == (
        ~controls
    ).tolist()
    assert "of its end" in analog_computer_check(files)


def test_elements_are_counted():
    network = ann_dc.design(ann_dc.plants.pendulum(N=4)).network
    circuit = circuit_of(analog_computer_files(network, reference_vector(network)))
    kinds = [e["kind"] for e in circuit["elements"]]
    assert circuit["count"] == {kind: kinds.count(kind) for kind in set(kinds)}
    assert circuit["count"]["integrator"] == network.size
    blocks = [b for b in network.cell.blocks if type(b).__name__ == "Function"]
    # the cosine of the first cell would be read only by the state q_0, which is fixed
    assert circuit["count"]["function"] == 4 * len(blocks) - 1


@pytest.mark.parametrize("case", ["functions", "tree", "shared neurons"])
def test_every_element_is_read_by_another_one(case):
    circuit = circuit_of(exported(case)[2])
    read = {source for _, source, _, _ in circuit["matrix"]}
    read |= {place for e in circuit["elements"] for place in e.get("reads", ())}
    others = range(circuit["count"]["integrator"], len(circuit["elements"]))
    assert set(others) <= read


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(ann_dc.PreconditionerKind),
    st.sampled_from((substitution, reduction)),
)
def test_elements_of_a_random_network_move_as_the_network(seed, kind, solve):
    network = free_of_coupled_limits(random_network(seed, kind))
    labels = [network.label(i) for i in range(network.size)]
    machine = Machine(elements_of(program_of(network, 1.0, solve), labels))
    noise = np.random.default_rng(seed).standard_normal(network.size)
    x = machine.within(network.start_state + 0.1 * noise)
    expected = evaluator(network).rhs(x)
    np.testing.assert_allclose(
        machine.derivatives(x), expected, atol=1e-12 * np.abs(expected).max()
    )


@pytest.fixture(scope="module")
def files():
    network = ann_dc.design(ann_dc.plants.pendulum(N=3)).network
    return analog_computer_files(network, reference_vector(network))


@pytest.mark.parametrize("option", ["largest", "headroom"])
def test_options_below_one_are_refused(option):
    network = ann_dc.design(ann_dc.plants.pendulum(N=3)).network
    with pytest.raises(ExportError, match=option):
        analog_computer_files(network, reference_vector(network), **{option: 0.5})


def test_a_network_that_does_not_settle_is_refused():
    grows = Connection(source="x", target="x", weight=1.0)
    network = Network(
        cell=Cell(neurons=(Neuron(name="x"),), connections=(grows,)), stages=1, start={"x": 1.0}
    )
    with pytest.raises(ExportError, match="diverged"):
        analog_computer_files(network, reference_vector(network))


def test_one_changed_bit_is_refused(files):
    text = files["analog_computer.json"].decode()
    value = repr(circuit_of(files)["matrix"][5][2])
    other = repr(float(np.nextafter(float(value), 2)))
    with pytest.raises(FileFormatError, match="the file was changed"):
        analog_computer_check(
            {**files, "analog_computer.json": text.replace(value, other).encode()}
        )


def rehashed(files, change) -> dict[str, bytes]:
    """A circuit that was changed by somebody who knows how to hash it."""
    circuit = circuit_of(files)
    change(circuit)
    plain = {k: v for k, v in circuit.items() if k not in ("format", "schema", "sha256")}
    circuit["sha256"] = hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
    return {**files, "analog_computer.json": json.dumps(circuit).encode()}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda c: c["matrix"].append([0, 10**6, 0.5, 1.0]), "IndexError"),
        (lambda c: c["matrix"].append([10**6, 0, 0.5, 1.0]), "IndexError"),
        (lambda c: c["matrix"].append([0, 0, 2.0, 1.0]), "differ"),
        (lambda c: c["matrix"].append([0, 0]), "ValueError"),
        (lambda c: c["matrix"].append([0, 0, "x", 1.0]), "TypeError"),
        (lambda c: c["matrix"].append([0, 1, 0.9, 10.0]), "differ"),
        (lambda c: c["elements"].append({"kind": "sum"}), "missing"),
        (lambda c: c["elements"].append({"kind": "lamp", "name": "l", "scale": 1.0}), "count"),
        (lambda c: c["elements"].append(c["elements"][0]), "count"),
        (lambda c: c["elements"].append(
            {"kind": "function", "name": "f", "scale": 1.0, "reads": [0], "function": "gamma"}
        ), "gamma"),
        (lambda c: c["elements"].append(
            {"kind": "product", "name": "p", "scale": 1.0, "reads": [0, 10**7]}
        ), "IndexError"),
        (lambda c: c["places"].pop(), "one per integrator"),
        (lambda c: c["places"].__setitem__(0, [[0, -1]]), "places in arrays of shape"),
        (lambda c: c.update(time_scale=0.0), "time_scale"),
        (lambda c: c.update(elements=[], matrix=[], count={}), "run|one per integrator"),
        (lambda c: c["matrix"][0].__setitem__(3, 1e6), "differ"),
        (lambda c: c["count"].update(sum=1000), "count"),
        (lambda c: c.update(content="0" * 64), "another network"),
    ],
)  # fmt: skip
def test_what_is_no_circuit_is_refused(files, change, named):
    with pytest.raises(FileFormatError, match=named):
        FORMATS["analog_computer"].check(rehashed(files, change))
