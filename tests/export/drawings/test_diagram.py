"""Diagrams of cells and rows: what is in them, and that it can be read."""

import json
import re
import time

import pytest
from drawn import MADE, Picture, cell_of, network_of

import ann_dc
from ann_dc.errors import ExportError
from ann_dc.export.drawings.cell_picture import cell_page
from ann_dc.export.drawings.chain_diagram import chain_page
from ann_dc.export.drawings.diagram import diagram_files
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Sum
from ann_dc.network.network import Network

QUICK = ["car", "planar_quadrotor", *MADE]
SLOW = [name for name in ann_dc.plants.names() if name not in QUICK]
NETWORKS = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
TOLD = {"title": "a picture"}


def assert_readable(picture: Picture) -> Picture:
    """No word on another, none outside, none too small on a page as wide as two columns."""
    assert picture.collisions() == []
    assert picture.outside() == []
    assert min(words.size for words in picture.words) >= 6
    assert picture.width == pytest.approx(180 / 25.4 * 72)
    return picture


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NETWORKS)
def test_a_cell_can_be_read(name):
    texts = [words.text for words in assert_readable(cell_of(name)).words]
    for neuron in network_of(name).cell.neurons:
        assert any(text.removeprefix("∫\u00a0 ").startswith(neuron.name) for text in texts)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NETWORKS)
def test_a_chain_can_be_read(name):
    assert_readable(Picture(chain_page(network_of(name)).svg(TOLD)))


@pytest.mark.parametrize("name", ["car", "rows"])
def test_every_wire_is_there_with_its_weight(name):
    """A row of a box for each wire, or its term in the one line of a node of a multiplier."""
    cell = network_of(name).cell
    texts = [words.text.replace("−", "-") for words in cell_of(name).words]
    for wire in cell.connections:
        said = f"{abs(float(wire.weight)):.3g}"
        if said != "1" and len(wire.source) < 16 and "*" not in wire.source:
            source = "" if wire.source == "one" else wire.source
            assert any(said in text and source in text for text in texts), wire.name


def test_what_comes_from_neighbours_and_goes_to_them(network):
    texts = [words.text for words in Picture(cell_page(network).svg(TOLD)).words]
    assert {"− t.x of k−1", "+ b.x of k+1", "t.x to k+1", "b.x to k−1"} <= set(texts)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("stages", "shown"), [(1, [0]), (3, [0, 1, 2]), (90, [0, 1, 89])])
def test_a_chain_shows_its_first_cells_and_its_last(stages, shown):
    network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=stages))
    picture = assert_readable(Picture(chain_page(network).svg(TOLD)))
    texts = [words.text for words in picture.words]
    assert [text for text in texts if text.startswith("cell ")] == [f"cell {k}" for k in shown]
    assert ("· · ·" in texts) == (stages > len(shown))
    assert any(text.startswith("q fixed at q_0") for text in texts)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["MULTILEVEL", "RESISTIVE_GRID", "CYCLIC_REDUCTION"])
def test_a_chain_shows_its_preconditioner(kind):
    problem = ann_dc.plants.double_integrator(N=9)
    network = ann_dc.design(problem, preconditioner=[ann_dc.PreconditionerKind[kind]]).network
    texts = [words.text for words in assert_readable(Picture(chain_page(network).svg(TOLD))).words]
    sign = {
        "MULTILEVEL": "nodes, 16 intervals",
        "RESISTIVE_GRID": "resistors",
        "CYCLIC_REDUCTION": "2 blocks, 1 remains",
    }
    assert any(sign[kind] in text for text in texts)


def odd_network() -> Network:
    """Names that nobody would choose, many inputs, a block that reads itself through a neuron."""
    long = "a_name_that_goes_on_and_on_for_no_good_reason"
    many = [f"given {i} äß" for i in range(40)]
    cell = Cell(
        neurons=(Neuron(name="$x$", limiter=Limiter(low=-1)), Neuron(name=f"{long}.<&>")),
        inputs=(*many, "p1"),
        blocks=(
            Product(name=long, a="$x$", b="p1"),
            Sum(name="everything"),
            Function(name=f"tanh of {long}", function="tanh", x="everything"),
        ),
        connections=(
            *(Connection(source=name, target="everything", weight=-1e-7) for name in many),
            Connection(source=long, target="$x$", weight=[1.0, -2.0, 3e9]),
            Connection(source=f"tanh of {long}", target=f"{long}.<&>"),
            Connection(source="one", target=f"{long}.<&>", weight=-2.5),
            Connection(source="$x$", target="$x$", weight=-1.0),
            Connection(source=f"{long}.<&>", target="$x$", template=-1),
        ),
    )
    return Network(cell=cell, stages=3, inputs=dict.fromkeys((*many, "p1"), 1.0), title=long * 4)


def test_any_names_and_any_wiring_can_be_read():
    picture = assert_readable(Picture(cell_page(odd_network()).svg(TOLD)))
    texts = [words.text for words in picture.words]
    assert "not below −1" in texts
    assert any(text.startswith("∫") and "$x$" in text for text in texts)
    assert_readable(Picture(chain_page(odd_network()).svg(TOLD)))


def test_very_long_names_are_cut_at_once():
    cell = Cell(neurons=tuple(Neuron(name=f"{letter * 4000}") for letter in "xyz"))
    begun = time.process_time()
    picture = Picture(chain_page(Network(cell=cell, stages=2)).svg(TOLD))
    assert time.process_time() - begun < 2
    texts = [words.text for words in assert_readable(picture).words]
    assert sum(text.endswith("…") and text.startswith("xxxx") for text in texts) == 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize("of", ["cell", "chain"])
def test_files_are_the_same_bytes_and_name_their_network(network, vector, of):
    files = diagram_files(network, vector, of=of)
    assert files == diagram_files(network, vector, of=of)
    assert sorted(files) == [f"{of}.pdf", f"{of}.svg", "reference_vector.json"]
    reported = json.loads(re.search(rb"<metadata>(.*)</metadata>", files[f"{of}.svg"])[1])
    assert (reported["of"], reported["wiring"], reported["content"]) == (
        of,
        vector.wiring,
        vector.content,
    )
    assert vector.content.encode() in files[f"{of}.pdf"]
    assert b"/FontFile2" in files[f"{of}.pdf"]
    assert b"DOCTYPE" not in files[f"{of}.svg"]


def test_what_cannot_be_drawn_is_refused(network, vector):
    with pytest.raises(ExportError, match="of: 'row' cannot be drawn; choose one of: cell, chain"):
        diagram_files(network, vector, of="row")
