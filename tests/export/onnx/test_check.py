"""Files that were changed, broken or made by somebody else."""

import hashlib
import time
from dataclasses import replace

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper
from seeds import seeds

from ann_dc.errors import FileFormatError
from ann_dc.export.onnx.check import onnx_check
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.vector import reference_vector

MODELS = ("step.onnx", "settle.onnx")


def sealed(model: onnx.ModelProto) -> bytes:
    """The model with the digest that belongs to it, as anybody can form it."""
    said = {entry.key: entry.value for entry in model.metadata_props if entry.key != "digest"}
    del model.metadata_props[:]
    helper.set_model_props(model, said)
    found = hashlib.sha256(model.SerializeToString(deterministic=True)).hexdigest()
    helper.set_model_props(model, said | {"digest": found})
    return model.SerializeToString(deterministic=True)


def changed(files, name: str, change) -> dict[str, bytes]:
    """The files with a change of one model, sealed."""
    model = onnx.load_model_from_string(files[name])
    change(model)
    return files | {name: sealed(model)}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Bits, pieces taken out, put in, or moved; or the end cut off."""
    text, at = bytearray(content), int(rng.integers(len(content)))
    length = int(rng.integers(1, 40))
    match int(rng.integers(5)):
        case 0:
            text[at] ^= 1 << int(rng.integers(8))
        case 1:
            del text[at:]
        case 2:
            del text[at : at + length]
        case 3:
            text[at:at] = rng.bytes(length)
        case 4:
            other = int(rng.integers(len(content)))
            text[at : at + length] = text[other : other + length]
    return bytes(text)


def test_what_was_exported_is_found_right(files):
    said = onnx_check(files)
    assert said.startswith("50 steps in onnxruntime (float64) within ")
    assert "settled after 191 steps, the vector after 191, its end within " in said


def test_in_float32_too(car, vector):
    assert "float32" in onnx_check(onnx_files(car, vector, precision="float32"))


def test_a_vector_that_never_settles_is_compared_as_far_as_it_goes(car, vector):
    lost = replace(vector, steps=-1)
    assert onnx_check(onnx_files(car, lost)).endswith("which does not settle")


@seeds(60)
@pytest.mark.sampled
def test_a_mutated_file_is_refused(files, seed):
    rng = np.random.default_rng(seed)
    name = MODELS[seed % 2]
    content = mutated(files[name], rng)
    assert content != files[name]
    with pytest.raises(FileFormatError):
        onnx_check(files | {name: content})


def resealed(files, seed: int) -> dict[str, bytes]:
    rng, name = np.random.default_rng(seed), MODELS[seed % 2]
    while True:
        try:
            model = onnx.load_model_from_string(mutated(files[name], rng))
            return files | {name: sealed(model)}
        except Exception:  # no model any more: the next one
            continue


@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(12, 600), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_one_whose_digest_was_made_anew_is_no_worse(files, seeds):
    """What is right after all had a change in a word, or in a digit that counts for nothing."""
    refused = 0
    for seed in seeds:
        try:
            assert "within" in onnx_check(resealed(files, seed))
        except FileFormatError:
            refused += 1
    assert refused >= len(seeds) // 2


@pytest.mark.parametrize("name", MODELS)
def test_a_changed_weight_is_found_by_the_comparison(files, name):
    def change(model):
        table = next(t for t in model.graph.initializer if t.name.startswith("tau.mu"))
        values = numpy_helper.to_array(table) * 1.01
        table.CopyFrom(numpy_helper.from_array(values, table.name))

    with pytest.raises(FileFormatError, match=r"differ by|beside the reference"):
        onnx_check(changed(files, name, change))


def external(model):
    table = next(t for t in model.graph.initializer if t.name.startswith("tau."))
    table.data_location = onnx.TensorProto.EXTERNAL
    table.ClearField("raw_data")
    entry = table.external_data.add()
    entry.key, entry.value = "location", "/etc/hostname"


def unknown_operation(model):
    model.graph.node[0].op_type = "Det"


def other_domain(model):
    model.graph.node[0].domain = "com.example"


def a_table_inside(model):
    attribute = helper.make_attribute("value", numpy_helper.from_array(np.zeros(3)))
    model.graph.node[0].attribute.append(attribute)


def a_function(model):
    model.functions.append(
        helper.make_function("com.example", "f", ["x"], ["y"], [], [helper.make_opsetid("", 18)])
    )


def a_huge_shape(model):
    table = next(t for t in model.graph.initializer if t.name.startswith("integers"))
    table.CopyFrom(numpy_helper.from_array(np.array([2**40]), table.name))


def other_inputs(model):
    model.graph.input[0].name = "x"


def other_outputs(model):
    model.graph.output[0].name = "x"


def another_size(model):
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value += 1


def another_content(model):
    entry = next(entry for entry in model.metadata_props if entry.key == "content")
    entry.value = "0" * 64


def no_inputs_named(model):
    entry = next(entry for entry in model.metadata_props if entry.key == "inputs")
    entry.value = "{"


def other_inputs_named(model):
    entry = next(entry for entry in model.metadata_props if entry.key == "inputs")
    entry.value = "[]"


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (external, "stores its numbers in another file"),
        (unknown_operation, "'Det' is not used by exports"),
        (other_domain, "is not used by exports"),
        (a_table_inside, "has local tensors"),
        (a_function, "expected a graph only, got functions or training"),
        (a_huge_shape, "reaches beyond the states"),
        (other_inputs, "expected the inputs states, inputs, step"),
        (other_outputs, "expected the outputs"),
        (another_size, "expected states"),
        (another_content, "of another network"),
        (no_inputs_named, "metadata"),
        (other_inputs_named, "not those of the reference vector"),
    ],
)
def test_what_is_wrong_is_told(files, name, change, said):
    with pytest.raises(FileFormatError, match=said):
        onnx_check(changed(files, name, change))


@pytest.mark.parametrize("name", [*MODELS, "reference_vector.json"])
def test_a_missing_file_is_told(files, name):
    rest = {other: content for other, content in files.items() if other != name}
    with pytest.raises(FileFormatError, match=f"{name}: missing"):
        onnx_check(rest)


@pytest.mark.parametrize("content", [b"", b"\0" * 100, b"\xff" * 100, b"onnx"])
def test_what_is_no_model_is_refused(files, content):
    with pytest.raises(FileFormatError, match=r"step\.onnx"):
        onnx_check(files | {"step.onnx": content})


def test_a_file_that_is_too_large_is_not_parsed(files):
    with pytest.raises(FileFormatError, match="larger than"):
        onnx_check(files | {"step.onnx": bytes(2**28 + 1)})


def test_models_of_two_networks_do_not_mix(car, files):
    moved = car.with_inputs({"q_d.x": 4.0})
    other = onnx_files(moved, reference_vector(moved))
    with pytest.raises(FileFormatError, match="of another network"):
        onnx_check(files | {"settle.onnx": other["settle.onnx"]})


def test_models_of_two_precisions_do_not_mix(car, vector, files):
    other = onnx_files(car, vector, precision="float32")
    with pytest.raises(FileFormatError, match="the precisions differ"):
        onnx_check(files | {"settle.onnx": other["settle.onnx"]})


def before(graph, output: str, *nodes) -> None:
    """Put nodes between an output and what it was the value of."""
    [last] = [node for node in graph.node if output in node.output]
    nodes[0].input.insert(0, last.input[0])
    last.input[0] = nodes[-1].output[0]
    rest = [node for node in graph.node if node is not last]
    kept = [*rest, *nodes, last]
    del graph.node[:]
    graph.node.extend(kept)


@pytest.mark.parametrize("name", MODELS)
def test_a_small_file_that_asks_for_a_large_tensor_is_not_run(files, name):
    """With no number in it that is large by itself, and the result the same."""

    def swells(model):
        tables = {"big": np.array([200, 200, 200, 4, 1]), "axes": np.arange(4)}
        model.graph.initializer.extend(numpy_helper.from_array(t, n) for n, t in tables.items())
        large = helper.make_node("Expand", ["big"], ["large"])
        small = helper.make_node("ReduceMax", ["large", "axes"], ["small"], keepdims=0)
        before(model.graph, "residual", large, small)

    begun = time.process_time()
    with pytest.raises(FileFormatError, match="'large' is large, or of unknown size"):
        onnx_check(changed(files, name, swells))
    assert time.process_time() - begun < 1.0


def body_of(model):
    [loop] = [node for node in model.graph.node if node.op_type == "Loop"]
    return loop, loop.attribute[0].g


def grows_in_the_body(model):
    grown = helper.make_node("Concat", [], ["grown"], axis=-1)
    _, body = body_of(model)
    before(body, body.output[1].name, grown)
    [grown] = [node for node in body.node if node.output[0] == "grown"]
    grown.input.append(grown.input[0])


def turns_for_ever(model):
    body_of(model)[0].input[0] = ""


def turns_as_often_as_a_product(model):
    loop, _ = body_of(model)
    [turns] = [node for node in model.graph.node if loop.input[0] in node.output]
    turns.op_type = "Mul"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (grows_in_the_body, "grows with the iterations"),
        (turns_for_ever, "loop has no limit"),
        (turns_as_often_as_a_product, "loop has no limit"),
    ],
)
def test_a_loop_ends_and_keeps_its_size(files, change, said):
    with pytest.raises(FileFormatError, match=said):
        onnx_check(changed(files, "settle.onnx", change))
