"""Files of an export, read with distrust: nothing of them is compiled or run."""

import hashlib
import json
from time import process_time

import numpy as np
import pytest
from fixed_points import walked
from seeds import seeds

from ann_dc.errors import AnnDcError, FileFormatError
from ann_dc.export.fixed_point.c99 import c99_check, c99_files
from ann_dc.export.fixed_point.hdl import hdl_check, hdl_files

NAME = "fixed_point.json"


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return c99_files(*walked("double_integrator"), bits=16)


def changed(files: dict[str, bytes], **entries) -> dict[str, bytes]:
    """Files whose integers are others, with the hash of these."""
    table = json.loads(files[NAME]) | entries
    table.pop("sha256")
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in table.items()]
    table["sha256"] = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    return {**files, NAME: json.dumps(table).encode()}


def test_a_missing_file_is_refused(files):
    for name in files:
        with pytest.raises(FileFormatError, match=name):
            c99_check({n: content for n, content in files.items() if n != name})


def test_a_file_too_many_is_refused(files):
    with pytest.raises(FileFormatError, match="evil"):
        c99_check({**files, "evil.c": b"int main(void) { return 0; }"})


@seeds(40)
def test_one_bit_of_any_file_is_found(files, seed):
    rng = np.random.default_rng(seed)
    name = sorted(files)[seed % len(files)]
    content = bytearray(files[name])
    content[rng.integers(len(content))] ^= 1 << int(rng.integers(7))
    with pytest.raises(AnnDcError):
        c99_check({**files, name: bytes(content)})


def test_weights_of_another_network_are_refused(files):
    other = c99_files(*walked("car"), bits=16)
    with pytest.raises(FileFormatError, match="differs from the network"):
        c99_check({**files, "reference_vector.json": other["reference_vector.json"]})
    with pytest.raises(FileFormatError):
        c99_check({**files, NAME: other[NAME]})


def test_c_and_hardware_are_not_mixed_up(files):
    with pytest.raises(FileFormatError):
        hdl_check(files)
    with pytest.raises(FileFormatError):
        c99_check(hdl_files(*walked("double_integrator"), bits=16))


def test_a_changed_coefficient_walks_elsewhere(files):
    edges = json.loads(files[NAME])["edges"]
    edges = [[word, coefficient // 2, exponent] for word, coefficient, exponent in edges]
    with pytest.raises(FileFormatError, match="integer steps differ"):
        c99_check(changed(files, edges=edges))


def test_an_error_that_is_too_good_is_refused(files):
    with pytest.raises(FileFormatError, match="away from the reference vector"):
        c99_check(changed(files, error=1e-12))


def test_integers_that_are_not_those_of_their_hash_are_refused(files):
    table = json.loads(files[NAME]) | {"accuracy": 0.5}
    with pytest.raises(FileFormatError, match=f"{NAME}: the file was changed"):
        c99_check({**files, NAME: json.dumps(table).encode()})


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        ({"edges": [[10**9, 1, 0]]}, "edges|operations"),
        ({"edges": []}, "operations"),
        ({"operations": [[9, 0, 0, 0, 0, -1]]}, "operations"),
        ({"operations": [[0, 10**6, 0, 0, 0, -1]]}, "operations"),
        ({"operations": [[0, 0, 0, 10**6, 0, -1]]}, "operations"),
        ({"operations": [[1, 0, -1, 0, 0, -1]]}, "operations"),
        ({"operations": [[2, 0, 5, 0, 0, -1]]}, "operations"),
        ({"operations": [[4, 0, 0, 0, 0, -1]]}, "operations"),
        ({"tables": [[0, 5, 2, 0]]}, "tables"),
        ({"tables": [[0, 5, 99, 0]]}, "tables"),
        ({"words": [0]}, "operations|neurons"),
        ({"schema": 4}, "schema"),
        ({"prefix": "1_evil"}, "evil"),
        ({"title": "another"}, "differs from"),
    ],
)
def test_a_machine_beyond_its_arrays_is_refused_by_name(files, entries, named):
    """Also with the hash of its integers: compiled code would read what is not its own."""
    with pytest.raises(FileFormatError, match=named):
        c99_check(changed(files, **entries))


JUNK = (
    None,
    True,
    -1,
    0,
    7,
    2**31,
    -(2**63),
    2**70,
    1e300,
    0.5,
    "",
    "x",
    "\ud800",
    [],
    [[]],
    {},
    [0],
)


def junk_in(entry, rng):
    """The entry with one thing somewhere within it replaced, lost or doubled."""
    if isinstance(entry, (list, dict)) and len(entry) and rng.random() < 0.85:
        places = list(entry) if isinstance(entry, dict) else range(len(entry))
        place = places[int(rng.integers(len(places)))]
        changed = entry.copy()
        if isinstance(entry, list) and rng.random() < 0.1:
            return entry[:place] + rng.choice([0, 2]) * [entry[place]] + entry[place + 1 :]
        changed[place] = junk_in(entry[place], rng)
        return changed
    return JUNK[int(rng.integers(len(JUNK)))]


@pytest.mark.parametrize("check", [c99_check, hdl_check])
def test_junk_is_loaded_equal_or_refused(check):
    """And nothing else is raised; most of it is not the JSON that its numbers are written as."""
    made = {c99_check: c99_files, hdl_check: hdl_files}[check](*walked("car"), bits=16)
    table, rng = json.loads(made[NAME]), np.random.default_rng(0)
    for _ in range(60):
        changed = junk_in(table, rng)
        begun = process_time()
        if changed != table:
            with pytest.raises(AnnDcError):
                check({**made, NAME: json.dumps(changed).encode()})
        assert process_time() - begun < 5
