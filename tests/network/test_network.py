"""Descriptions: what they say of themselves, and which ones are refused."""

import re

import numpy as np
import pytest
from designs import coordinated, designed, small
from hypothesis import given, settings, strategies as st

from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Sum, Template
from ann_dc.network.duals import PIDual
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.scale import Scale

X = Neuron(name="x")
LEAK = Connection(source="x", target="x", weight=-1.0)


def network() -> Network:
    return Network(cell=cell_of(), stages=3)


def cell_of(**fields) -> Cell:
    return Cell(**({"neurons": (X,), "connections": (LEAK,)} | fields))


BAD_ROWS = {
    "no stages": ({"stages": 0}, NetworkError, "stages: expected N >= 1, got 0"),
    "input without a value": ({"inputs": {}}, NetworkError, "inputs: no value for drive"),
    "nan input": ({"inputs": {"drive": np.nan}}, NetworkError, r"inputs\[drive\].*not finite"),
    "wrong length": ({"inputs": {"drive": [1, 2]}}, NetworkError, r"inputs\[drive\].*or 3"),
    "pin of no neuron": (
        {"fixed": (FixedNeuron(neuron="z", stage=0, input="drive"),)},
        NetworkError,
        "neuron='z'.*no such neuron or stage",
    ),
    "pin beyond the row": (
        {"fixed": (FixedNeuron(neuron="x", stage=3, input="drive"),)},
        NetworkError,
        "no such neuron or stage",
    ),
    "negative stage": ({"omitted": (Omitted(neuron="x", stage=-1),)}, NetworkError, "no such"),
    "pinned to no input": (
        {"fixed": (FixedNeuron(neuron="x", stage=0, input="x"),)},
        NetworkError,
        "'x' is not an input",
    ),
    "left end reads no input": ({"left_boundary": {"x": "y"}}, NetworkError, "'y' is not an input"),
    "start of no neuron": ({"start": {"z": 1.0}}, UnknownNameError, "start: neuron 'z'.*: x"),
    "start that is not finite": ({"start": {"x": np.inf}}, NetworkError, r"start\[x\]"),
}


@pytest.mark.parametrize("case", BAD_ROWS)
def test_bad_rows(case):
    fields, error, message = BAD_ROWS[case]
    good = {"cell": cell_of(inputs=("drive",)), "stages": 3, "inputs": {"drive": 1.0}}
    Network(**good)
    with pytest.raises(error, match=message):
        Network(**(good | fields))


CONTRADICTIONS = {
    "input that the cell does not have": {"inputs": {"drive": 1.0, "drvie": 2.0}},
    "left end of no node": {"left_boundary": {"z": "drive"}},
    "chain of no neuron": {"cell": cell_of(inputs=("drive",), chains=(("q", "t"),))},
    "dual of no neuron": {
        "cell": cell_of(
            inputs=("drive",), duals=(PIDual(neuron="mu", residual="c", multiplier="m"),)
        )
    },
    "rails the wrong way round": {
        "cell": cell_of(
            inputs=("drive",), neurons=(Neuron(name="x", limiter=Limiter(low=1, high=0)),)
        )
    },
    "rails that are not numbers": {
        "cell": cell_of(inputs=("drive",), neurons=(Neuron(name="x", limiter=Limiter(low=np.nan)),))
    },
    "scale of zero": {
        "cell": cell_of(inputs=("drive",), neurons=(Neuron(name="x", scale=Scale(0.0)),))
    },
    "one wire twice": {"cell": cell_of(inputs=("drive",), connections=(LEAK, LEAK))},
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_descriptions_that_contradict_themselves(case):
    good = {"cell": cell_of(inputs=("drive",)), "stages": 3, "inputs": {"drive": 1.0}}
    with pytest.raises((NetworkError, UnknownNameError)):
        Network(**(good | CONTRADICTIONS[case]))


def test_there_and_back_is_no_reach():
    cell = cell_of(
        blocks=(Sum(name="s"),),
        connections=(
            Connection(source="x", target="s", template=Template.NEXT),
            Connection(source="s", target="x", template=Template.PREVIOUS),
        ),
    )
    row = Network(cell=cell, stages=3)
    np.testing.assert_array_equal(evaluator(row).rhs([1.0, 2.0, 4.0]), [0.0, 2.0, 4.0])


# ---- names and states --------------------------------------------------------------------------


def test_labels_are_the_users_words():
    row = small("car")
    places = {row.label(i) for i in range(row.size)}
    assert len(places) == row.size
    assert {"q[1].x", "mu[3].phi", "u[0].nu", "t[2].varphi", "beta[1].y"} <= places
    assert not {"q[0].x", "t[3].x", "beta[0].x"} & places
    assert network().label(2) == "x[2]"


@pytest.mark.parametrize("name", ["car", "van_der_pol"])
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_pack_and_unpack_are_inverse(name, data):
    row = small(name, data.draw(st.sampled_from([SWITCHES["S14"], SWITCHES["S13"]])))
    seed = data.draw(st.integers(0, 1000))
    batch = data.draw(st.sampled_from([(), (3,), (2, 0)]))
    x = np.random.default_rng(seed).standard_normal((*batch, row.size))
    values = row.unpack(x)
    assert values.shape == (*batch, len(row.cell.neurons), row.stages)
    np.testing.assert_array_equal(row.pack(values), x)
    for pin in row.fixed:
        place = (..., row.neuron_index[pin.neuron], pin.stage)
        assert (values[place] == row.input_values[pin.input][pin.stage]).all()
    for absent in row.omitted:
        assert not values[..., row.neuron_index[absent.neuron], absent.stage].any()


def test_the_state_is_ordered_by_stage():
    assert (np.diff(small("car").places[:, 1]) >= 0).all()


def test_other_inputs():
    row = small("car")
    moved = row.with_inputs({"q_d.x": 3.0, "q_0.phi": [0.1, 0, 0, 0]})
    values = moved.unpack(np.zeros(row.size))
    users = {name: row.neuron(name).scale.user(values[i]) for name, i in row.neuron_index.items()}
    assert users["t.x"][-1] == pytest.approx(3.0, rel=1e-15)
    assert users["q.phi"][0] == pytest.approx(0.1, rel=1e-15)
    assert moved.inputs["q_d.y"][0] == 5.0
    assert row.inputs["q_d.x"][0] == 5.0
    assert moved.cell is row.cell
    with pytest.raises(UnknownNameError, match=r"input 'q_d.z' does not exist; choose.*q_d.varphi"):
        row.with_inputs({"q_d.z": 1.0})


def test_start_is_a_round_trip():
    row = small("car")
    x = np.random.default_rng(0).standard_normal(row.size)
    np.testing.assert_array_equal(row.with_start(x).start_state, x)
    assert not network().start_state.any()


def test_unknown_neuron_lists_those_that_exist():
    with pytest.raises(UnknownNameError, match=re.escape("neuron 'mu.z' does not exist")) as error:
        small("car").neuron("mu.z")
    assert "mu.phi" in str(error.value)
    assert small("car").neuron("mu.phi").population == "mu"


def test_arrays_are_read_only():
    row = small("car")
    with pytest.raises(ValueError, match="read-only"):
        row.inputs["q_d.x"][0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        coordinated("car").preconditioner.gains[0][0, 0, 0] = 1.0


def test_an_array_given_may_change_afterwards():
    drive = np.ones(3)
    row = Network(cell=cell_of(inputs=("drive",)), stages=3, inputs={"drive": drive})
    drive[:] = 7.0
    assert row.inputs["drive"].tolist() == [1.0, 1.0, 1.0]


# ---- what is printed ---------------------------------------------------------------------------


def test_print():
    text = str(designed("car").network)
    first, *rest = text.splitlines()
    assert first == "car: 9 cells of 4 q, 2 u, 4 t, 4 mu, 4 beta"
    table = {row[:22].strip(): row[22:].split(maxsplit=1) for row in rest}
    assert table["neurons"] == ["18", "150 live"]
    assert table["function blocks"] == ["3", "27"]
    network = designed("car").network
    wires = network.preconditioner.wires(network.layout)
    nodes, kind = table["preconditioner nodes"][1].split(", of the ")
    assert (int(nodes), kind) == (wires.nodes, network.preconditioner.kind.value)
    assert table["preconditioner wires"][1].split()[0] == str(wires.count)
    assert rest[-1] == "  functions: 1 cos, 1 sin, 1 tan"


def test_print_without_functions():
    assert "functions:" not in str(network())
    assert str(network()).startswith("network: 3 cells of 1 x\n")


def test_a_listing_tells_what_all_cells_share():
    network = Network(
        cell=Cell(neurons=(Neuron(name="x"), Neuron(name="y", shared=True))), stages=4
    )
    assert "1, in the last cell" in str(network)
    assert "shared" not in str(Network(cell=Cell(neurons=(Neuron(name="x"),)), stages=4))
    assert (network.size, network.state_index[1].tolist()) == (5, [4, 4, 4, 4])
