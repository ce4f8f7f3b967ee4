"""Circuits from the command line: levels, prediction, budget, files, failures."""

import importlib.util
import json
import re
from pathlib import Path

import pytest
from command_line import CIRCUIT, QUICK, ROOT, printed_json, refused, run, strict
from simulator import needs_ngspice
from small_pdk import needs_pdk

from ann_dc.backends.spice.pdk.files import INSTALL, PACKAGE
from ann_dc.hardware.parts.e_series import E24

DESIGN = "ann_dc.cli.arguments.building.network_to_build"


@needs_ngspice
def test_circuit_settles_near_the_optimum(tmp_path):
    deck, result = tmp_path / "car.cir", tmp_path / "car.json"
    code, text = run("circuit", "car", "--deck", deck, "--json", result)
    assert code == 0
    assert "op amps" in text
    found = strict(result)
    assert found["control_error"] < 1e-4
    assert found["settling_time"] < 40e-6
    assert found["objective"] == pytest.approx(398.6315, rel=1e-3)
    assert deck.read_text(encoding="utf-8").endswith(".end\n")


@needs_ngspice
def test_circuit_on_ideal_parts():
    code, text = run(*CIRCUIT, "--level", "behavioural")
    assert code == 0
    assert "behavioural" in text


@needs_ngspice
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--level", "wood"), "--level"),
        (("--a0", "-1"), "a0"),
        (("--gbw", "0"), "gbw"),
        (("--bandwidth-margin", "nan"), "margin"),
        (("--full-scale", "0"), "full_scale"),
    ],
)
def test_circuit_names_what_is_wrong(arguments, named):
    code, text = run(*CIRCUIT, *arguments)
    assert code == 2
    assert named in text


def test_circuit_without_ngspice_says_what_to_do(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    code, text = run(*CIRCUIT)
    assert code == 2
    assert "ANN_DC_NGSPICE" in text


LEVELS = ["behavioural", "ota-c", "macro", "differential", "transistor", "tl072_ad633"]


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("level", LEVELS)
def test_every_level_has_a_word(tmp_path, level):
    result = tmp_path / "result.json"
    code, text = run(*QUICK, "--level", level.upper(), "--json", result)
    assert code == 0
    assert "to 0.1 % of the controls" in text
    found = strict(result)
    assert found["level"] == {"differential": "macro, differential"}.get(level, level)
    assert found["settled"]
    assert found["control_error"] < 1e-2
    assert (found["predicted"] is None) == (level == "behavioural")
    assert found["parts"]


@needs_ngspice
def test_switched_capacitors_have_a_word():
    """One stage, from rest to a speed: a period takes as long as a run of another level."""
    words = ["-N", "1", "--set", "dt=1", "--q-0", "0,0", "--q-d", "free,1"]
    code, text = run(*QUICK[:2], *words, "--level", "switched-capacitor")
    assert code == 0
    assert "switches" in text


@pytest.mark.slow
@needs_ngspice
def test_a_seed_draws_parts_and_a_budget_tells_which_to_pay_for(tmp_path):
    files = [tmp_path / name for name in ("one.json", "again.json", "two.json")]
    words = [*QUICK, "--level", "opa192_ad734", "--error-budget", "3"]
    outputs = [run(*words, "--seed", seed, "--json", file) for seed, file in zip((1, 1, 2), files)]
    code, text = outputs[0]
    assert code == 0
    assert "parts drawn with seed 1" in text
    assert "error budget" in text
    assert "resistor from t.x to m.x 0.06%" in text  # 0.1 % at most, drawn evenly
    one, again, two = map(strict, files)
    assert one == again
    assert one["control_error"] != two["control_error"]
    assert (one["seed"], two["seed"]) == (1, 2)
    assert one["budget"] == two["budget"]  # of the parts as they should be
    assert len(one["budget"]) == 3
    assert {"parameter", "size", "unit", "error", "share_of_variance"} <= one["budget"][0].keys()
    assert one["predicted"]["control_error"] == pytest.approx(one["control_error"], rel=0.01)
    assert one["power"] * one["settling_time"] == pytest.approx(one["energy"])


@needs_ngspice
def test_drawn_circuits_are_predicted(tmp_path):
    result = tmp_path / "result.json"
    words = ["--level", "opa192_ad734", "--samples", "8", "--json", result]
    code, text = run(*QUICK, *words)
    assert code == 0
    assert "95 % of 8 (predicted); 8 of 8 within 1%" in text
    assert "within 1 % of the optimal controls (ngspice, nominal parts)" in text
    assert len(strict(result)["samples"]) == 8


@needs_ngspice
def test_circuit_writes_netlist_bill_picture_and_numbers(tmp_path):
    names = {"--deck": "a.cir", "--bom": "b.csv", "--figures": "figures", "--json": "d.json",
             "--trajectory": "e.csv"}  # fmt: skip
    files = {option: tmp_path / "new" / name for option, name in names.items()}
    options = [word for pair in files.items() for word in pair]
    code, text = run(*QUICK, "--series", "e96-pairs", "--level", "macro", *options)
    assert code == 0
    assert text.count("wrote ") == 5
    assert "E96 pairs: rounding errors up to 0.0" in text
    assert files["--deck"].read_text(encoding="utf-8").endswith(".end\n")
    assert files["--bom"].read_text(encoding="utf-8").startswith("cell,component,")
    assert (files["--figures"] / "circuit.png").read_bytes().startswith(b"\x89PNG")
    assert strict(files["--json"])["resistors"] == "E96 pairs"
    assert files["--trajectory"].read_text(encoding="utf-8").startswith("time (s),q.x[1] (m),")
    assert {file.name for file in (tmp_path / "new").iterdir()} == set(names.values())


@pytest.mark.slow
@needs_ngspice
def test_one_resistor_of_a_series_is_worse_than_two(tmp_path):
    errors = []
    for series in ("exact", "E96-pairs", "E24"):
        result = tmp_path / f"{series}.json"
        code, _ = run(*QUICK, "--series", series, "--json", result)
        found = strict(result)
        assert code == (0 if found["control_error"] < 1e-2 else 1)
        errors.append(found["control_error"])
    assert errors == sorted(errors)
    assert errors[2] > 10 * errors[1]


def test_the_values_told_are_those_of_the_series():
    code, text = run(*QUICK, "--series", "E24", "--no-simulate")
    assert code == 1
    low, high = re.search(r"R (\S+) kohm to (\S+) kohm", text).groups()
    assert {float(low), float(high) / 10} <= {*E24.mantissas}


def test_a_target_out_of_reach_is_told_by_name():
    refused(["circuit", "double_integrator", "-N", "1"], "no circuit: no controls reach q_d")


CIRCUIT_BAD = {
    "unknown level": (["--level", "wood"], "--level 'wood' does not exist; choose one of: behav"),
    "presets are listed": (["--level", "lm741"], "tl072_ad633"),
    "unknown series": (["--series", "E7"], "choose one of: exact, E12, E24, E96, E24-pairs"),
    "a0 of a preset": (["--level", "tl072_ad633", "--a0", "1e5"], "--a0: the parts of level"),
    "gbw of transistors": (
        ["--level", "transistor", "--gbw", "1e6"],
        "these options apply to macro",
    ),
    "a0 of ideal parts": (["--level", "behavioural", "--a0", "1e5"], "--a0: the parts of level"),
    "negative seed": (["--seed", "-1"], "--seed"),
    "half a seed": (["--seed", "1.5"], "--seed"),
    "negative budget": (["--error-budget", "-1"], "--error-budget"),
    "a folder": (["--json", str(ROOT)], "is a folder"),
}


@pytest.mark.parametrize(("words", "meaning"), CIRCUIT_BAD.values(), ids=CIRCUIT_BAD)
def test_bad_options_of_a_circuit_are_told_before_the_design(tmp_path, monkeypatch, words, meaning):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(DESIGN, lambda *_, **__: pytest.fail("designed all the same"))
    code, text = run(*QUICK, *words)
    assert code == 2
    assert meaning in text
    assert not [*tmp_path.iterdir()]


def without_models(monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *_: None if name == PACKAGE else found(name, *_)
    )


@pytest.mark.parametrize("words", [[], ["--no-simulate"], ["--corners"]])
def test_missing_models_of_a_foundry_are_told_before_the_design(monkeypatch, words):
    without_models(monkeypatch)
    monkeypatch.setattr(DESIGN, lambda *_, **__: pytest.fail("designed all the same"))
    code, text = run(*QUICK, "--level", "sky130", *words)
    assert code == 2
    assert INSTALL in text


@needs_pdk
def test_a_seed_of_a_foundrys_transistors_is_told_to_be_for_ngspice_alone():
    words = ["--level", "sky130", "--seed", "1", "--no-simulate"]
    code, text = run(*CIRCUIT[:2], "-N", "3", *words)
    assert code == 0
    assert "transistors are drawn by their models in ngspice" in text


def test_a_yield_by_emulation_needs_no_models_of_a_foundry(monkeypatch):
    without_models(monkeypatch)
    code, text = run(*QUICK, "--level", "sky130", "--yield", "error<20%", "--samples", "3")
    assert code == 0
    assert "3 of 3" in text


@pytest.mark.parametrize("level", ["behavioural", "switched-capacitor"])
def test_a_budget_of_levels_that_have_no_course_of_their_own(level):
    """The emulation of ideal op amps is the network with its weights; a clocked one rests."""
    code, text = run(*QUICK, "--level", level, "--error-budget", "2", "--no-simulate")
    assert code == 0
    assert "error budget" in text


def test_the_loops_with_the_smallest_phase_margins(tmp_path):
    file = tmp_path / "result.json"
    words = "--level", "macro", "--no-simulate"
    code, text = run(*QUICK, *words, "--loops", "2", "--json", file)
    assert code == 0
    assert "phase margins" in text
    first, second = strict(file)["loops"]
    assert first["phase_margin"] <= second["phase_margin"]
    assert {"node", "stage", "crossover"} <= first.keys()
    code, text = run(*QUICK, "--level", "ota-c", "--no-simulate", "--loops", "1")
    assert code == 2
    assert "have no op amps" in text


@needs_ngspice
def test_an_unstable_circuit_is_told_in_a_sentence():
    code, text = run(*QUICK, "--bandwidth-margin", "2")
    assert code == 2
    assert "error: circuit: the pole model is unstable" in text
    assert "too slow at bandwidth margin 2" in text


@pytest.mark.parametrize("option", ["--deck", "--bom", "--figures", "--json", "--trajectory"])
def test_an_unwritable_folder_is_told_before_the_design(tmp_path, monkeypatch, option):
    monkeypatch.setattr(DESIGN, lambda *_, **__: pytest.fail("designed all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run(*QUICK, option, blocked / "result.csv")
    assert code == 2
    assert "cannot be written" in text
    assert blocked.read_text() == "kept"


FAILURES = {
    "unstable": (["--bandwidth-margin", "2"], ""),
    "ngspice is killed": ([], "kill -9 $$"),
    "ngspice fails": ([], "echo no convergence; exit 1"),
    "no answer": ([], ": > out.raw"),
}


@pytest.mark.sampled(3)
@needs_ngspice
@pytest.mark.parametrize(("words", "script"), FAILURES.values(), ids=FAILURES)
def test_a_circuit_that_fails_costs_no_earlier_result(tmp_path, monkeypatch, words, script):
    if script:
        program = tmp_path / "ngspice"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv("ANN_DC_NGSPICE", str(program))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    files = {option: tmp_path / f"result.{option[2:]}" for option in ("--deck", "--bom", "--json")}
    for file in files.values():
        file.write_text("of the last run")
    code, text = run(*QUICK, *words, *(word for pair in files.items() for word in pair))
    assert code == 2
    assert text.startswith("error: ")
    assert [file.read_text() for file in files.values()] == 3 * ["of the last run"]


@needs_ngspice
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_costs_no_earlier_result(tmp_path):
    result = tmp_path / "result.json"
    result.write_text("of the last run")
    code, text = run(*QUICK, "--deck", "/dev/full", "--json", result)
    assert code == 2
    assert "No space left on device" in text
    assert result.read_text() == "of the last run"
    assert [*tmp_path.iterdir()] == [result]


def test_netlist_bill_and_prediction_need_no_ngspice(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("ANN_DC_NGSPICE", raising=False)
    deck, bill, result = (tmp_path / name for name in ("a.cir", "a.csv", "a.json"))
    code, text = run(
        *CIRCUIT, "--no-simulate", "--deck", deck, "--bom", bill, "--json", result,
        "--samples", "2", "--error-budget", "1",
    )  # fmt: skip
    assert code == 0, text
    assert deck.read_text().endswith(".end\n")
    assert bill.read_text().startswith("cell,component,")
    meaning = json.loads(result.read_text())
    assert meaning["settled"] is None
    assert meaning["predicted"]["control_error"] < 1e-3
    code, text = run(*CIRCUIT, "--no-simulate", "--bandwidth-margin", "3")
    assert code == 1
    assert "oscillates" in text
    for option, file in (("--figures", "figures"), ("--trajectory", "a.csv")):
        code, text = run(*CIRCUIT, "--no-simulate", option, tmp_path / file)
        assert code == 2
        assert f"{option}: needs the simulation; omit --no-simulate" in text


def test_a_volt_of_every_control_is_told(tmp_path):
    """In the user's units, from the offset of its scale: what the deck's node says."""
    file, result = tmp_path / "coolant.toml", tmp_path / "a.json"
    file.write_text(
        'states = ["x"]\ncontrols = ["u"]\ndt = 0.5\nhorizon = 3\nq_0 = [0]\nq_d = [1]\n'
        'cost = "(u - 1)**2"\n[dynamics]\nx = "u - x"\n[scales]\nu = [4.0, 1.5]\n',
        encoding="utf-8",
    )
    code, text = run("circuit", file, "--no-simulate", "--json", result)
    assert code == 0, text
    (scale,) = strict(result)["volt"].values()
    assert scale["offset"] == 1.5
    assert f"u.u: {scale['factor']:.4g}" in text
    assert "from 1.5" in text
    assert strict(result)["within_tolerance"] is True
    assert strict(result)["shortcoming"] == ""


# ---- preconditioners -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "word",
    [
        "resistive-grid",
        *(
            pytest.param(word, marks=pytest.mark.slow)
            for word in ("coupled-multilevel", "multilevel", "cyclic-reduction")
        ),
    ],
)
def test_what_a_preconditioner_demands_is_told_before_it_is_built(tmp_path, word):
    bill, result = tmp_path / "a.csv", tmp_path / "a.json"
    files = "--bom", bill, "--json", result
    code, text = run(*CIRCUIT, "--no-simulate", "--preconditioner", word, *files)
    assert code == 0, text
    assert "requires that its nodes follow within" in " ".join(text.split())
    found = strict(result)
    assert found["preconditioner"] == word.replace("-", "_")
    assert 0 < found["demand"]["lag"] <= 1
    assert 0 < found["demand"]["error"] <= 1
    node = "node" if word == "resistive-grid" else "resistor from own."
    assert node in bill.read_text(encoding="utf-8")


@pytest.mark.slow
def test_where_a_demand_is_not_told_the_report_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.fidelity.circuit_study.DENSE_LIMIT", 10)
    arguments = "--no-simulate", "--preconditioner", "multilevel", "--json", tmp_path / "a.json"
    code, text = run(*CIRCUIT, *arguments)
    assert code == 0, text
    assert "wires requirements not computed: with" in " ".join(text.split())
    found = strict(tmp_path / "a.json")
    assert found["demand"] is None
    assert "neurons, above 10" in found["undemanded"]


def test_time_constants_demand_nothing(tmp_path):
    code, text = run(*CIRCUIT, "--no-simulate", "--json", tmp_path / "a.json")
    assert code == 0
    assert "demands" not in text
    assert strict(tmp_path / "a.json")["demand"] is None


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--preconditioner", "tre"),
            "diagonal, multilevel, coupled-multilevel, resistive-grid, cyclic-",
        ),
        (
            ("--preconditioner", "cyclic-reduction", "--level", "ota-c"),
            "ota-c circuits cannot build a cyclic",
        ),
        (
            ("--preconditioner", "resistive-grid", "--level", "differential"),
            "cannot build a resistive grid",
        ),
    ],
)
def test_a_preconditioner_that_cannot_be_built_is_told(arguments, sentence):
    code, text = run(*CIRCUIT, "--no-simulate", *arguments)
    assert code == 2
    assert sentence in " ".join(text.split())


def test_circuit_json_dash_prints_only_json(tmp_path):
    code, data = printed_json(*CIRCUIT, "--no-simulate", "--deck", tmp_path / "a.cir")
    assert code == 0
    assert data["problem"] == "double_integrator"
    refused([*CIRCUIT, "--no-simulate", "--deck", "-"], "only --json can write to stdout")
