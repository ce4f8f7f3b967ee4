"""JSON output of every command: strict, alone on stdout, with the names of the attributes."""

import json

import journeys
import numpy as np
import pytest
from command_line import ROOT, strict
from typer.testing import CliRunner

import ann_dc
from ann_dc.cli.commands.app import COMMANDS, app

SMALL = ("double_integrator", "-N", "4")
STUDY = """
subject = "double_integrator"
metrics = ["settling_time", "control_error"]
fixed.problem.N = 4
vary.nonideal.mismatch = [0.0, 1000.0]
"""
WORLD = """
start = [0, 0, 0]
goal = [1.0, 0.05]
robot = {kind = "unicycle"}
"""

WORDS = {
    "solve": ((*SMALL, "--no-verify"), "kkt_residual"),
    "design": (SMALL, "candidates"),
    "coordinate": ((*SMALL, "--coordinator", "newton"), "coordinator"),
    "circuit": ((*SMALL, "--no-simulate"), "problem"),
    "levels": (SMALL, "levels"),
    "run": (("NETWORK",), "status"),
    "navigate": (("WORLD", "--output", "OUT"), "clearance"),
    "study": (("STUDY", "--output", "OUT", "--workers", "0"), "outcomes"),
    "report": (("RECORDS",), "files"),
    "export": ((*SMALL, "--to", "weights,onnx", "--output", "OUT"), "why_not"),
    "inspect": (("NETWORK",), "facts"),
    "show": (("car",), "equations"),
    "plants": ((), "parameters"),
    "paper": (("--output", "OUT"), "corrected D=1"),
}
"""Arguments of each command, and a name that its JSON data contain."""
MINUTES = {"export", "report", "study", "levels", "paper"}
EVERY = [pytest.param(name, marks=[pytest.mark.slow] * (name in MINUTES)) for name in COMMANDS]


SUFFIXES = {"NETWORK": ".npz", "STUDY": ".toml", "WORLD": ".toml"}


@pytest.fixture
def words(tmp_path, monkeypatch):
    """Return a function that gives the arguments of a command, with paths for words of files."""
    monkeypatch.setattr(
        "ann_dc.navigation.planner_design.design_planner", lambda robot, **given: journeys.Ahead()
    )
    names = "OUT", "NETWORK", "STUDY", "WORLD", "RECORDS"
    files = {name: tmp_path / (name.lower() + SUFFIXES.get(name, "")) for name in names}
    files["STUDY"].write_text(STUDY, encoding="utf-8")
    files["WORLD"].write_text(WORLD, encoding="utf-8")
    ann_dc.save(ann_dc.design(ann_dc.plants.double_integrator(N=4)).network, files["NETWORK"])

    def of(command):
        if command == "report":
            ann_dc.load_study(files["STUDY"]).run(files["RECORDS"], workers=0)
        return [str(files.get(word, word)) for word in WORDS[command][0]]

    return of


def refuse(constant):
    raise AssertionError(f"{constant} is not JSON")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", EVERY)
def test_json_dash_prints_only_strict_json(command, words):
    result = CliRunner().invoke(app, [command, *words(command), "--json", "-"])
    assert result.exit_code in (0, 1), result.output
    json.loads(result.stdout, parse_constant=refuse)
    assert f'"{WORDS[command][1]}"' in result.stdout


@pytest.mark.parametrize("command", ["plants", "show", "inspect"])
def test_json_file_has_the_content_of_the_dash(command, words, tmp_path):
    file, given = tmp_path / "new" / "result.json", [command, *words(command)]
    printed = CliRunner().invoke(app, [*given, "--json", "-"]).stdout
    assert CliRunner().invoke(app, [*given, "--json", str(file)]).exit_code == 0
    assert strict(file) == json.loads(printed)


def test_show_json_has_the_names_and_values_of_the_network(tmp_path):
    result = CliRunner().invoke(app, ["show", "car", "--json", "-"])
    data, network = json.loads(result.stdout), ann_dc.synthesize(ann_dc.plants.car())
    assert data["size"] == network.size
    assert [each["name"] for each in data["neurons"]] == [n.name for n in network.cell.neurons]
    weights = [each["weight"] for each in data["connections"]]
    for found, wire in zip(weights, network.cell.connections, strict=True):
        np.testing.assert_array_equal(found, wire.weight)


@pytest.mark.parametrize("command", ["show", "plants", "export"])
def test_json_into_a_folder_is_refused(command):
    result = CliRunner().invoke(app, [command, "car", "--json", str(ROOT)])
    assert result.exit_code == 2
    assert "is a folder" in result.output
