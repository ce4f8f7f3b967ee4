"""What can be varied: names of a subject, and refusals that name the nearest."""

import math

import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.level_words import level_words
from ann_dc.study.realisation import NONIDEALITIES
from ann_dc.study.settings import FAMILIES, WORDS, names_of, subject_of
from ann_dc.study.study import Study


def test_every_family_has_names_for_a_plant():
    names = names_of(subject_of("car"))
    for word in FAMILIES:
        assert any(name.startswith(f"{word}.") for name in names), word
    for name in ("problem.D", "problem.N", "input.q_d.x", "gains.tau.u", "gains.rho.mu.x", "seed"):
        assert name in names


def test_a_network_has_no_problem_and_no_design():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    names = names_of(subject_of(network))
    assert not any(name.startswith(("problem.", "design.")) for name in names)
    assert "input.q_d.x" in names


def test_every_defect_that_is_named_can_be_brought_about():
    nonidealities = [
        n.partition(".")[2] for n in names_of(subject_of("car")) if n.startswith("nonideal.")
    ]
    assert sorted(nonidealities) == sorted([*NONIDEALITIES, "noise"])


def test_levels_have_the_words_that_circuits_have():
    """But for switched capacitors, whose period is chosen for a network."""
    assert {*WORDS["circuit.level"]} == level_words().keys() - {"switched-capacitor"}


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("input.q_d.z", "did you mean input.q_d"),
        ("defct.mismatch", "did you mean nonideal.mismatch"),
        ("gains.tau.w", "did you mean gains.tau.u"),
        ("speed", "settings begin with problem., design."),
        ("design.from", "did you mean design.form"),
    ],
)
def test_unknown_names_are_told_the_nearest(name, said):
    with pytest.raises(StudyError, match=said):
        Study(subject="car", vary={name: [1.0]})


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        *((name, "nonsense", f"{name} is one of") for name in WORDS),
        ("input.q_d.x", "far", "expected a number"),
        ("gains.rho", float("nan"), "is nan"),
        ("gains.rho", [1.0], "expected a number or a word"),
        ("seed", -1, "a whole number of at least zero"),
        ("seed", 1.5, "a whole number of at least zero"),
        ("problem.N", 0, r"problem\.N is a whole number of at least one, got 0"),
        ("problem.N", 2.5, r"problem\.N is a whole number of at least one"),
        *((f"problem.{n}", math.inf, f"{n} is a finite number") for n in ("dt", "q_0.x", "D")),
        *(("problem.dt", dt, r"problem\.dt ") for dt in (-1.0, 0.0, "short")),
        *((f"tolerance.{kind.value}", math.inf, "is a finite number") for kind in Kind),
        ("tolerance.resistor", -0.1, r"tolerance\.resistor is a number of at least 0"),
        ("circuit.gbw", -1e6, r"circuit\.gbw: gbw: expected a positive number"),
        ("circuit.bandwidth_margin", 0.0, r"circuit\.bandwidth_margin is a positive number"),
        ("design.penalty", 0.0, r"design\.penalty: "),
        ("gains.rho", -2.0, r"gains\.rho is a positive number"),
        ("nonideal.mismatch", math.inf, r"nonideal\.mismatch is a finite number"),
        ("run.tolerance", 0.0, r"run\.tolerance is a positive number"),
    ],
)
def test_values_that_are_none(name, value, said):
    with pytest.raises(StudyError, match=said):
        Study(subject="car", vary={name: [value]})


@pytest.mark.parametrize("vary", [{"problem.dt": (-1.0, 1.0)}, {"tolerance.gain": (-0.1, 0.1)}])
def test_range_with_impossible_end_is_refused_by_name(vary):
    with pytest.raises(StudyError, match=f"vary: {next(iter(vary))} is a "):
        Study(subject="car", vary=vary)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("nonideal.leak", [10.0, math.inf]),
        ("circuit.a0", [1e3, math.inf]),
        ("tolerance.resistor", [0, 1e-9, 1e9]),
        ("gains.rho", (0.0, 2.0)),
        ("problem.q_d.x", [1.0, "free"]),
        ("run.step", ["adaptive", 0.1]),
    ],
)
def test_value_that_a_point_can_have_is_accepted(name, values):
    fixed = {"run.backend": "recurrent"} if name == "run.step" else {}
    assert len(Study(subject="car", vary={name: values}, fixed=fixed)) >= 1


def test_metrics_and_specs_are_known():
    with pytest.raises(StudyError, match="did you mean settling_time"):
        Study(subject="car", metrics=["setling_time"])
    with pytest.raises(StudyError, match="'power' is not measured"):
        Study(subject="car", metrics=["settling_time"], spec={"power": 1.0})
    with pytest.raises(StudyError, match="duplicate name"):
        Study(subject="car", metrics=["power", "power"])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"tolerance.resistor": 0.1, "run.backend": "ode"},
            "applies to parts, but no circuit is run",
        ),
        ({"nonideal.mismatch": 0.1, "circuit.level": "macro"}, "changes the ideal network"),
        ({"initial_guess.kind": "zero", "tolerance.resistor": 0.1}, "changes the ideal network"),
        ({"run.tolerance": 1e-3, "run.backend": "spice"}, "changes the ideal network"),
        ({"run.order": "two-phase"}, "'recurrent' only"),
        ({"nonideal.mismatch": -0.1}, "of at least 0"),
        ({"circuit.series": "E7"}, r"circuit\.series is one of exact"),
    ],
)
def test_settings_that_nothing_would_read(given, said):
    with pytest.raises(StudyError, match=said):
        Study(subject="double_integrator", fixed=given)


def test_settings_that_some_points_read():
    vary = {"run.backend": ["ode", "emulation"]}
    fixed = {"circuit.level": "macro", "tolerance.resistor": 0.01}
    assert len(Study(subject="double_integrator", vary=vary, fixed=fixed)) == 2


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ({"nonideal.mismatch": (0.01, 0.02, 0.03)}, r"a range is \(low, high\)"),
        ({"nonideal.mismatch": [0.1, 0.1]}, "listed twice"),
        ({"problem.N": (5, 9)}, "whole numbers; list them"),
        ({"run.backend": (0, 1)}, "takes words"),
    ],
)
def test_lists_and_ranges_that_are_none(vary, said):
    with pytest.raises(StudyError, match=said):
        Study(subject="double_integrator", vary=vary)
