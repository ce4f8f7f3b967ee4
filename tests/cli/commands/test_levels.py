"""Command ``ann-dc levels``: comparison of all model levels."""

import pytest
from command_line import QUICK, ROOT, printed_json, refused, run, strict
from simulator import needs_ngspice

from ann_dc.fidelity.level_comparison import ComparedLevel
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, switched_capacitor

LEVELS = ["levels", *QUICK[1:]]


@needs_ngspice
def test_levels_compares_the_wanted_levels_and_writes_files(tmp_path, monkeypatch):
    steps = (
        ComparedLevel(name="ideal", level=BEHAVIOURAL),
        ComparedLevel(name="op amps", level=macro()),
        ComparedLevel(name="too slow", level=switched_capacitor(step=0.1), slow=True),
    )
    seeds = []
    monkeypatch.setattr(
        "ann_dc.fidelity.level_comparison.compared_levels",
        lambda *_, seed: seeds.append(seed) or steps,
    )
    figure, result = tmp_path / "levels.png", tmp_path / "levels.json"
    code, text = run(*LEVELS, "--seed", "3", "--figures", tmp_path, "--json", result)
    assert code == 0
    assert seeds == [3]
    assert "too slow" not in text
    assert f"wrote {figure}" in text.replace("\n", "")
    assert figure.read_bytes().startswith(b"\x89PNG")
    levels = {found["level"]: found for found in strict(result)["levels"]}
    names = [name.split(",")[0] for name in levels]
    assert names[:4] == ["ODE", "recurrent layer", "ideal", "op amps"]
    assert all(name.endswith("on this CPU") for name in names[4:])
    circuit = levels["op amps"]
    assert circuit["predicted_error"] == pytest.approx(circuit["error"], rel=0.05)
    assert circuit["power"] is None
    assert circuit["parts"]["op amps"] > 0
    code, data = printed_json(*LEVELS, "--seed", "3")
    assert (code, data["problem"]) == (0, "double_integrator")


BAD = {
    "negative seed": (["--seed", "-1"], "--seed"),
    "a level": (["--level", "macro"], "--level"),
    "a folder": (["--json", str(ROOT)], "is a folder"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_options_are_told_before_the_design(monkeypatch, words, meaning):
    design = "ann_dc.cli.arguments.building.network_to_build"
    monkeypatch.setattr(design, lambda *_, **__: pytest.fail("designed all the same"))
    refused([*LEVELS, *words], meaning)


def test_without_ngspice_it_says_what_to_do(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    refused(LEVELS, "ANN_DC_NGSPICE")
