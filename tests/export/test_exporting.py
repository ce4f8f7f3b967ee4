"""Exports into folders: whole files, one writer, an index that fits or tells that it does not."""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from designs import designed

from ann_dc.errors import ExportError, FileFormatError, NetworkError, OutputError, UnknownNameError
from ann_dc.export.catalogue import FORMATS, inspect_export
from ann_dc.export.exporting import export_network, settings_from
from ann_dc.files import Lock
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

FORMAT = "conductances"
"""One with several files that needs no package."""


@pytest.fixture(scope="module")
def network():
    return designed("double_integrator").network


def contents(folder):
    return {f.name: f.read_bytes() for f in folder.iterdir() if not f.name.startswith(".")}


def test_every_format_has_a_folder_with_its_index(network, tmp_path):
    done = export_network(network, [FORMAT, "diagram"], tmp_path)
    assert [each.name for each in done] == [FORMAT, "diagram"]
    for each in done:
        assert each.folder == tmp_path / each.name
        assert {file.name for file in each.files} == {file.name for file in each.folder.iterdir()}
        assert each.files[-1].name == "export.json"
    assert all(found.good for found in inspect_export(tmp_path))


def test_equal_networks_give_equal_bytes(network, tmp_path):
    for name in ("a", "b"):
        export_network(network, FORMAT, tmp_path / name)
    assert contents(tmp_path / "a" / FORMAT) == contents(tmp_path / "b" / FORMAT)


def test_a_second_export_takes_the_place_of_the_first(network, tmp_path):
    mine = tmp_path / FORMAT / "mine.txt"
    export_network(network, FORMAT, tmp_path)
    mine.write_text("kept")
    index = tmp_path / FORMAT / "export.json"
    table = json.loads(index.read_text())
    old = b"of an export that had it"
    table["files"] |= {"old.csv": hashlib.sha256(old).hexdigest(), "thesis.tex": "0" * 64}
    index.write_text(json.dumps(table))
    (tmp_path / FORMAT / "old.csv").write_bytes(old)
    (tmp_path / FORMAT / "thesis.tex").write_text("of the user, whatever the index says")
    export_network(network.with_inputs({"q_d.x": 2.0}), FORMAT, tmp_path)
    assert not (tmp_path / FORMAT / "old.csv").exists()
    assert (tmp_path / FORMAT / "thesis.tex").exists()
    assert mine.read_text() == "kept"
    assert inspect_export(tmp_path)[0].good


@pytest.mark.parametrize("name", ["export.json", f"{FORMAT}.csv", ".lock"])
def test_nothing_is_written_where_a_link_leads(network, tmp_path, name):
    outside = tmp_path / "outside.txt"
    outside.write_text("precious")
    export_network(network, FORMAT, tmp_path)
    (tmp_path / FORMAT / name).unlink(missing_ok=True)
    (tmp_path / FORMAT / name).symlink_to(outside)
    with pytest.raises(OutputError, match=f"{name}' is a link"):
        export_network(network, FORMAT, tmp_path)
    assert outside.read_text() == "precious"


def test_nothing_is_removed_where_a_link_leads(network, tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "a.txt").write_text("precious")
    export_network(network, FORMAT, tmp_path)
    (tmp_path / FORMAT / "library").symlink_to(tmp_path / "outside")
    index = tmp_path / FORMAT / "export.json"
    table = json.loads(index.read_text())
    table["files"]["library/a.txt"] = hashlib.sha256(b"precious").hexdigest()
    index.write_text(json.dumps(table))
    export_network(network, FORMAT, tmp_path)
    assert (tmp_path / "outside" / "a.txt").exists()


@pytest.mark.parametrize("name", [".lock", "export.json", f"{FORMAT}.csv"])
def test_a_folder_where_a_file_is_needed_is_told(network, tmp_path, name):
    (tmp_path / FORMAT / name).mkdir(parents=True)
    with pytest.raises(OutputError, match=r"cannot be written \(Is a directory\)"):
        export_network(network, FORMAT, tmp_path)


def test_folders_that_look_like_parts_stay(network, tmp_path):
    (tmp_path / FORMAT / ".x.part").mkdir(parents=True)
    (tmp_path / FORMAT / ".export.json.1.part").mkdir()
    (tmp_path / FORMAT / ".export.json.2.part").write_text("half")
    export_network(network, FORMAT, tmp_path)
    parts = (tmp_path / FORMAT).glob(".*.part")
    assert {part.name for part in parts} == {".x.part", ".export.json.1.part"}


@pytest.mark.parametrize("name", ["export.json", f"{FORMAT}.csv"])
def test_files_that_no_export_wrote_stay(network, tmp_path, name):
    mine = tmp_path / FORMAT / name
    mine.parent.mkdir()
    mine.write_text('{"mine": true}')
    with pytest.raises(OutputError, match=rf"{name}' already exists.*move it"):
        export_network(network, FORMAT, tmp_path)
    assert [file.name for file in mine.parent.iterdir()] == [name]
    assert mine.read_text() == '{"mine": true}'


def test_nobodys_name_stays_in_a_folder(network, tmp_path):
    [done] = export_network(network, FORMAT, tmp_path)
    assert {file.name for file in done.folder.iterdir()} == {file.name for file in done.files}


@pytest.mark.parametrize("name", ["weights", "csv", "conductances", "latex", "c99"])
def test_every_folder_says_what_is_in_it(network, tmp_path, name):
    [done] = export_network(network, name, tmp_path)
    said = (done.folder / "README.md").read_text()
    assert said.startswith("# ")
    assert inspect_export(done.folder)[0].good


def test_two_at_a_time_do_not_mix(network, tmp_path):
    export_network(network, FORMAT, tmp_path)
    before = contents(tmp_path / FORMAT)
    lock = Lock(tmp_path / FORMAT / ".lock")
    with pytest.raises(OutputError, match=f"process {os.getpid()} .* writing to"):
        export_network(network.with_inputs({"q_d.x": 2.0}), FORMAT, tmp_path)
    lock.release()
    assert contents(tmp_path / FORMAT) == before


def test_names_that_are_none_are_told_with_those_that_are(network, tmp_path):
    with pytest.raises(UnknownNameError, match=rf"format 'nix'.*all, .*{FORMAT}"):
        export_network(network, [FORMAT, "nix"], tmp_path)
    with pytest.raises(UnknownNameError, match="format 'nix'"):
        export_network(network, ["all", "nix"], tmp_path)
    with pytest.raises(UnknownNameError, match="'decade' does not exist; did you mean 'decades'"):
        export_network(network, FORMAT, tmp_path, decade=3.0)
    assert not list(tmp_path.iterdir())


def test_settings_are_read_as_the_formats_have_them():
    assert settings_from([FORMAT], {"decades": "3", "levels": "16", "folded": "true"}) == {
        "decades": 3.0, "levels": 16, "folded": True,
    }  # fmt: skip
    with pytest.raises(ExportError, match="levels: expected a whole number, got 'many'"):
        settings_from([FORMAT], {"levels": "many"})
    with pytest.raises(ExportError, match="precision: expected float64 or float32, got 'float16'"):
        settings_from(["onnx"], {"precision": "float16"})


@pytest.mark.parametrize("name", FORMATS)
def test_every_setting_can_be_given_in_words(name):
    """A default, as the list of formats shows it, is read as the default."""
    for key, parameter in FORMATS[name].settings.items():
        word = str(parameter.default).lower()
        assert settings_from([name], {key: word}) == {key: parameter.default}


@pytest.mark.slow
def test_what_cannot_be_carried_is_an_error_alone_and_a_sentence_among_others(tmp_path):
    network = designed("cart_pole").network
    with pytest.raises(ExportError, match="decades") as alone:
        export_network(network, FORMAT, tmp_path)
    done = export_network(network, [FORMAT, "diagram"], tmp_path)
    assert done[0].why_not == str(alone.value)
    assert not done[0].files
    assert done[1].files


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("failure", "reported"),
    [
        (FileFormatError("a card is none"), "a card is none"),
        (ZeroDivisionError("by nothing"), "ZeroDivisionError: by nothing"),
    ],
)
@pytest.mark.parametrize("part", ["write", "run"])
def test_a_failure_of_any_kind_keeps_the_others(
    network, tmp_path, monkeypatch, failure, reported, part
):
    def fails(*given, **settings):
        raise failure

    monkeypatch.setitem(FORMATS, FORMAT, replace(FORMATS[FORMAT], **{part: fails}))
    done = export_network(network, [FORMAT, "diagram"], tmp_path)
    assert reported in done[0].why_not
    assert not (tmp_path / FORMAT).exists()
    assert done[1].files
    with pytest.raises((ExportError, type(failure)), match=reported.rpartition(": ")[2]):
        export_network(network, FORMAT, tmp_path)


def test_a_folder_in_use_keeps_the_others(network, tmp_path):
    (tmp_path / FORMAT).write_text("")
    done = export_network(network, [FORMAT, "diagram"], tmp_path)
    assert "a file has the name of the folder" in done[0].why_not
    assert done[1].files


def test_what_is_written_was_checked(network, tmp_path):
    [done] = export_network(network, FORMAT, tmp_path, levels=2)
    [found] = inspect_export(tmp_path)
    assert done.worth == found.facts["checked"]
    assert "does not settle" in done.worth


def test_a_folder_that_cannot_be_written_is_told(network, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="a file has the name of the folder"):
        export_network(network, FORMAT, tmp_path / "file")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_says_what_it_is(name):
    form = FORMATS[name]
    assert form.title
    assert form.carries
    assert form.loses
    assert all(p.default is not p.empty for p in form.settings.values())


# ---- interrupted -----------------------------------------------------------------------------

DRIVER = """
import sys, itertools
from pathlib import Path
import ann_dc
from ann_dc.export import export_network
network = ann_dc.load(sys.argv[1])
others = [network, network.with_inputs({"q_d.x": 2.0})]
print("begun", flush=True)
for other in itertools.cycle(others):
    export_network(other, sys.argv[3], sys.argv[2])
"""


def killed_exports(network, folder, kills: int) -> int:
    """How often an interrupted export was told as one."""
    import ann_dc

    weights, out = folder / "network.npz", folder / "out"
    ann_dc.save(network, weights)
    whole = {}
    for given in (network, network.with_inputs({"q_d.x": 2.0})):
        export_network(given, FORMAT, folder / "whole")
        for name, content in contents(folder / "whole" / FORMAT).items():
            whole.setdefault(name, set()).add(content)
    rng, reported = random.Random(0), 0
    for _ in range(kills):
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, str(weights), str(out), FORMAT],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert driver.stdout is not None
        assert driver.stdout.readline() == "begun\n"
        time.sleep(rng.uniform(0.05, 0.5))
        driver.send_signal(signal.SIGKILL)
        driver.wait()
        driver.stdout.close()
        if not (out / FORMAT).is_dir():
            continue
        for name, content in contents(out / FORMAT).items():
            assert content in whole[name], name
        if (out / FORMAT / "export.json").exists():
            [found] = inspect_export(out)
            reported += not found.good
            assert found.good or "interrupted" in found.wrong or "does not exist" in found.wrong
    export_network(network, FORMAT, out)
    assert inspect_export(out)[0].good
    assert not list((out / FORMAT).glob(".*.part"))
    return reported


@pytest.mark.slow
def test_killed_exports_leave_whole_files(network, tmp_path):
    killed_exports(network, tmp_path, 2)


@pytest.mark.slow
def test_fifty_killed_exports_leave_whole_files(network, tmp_path):
    killed_exports(network, tmp_path, 50)


def test_networks_only(tmp_path):
    with pytest.raises((NetworkError, TypeError), match="network"):
        export_network("car", FORMAT, tmp_path)


def test_far_wires_end_no_export_of_the_others(tmp_path):
    """A value from two cells away: most formats hold it, and the rest say why they do not."""
    wires = [
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="x", target="x", weight=0.3, template=2),
        Connection(source="load", target="x"),
    ]
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("load",), connections=tuple(wires))
    network = Network(cell=cell, stages=4, inputs={"load": 0.5}, title="far")
    names = ["weights", "csv", "conductances", "analog_computer", "diagram", "latex", "c99"]
    done = {each.name: each for each in export_network(network, names, tmp_path)}
    assert {name for name in names if done[name].why_not} == set()
    assert all(found.good for found in inspect_export(tmp_path))


@pytest.mark.skipif(os.name == "nt", reason="Windows removes it at the release")
def test_lock_that_cannot_be_removed_is_told(network, tmp_path, monkeypatch):
    unlink = Path.unlink

    def refuse(path, **given):
        if path.name == ".lock":
            raise PermissionError(13, "Permission denied")
        unlink(path, **given)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", refuse)
        with pytest.raises(OutputError, match=r"lock' cannot be written \(Permission denied\)"):
            export_network(network, FORMAT, tmp_path)
    export_network(network, FORMAT, tmp_path)
