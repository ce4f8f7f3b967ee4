"""The ladder of fidelity, prediction beside measurement."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from simulator import needs_ngspice
from torch_free import forget_torch

from ann_dc.backends.recurrent import backend as recurrent_backend
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NgspiceMissing
from ann_dc.fidelity.level_comparison import (
    ComparedLevel,
    Group,
    LevelComparison,
    Measured,
    _ode_level,
    _recurrent_level,
    compare_levels,
    compared_levels,
)
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.e_series import E96, EXACT
from ann_dc.hardware.parts.generator_curves import Polynomial
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, ota_c
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.reference_solvers import SolverTiming
from ann_dc.problem import plants
from ann_dc.solver import synthesize

PROBLEM = plants.double_integrator(N=4)


@cache
def network() -> Network:
    return design(synthesize(PROBLEM), preconditioner=(PreconditionerKind.DIAGONAL,)).network


@cache
def foot():
    """(first rung, probe run)."""
    return _ode_level(network())


def all_rungs(**given) -> tuple[ComparedLevel, ...]:
    return compared_levels(network(), foot()[1], **given)


def climbed(*steps: ComparedLevel, **given) -> list[Measured]:
    return list(LevelComparison(**given).run(network(), steps))


def rung_of(name: str) -> ComparedLevel:
    (found,) = (compared for compared in all_rungs() if compared.name.startswith(name))
    return found


# ---- what the ladder has -------------------------------------------------------------------------


def test_every_level_stands_once_on_the_ladder():
    steps = all_rungs()
    names = [compared.name for compared in steps]
    assert len(set(names)) == len(names)
    levels = [compared.level.name for compared in steps]
    for name in ("behavioural", "ota-c", "macro, differential", "switched-capacitor", "transistor"):
        assert levels.count(name) == 1, name
    assert {compared.name for compared in steps if compared.level.name in presets.names()} == set(
        presets.names()
    )
    assert levels[0] == "behavioural"
    assert levels[-1] == "transistor"
    assert [compared.level.name for compared in steps if compared.slow] == ["switched-capacitor"]


def differences(datasheet: Datasheet, ideal: Datasheet) -> set[str]:
    own = {f.name for f in fields(Datasheet)} - {"tolerances"}
    return {n for n in own if repr(getattr(datasheet, n)) != repr(getattr(ideal, n))} | {
        f.name
        for f in fields(Tolerances)
        if getattr(datasheet.tolerances, f.name) != getattr(ideal.tolerances, f.name)
    }


def test_every_defect_stands_alone():
    """Each rung of them is ideal but for one thing, and that is as bad as in the preset."""
    base = presets.get("opa192_ad734")
    ideal = Datasheet(a0=1e8, gbw=base.datasheet.gbw, tolerances=Tolerances())
    found = []
    for compared in all_rungs(base=base.name):
        assert (compared.group is Group.ALONE) == compared.name.endswith("only")
        if compared.group is not Group.ALONE:
            continue
        off = differences(compared.level.datasheet, ideal)
        found.append(off or {"series"})
        for name in off:
            home = (compared.level.datasheet, base.datasheet)
            if name not in {f.name for f in fields(Datasheet)}:
                home = tuple(datasheet.tolerances for datasheet in home)
            assert getattr(home[0], name) == getattr(home[1], name)
        assert (compared.series is E96) == (not off)
        assert (compared.seed is not None) == (
            off <= {f.name for f in fields(Tolerances)} and bool(off)
        )
        assert compared.level.full_scale == base.full_scale
    assert found == [
        *({"a0"}, {"slew"}, {"output_swing"}, {"multiplier_bandwidth", "function_bandwidth"}),
        *({"offset"}, {"resistor"}, {"gain"}, {"product_offset"}, {"series"}),
    ]


@needs_ngspice
def test_resistors_of_a_series_are_predicted_and_measured():
    exact, e96 = climbed(
        *(replace(rung_of("E96 resistors only"), name=s.name, series=s) for s in (EXACT, E96))
    )
    assert e96.predicted_error > 20 * exact.predicted_error
    assert e96.error == pytest.approx(e96.predicted_error, rel=0.02)


def test_a_seed_is_that_of_every_rung_with_errors():
    assert {compared.seed for compared in all_rungs(seed=7)} == {None, 7}
    assert all(
        compared.seed == 7
        for compared in all_rungs(seed=7)
        if compared.level.name in presets.names()
    )


# ---- climbing ------------------------------------------------------------------------------------


@needs_ngspice
def test_predicted_and_measured_agree_on_every_rung_that_has_both():
    """5 % of the figure, and nothing that the ODE would not be off by."""
    steps = (
        ComparedLevel(name="behavioural", level=BEHAVIOURAL),
        ComparedLevel(name="macro", level=macro()),
        rung_of("resistors"),
        rung_of("E96"),
        ComparedLevel(name="preset", level=presets.get("opa192_ad734"), seed=1),
    )
    done = climbed(*steps)
    assert [(m.name, m.group, m.level) for m in done] == [(r.name, r.group, r.level) for r in steps]
    for m in done:
        assert m.why == ""
        assert np.isfinite([m.error, m.settling, m.wall]).all()
        assert m.wall > 0
        assert m.run is not None
        assert m.run.settled()
    for m in done[1:]:
        assert m.predicted_error == pytest.approx(m.error, rel=0.05, abs=1e-6)
        assert m.predicted_settling == pytest.approx(m.settling, rel=0.05)
    assert np.isnan([done[0].predicted_error, done[0].predicted_settling]).all()
    assert done[0].error < 1e-5 < done[1].error < done[2].error
    power = [m.power for m in done]
    assert np.isnan(power[:2]).all()  # parts of which nothing is known
    assert done[-1].energy == pytest.approx(power[-1] * done[-1].settling)


@needs_ngspice
def test_transistors_and_transconductors_are_climbed_too():
    ota, silicon = climbed(
        ComparedLevel(name="ota", level=ota_c()), ComparedLevel(name="transistor", level=TRANSISTOR)
    )
    assert ota.predicted_error == pytest.approx(ota.error, rel=0.05)
    assert ota.predicted_settling == pytest.approx(ota.settling, rel=0.05)
    assert ota.error < 1e-3
    assert silicon.error < 1e-2
    assert silicon.settling < 50e-6
    assert silicon.predicted_settling == pytest.approx(silicon.settling, rel=0.05)


@needs_ngspice
def test_a_rung_that_oscillates_says_so_and_the_next_ones_are_climbed():
    meaning = []
    steps = (
        ComparedLevel(name="macro", level=macro()),
        ComparedLevel(name="ideal", level=BEHAVIOURAL),
    )
    rings, settles = climbed(*steps, bandwidth_margin=2.0, progress=meaning.append)
    assert rings.why == "the pole model predicts oscillation"
    assert np.isnan([rings.settling, rings.predicted_error, rings.predicted_settling]).all()
    assert settles.why == ""
    assert settles.error < 1e-5
    assert meaning == ["macro", "ideal"]


@pytest.mark.usefixtures("endless_ngspice")
def test_a_rung_that_ngspice_does_not_finish_says_why_in_a_line():
    found = climbed(
        *2 * (ComparedLevel(name="ideal", level=BEHAVIOURAL),), simulator=Ngspice(timeout=0.2)
    )
    for m in found:
        assert m.why.startswith("ngspice was terminated after 0.2 s")
        assert "\n" not in m.why
        assert m.run is None
        assert np.isnan([m.error, m.settling, m.power, m.energy]).all()


@pytest.mark.slow
@needs_ngspice
def test_a_level_that_cannot_be_built_is_told():
    """The polynomials of transistors cannot follow a function that is not smooth enough."""

    problem = plants.car(N=4)
    curved = design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    steps = (
        ComparedLevel(
            name="broken",
            level=replace(TRANSISTOR, functions=Polynomial(tolerance=1e-12, most_terms=2)),
        ),
        ComparedLevel(name="whole", level=macro()),
    )
    broken, whole = LevelComparison().run(curved, steps)
    assert "a polynomial of 2 terms is" in broken.why
    assert broken.run is None
    assert whole.why == ""


def test_without_ngspice_there_is_no_ladder(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    with pytest.raises(NgspiceMissing):
        climbed(ComparedLevel(name="ideal", level=BEHAVIOURAL))


# ---- the foot of the ladder ----------------------------------------------------------------------


def test_the_first_rungs_are_computed_digitally():
    first, probe = foot()
    assert (first.name, first.group, first.level) == ("ODE", Group.DIGITAL, None)
    assert first.run is None
    assert first.error < 1e-5
    assert first.settling > 0
    assert np.isnan([first.power, first.energy, first.predicted_error]).all()
    second = _recurrent_level(network(), probe)
    assert second.error < 1e-5
    assert np.isnan(second.settling)  # it has steps, and no seconds


def test_without_torch_the_recurrent_rung_says_so(monkeypatch):
    """Where the steps would be those of layers: for a wiring that has no code."""
    forget_torch(monkeypatch)
    assert _recurrent_level(network(), foot()[1]).error < 1e-5
    monkeypatch.setattr(recurrent_backend, "refusal", lambda _: "no code")
    found = _recurrent_level(network(), foot()[1])
    assert "pip install 'ann-dc[torch]'" in found.why
    assert np.isnan(found.error)


# ---- the whole report ----------------------------------------------------------------------------


def test_the_report_has_every_rung_that_is_wanted_in_order(monkeypatch):
    monkeypatch.setenv("ANN_DC_NGSPICE", "/nowhere/ngspice")
    lines = []
    timed = [SolverTiming(name="a solver", seconds=1e-3, iterations=5, objective=1.0)]
    comparison = LevelComparison(progress=lines.append)
    done = list(compare_levels(network(), comparison, wanted=lambda compared: False, timings=timed))
    assert [m.name.split(",")[0] for m in done[:2]] == ["ODE", "recurrent layer"]
    assert [(m.name, m.settling) for m in done[2:]] == [("a solver on this CPU", 1e-3)]
    assert {m.group for m in done} == {Group.DIGITAL}
    assert lines == ["recurrent layer"]


@needs_ngspice
def test_slow_rungs_are_left_out_unless_they_are_wanted(monkeypatch):
    steps = (
        ComparedLevel(name="ideal", level=BEHAVIOURAL),
        ComparedLevel(name="too slow", level=BEHAVIOURAL, slow=True),
    )
    monkeypatch.setattr("ann_dc.fidelity.level_comparison.compared_levels", lambda *_, **__: steps)
    names = [m.name for m in compare_levels(network())]
    assert "ideal" in names
    assert "too slow" not in names
