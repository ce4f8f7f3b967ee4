"""``ann-dc export`` and ``ann-dc inspect`` as one types them."""

import pytest
from command_line import printed_json, refused, run
from designs import designed

import ann_dc
from ann_dc.export.catalogue import FORMATS

SMALL = ["export", "double_integrator", "-N", "4", "--quiet"]


def test_a_plant_is_designed_and_written(tmp_path):
    code, text = run(*SMALL[:-1], "--to", "conductances,diagram", "--output", tmp_path)
    assert code == 0
    assert f"wrote {tmp_path / 'conductances'}: conductances.csv" in text
    code, text = run("inspect", tmp_path)
    assert code == 0
    assert "all 2 are unchanged" in text
    assert text.count("unchanged") == 2  # in the head and in the verdict
    code, text = run("inspect", tmp_path / "diagram")
    assert code == 0
    assert text.count("unchanged yes") == 1


def test_formats_may_be_given_one_by_one(tmp_path):
    words = ["--to", "conductances", "--to", "diagram,csv", "--output", tmp_path]
    assert run(*SMALL, *words)[0] == 0
    assert {folder.name for folder in tmp_path.iterdir()} == {"conductances", "diagram", "csv"}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("ending", ["npz", "safetensors"])
def test_a_weight_file_is_a_problem_too(tmp_path, ending):
    file = tmp_path / f"network.{ending}"
    ann_dc.save(designed("double_integrator").network, file)
    assert run("export", file, "--to", "diagram", "--output", tmp_path)[0] == 0
    code, text = run("export", file, "--set", "N=3", "--to", "diagram", "--output", tmp_path)
    assert code == 2
    assert "a stored network cannot be changed" in text
    refused(
        ["export", file, "--preconditioner", "multilevel"],
        "omit --set, --horizon, --q-0, --q-d and",
    )


def test_a_changed_file_is_told(tmp_path):
    assert run(*SMALL, "--to", "conductances", "--output", tmp_path)[0] == 0
    (tmp_path / "conductances" / "conductances.csv").write_text("other")
    code, text = run("inspect", tmp_path)
    assert code == 1
    assert "differs from the written file" in text


def test_what_a_changed_file_says_moves_no_cursor(tmp_path):
    assert run(*SMALL, "--to", "diagram", "--output", tmp_path)[0] == 0
    index = tmp_path / "diagram" / "export.json"
    index.write_text(index.read_text().replace('"to": "diagram"', '"to": "\\u001b[2J[red]"'))
    code, text = run("inspect", tmp_path)
    assert code == 1
    assert "?[2J[red]" in text
    assert "\x1b" not in text


def test_formats_are_listed_without_a_problem():
    code, text = run("export", "--list-formats")
    assert code == 0
    assert all(name[:8] in text for name in FORMATS)
    assert "preserves" in text


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["--to", "nix"], "format 'nix' does not exist; choose one of: all, "),
        (["--to", "diagram", "--option", "off=cell"], "did you mean 'of'?"),
        (["--to", "diagram", "--option", "cell"], "--option: expected NAME=VALUE"),
        (["--to", "conductances", "--option", "levels=x"], "levels: expected a whole number"),
        (
            ["--to", "conductances", "--option", "levels=2", "--option", "levels=3"],
            "specified twice",
        ),
        (["--preconditioner", "nix"], "--preconditioner"),
    ],
)
def test_bad_words_are_refused_by_name(tmp_path, words, reported):
    refused([*SMALL[:-1], "--output", tmp_path, *words], reported)


@pytest.mark.slow
def test_one_format_that_cannot_is_an_error_several_are_a_sentence(tmp_path):
    words = ["export", "cart_pole", "--set", "N=10", "--output", tmp_path, "--to"]
    refused([*words, "conductances"], "decades")
    code, text = run(*words, "conductances,diagram")
    assert code == 1
    assert "no conductances: " in text
    assert f"wrote {tmp_path / 'diagram'}" in text


def test_what_is_no_export_is_refused(tmp_path):
    refused(["inspect", tmp_path], "no weight file")


def test_an_export_to_weights_is_a_problem_too(tmp_path):
    """What is exported from it is the same, and other exports say what to give instead."""
    run(*SMALL, "--to", "weights,latex", "--output", tmp_path / "first")
    weights = tmp_path / "first" / "weights"
    assert run("export", weights, "--to", "latex", "--output", tmp_path / "second")[0] == 0
    first, second = (tmp_path / place / "latex" / "export.json" for place in ("first", "second"))
    assert first.read_bytes() == second.read_bytes()
    refused(
        ["export", first.parent], "is an export to 'latex', which contains no network to be read"
    )
    refused(["export", tmp_path / "first"], f"give {weights}")


def test_export_into_a_folder_with_the_plants_name_is_repeated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["export", "double_integrator", "--to", "csv", "--output", "double_integrator"]
    for horizon in ("4", "5"):
        assert run(*words, "-N", horizon)[0] == 0
    code, text = run("inspect", "double_integrator")
    assert code == 0
    assert "unchanged yes" in text
    refused(["export", "./double_integrator"], "contains exports;")


def test_export_notes_a_series_that_moves_the_controls(tmp_path):
    words = [*SMALL[:-1], "--to", "pack", "--option", "series=E12", "--output", tmp_path]
    code, text = run(*words)
    assert code == 0
    assert "note: level macro: circuit: its controls are predicted to be" in text
    assert "E96-pairs" in text


def test_inspect_json_dash_prints_only_json(tmp_path):
    assert run(*SMALL, "--to", "conductances,diagram", "--output", tmp_path)[0] == 0
    code, data = printed_json("inspect", tmp_path)
    assert code == 0
    assert {each["kind"]: each["good"] for each in data} == dict.fromkeys(
        ("conductances", "diagram"), True
    )
