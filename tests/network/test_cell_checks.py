"""Cells that are refused, and what the refusal says."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc.errors import AnnDcError, NetworkError, UnknownNameError
from ann_dc.network.cell import (
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
    Template,
    check_cell,
    per_stage,
)
from ann_dc.network.network import Network

X = Neuron(name="x")
LEAK = Connection(source="x", target="x", weight=-1.0)


def cell_of(**fields) -> Cell:
    return Cell(**({"neurons": (X,), "connections": (LEAK,)} | fields))


BAD_CELLS = {
    "same name twice": (cell_of(neurons=(X, X)), NetworkError, "duplicate names.*x"),
    "names that differ by case only": (
        cell_of(neurons=(X, Neuron(name="X"))),
        NetworkError,
        r"duplicate names \(case is ignored\): x",
    ),
    "an input called one": (cell_of(inputs=("one",)), NetworkError, "duplicate names.*one"),
    "a block named as a neuron": (cell_of(blocks=(Sum(name="x"),)), NetworkError, "duplicate"),
    "half of a letter": (
        cell_of(neurons=(X, Neuron(name="\ud800"))),
        NetworkError,
        r"name: '\\ud800' has a lone surrogate at 0",
    ),
    "zero tau": (cell_of(neurons=(Neuron(name="x", tau=0.0),)), NetworkError, "x: time constant"),
    "negative tau": (
        cell_of(neurons=(Neuron(name="x", tau=[1, 1, -1]),)),
        NetworkError,
        "time constant.*must be positive",
    ),
    "tau of the wrong length": (
        cell_of(neurons=(Neuron(name="x", tau=[1.0, 2.0]),)),
        NetworkError,
        r"x.tau: expected one number or 3",
    ),
    "infinite tau": (cell_of(neurons=(Neuron(name="x", tau=np.inf),)), NetworkError, "positive"),
    "nan tau": (cell_of(neurons=(Neuron(name="x", tau=np.nan),)), NetworkError, "positive"),
    "nan weight": (
        cell_of(connections=(replace(LEAK, weight=np.nan),)),
        NetworkError,
        "x<-x: nan is not finite",
    ),
    "weights of the wrong length": (
        cell_of(connections=(replace(LEAK, weight=[1.0, 2.0], template=Template.NEXT),)),
        NetworkError,
        "x<-x@next: expected one number or 3",
    ),
    "weight that is text": (
        cell_of(connections=(replace(LEAK, weight="strong"),)),
        NetworkError,
        "x<-x: expected one number",
    ),
    "unknown source": (
        cell_of(connections=(replace(LEAK, source="z"),)),
        NetworkError,
        "x<-z: source must be a node",
    ),
    "a product as target": (
        cell_of(
            blocks=(Product(name="p", a="x", b="x"),),
            connections=(Connection(source="x", target="p"),),
        ),
        NetworkError,
        "p<-x: .*target a neuron or a sum",
    ),
    "a loop of sums": (
        cell_of(
            blocks=(Sum(name="a"), Sum(name="b")),
            connections=(
                Connection(source="b", target="a"),
                Connection(source="a", target="b"),
            ),
        ),
        NetworkError,
        "a reads b before it is computed",
    ),
    "a block that reads itself": (
        cell_of(blocks=(Product(name="p", a="p", b="x"),)),
        NetworkError,
        "p reads p before",
    ),
    "wrong order": (
        cell_of(blocks=(Function(name="f", function="sin", x="g"), Sum(name="g"))),
        NetworkError,
        "f reads g before it is computed; list blocks in topological order",
    ),
    "unknown function": (
        cell_of(blocks=(Function(name="f", function="besselj", x="x"),)),
        UnknownNameError,
        "function block 'besselj' does not exist; choose one of: sin, cos",
    ),
}


@pytest.mark.parametrize("case", BAD_CELLS)
def test_bad_cells(case):
    cell, error, message = BAD_CELLS[case]
    with pytest.raises(error, match=message) as refusal:
        Network(cell=cell, stages=3, inputs=dict.fromkeys(cell.inputs, 0.0))
    assert isinstance(refusal.value, AnnDcError)


def test_a_title_is_a_text():
    with pytest.raises(NetworkError, match=r"title: 'a\\udfff' has a lone surrogate at 1"):
        Network(cell=cell_of(), stages=3, title="a\udfff")


def test_a_sound_cell_passes():
    check_cell(cell_of(neurons=(replace(X, limiter=Limiter(low=-1.0)),)), 3)


def test_one_number_a_stage():
    values = per_stage("drive", 2.0, 3)
    np.testing.assert_array_equal(values, [2.0, 2.0, 2.0])
    assert not values.flags.writeable
    np.testing.assert_array_equal(per_stage("drive", [1, 2, 3], 3), [1.0, 2.0, 3.0])
    with pytest.raises(NetworkError, match="drive: expected one number or 3 values"):
        per_stage("drive", [1, 2], 3)
