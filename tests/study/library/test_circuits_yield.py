"""Yields fall with errors and gain; boards that oscillate or are slow are no good."""

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.parts.levels import macro
from ann_dc.study.library.circuits import BOARD, spot_check, yield_curves

PLANT = "double_integrator"
SPEC = {"control_error": 0.03, "slowest_mode_seconds": 1e-3}


@pytest.mark.slow
def test_more_error_never_mends_the_same_draws():
    figures = {"tolerance.resistor": (1e-6, 1e-2, 1e-1)}
    table = yield_curves(PLANT, spec=SPEC, figures=figures, samples=4)["tolerance.resistor"].run(
        workers=0
    )
    share = [part.yield_of().share for part in table.by("tolerance.resistor").values()]
    assert share == sorted(share, reverse=True)
    assert (share[0], share[-1]) == (1, 0)


def test_a_board_that_repels_is_infinitely_slow_and_no_good():
    figures = {"circuit.bandwidth_margin": (2.0, 10.0)}
    table = yield_curves(PLANT, spec=SPEC, figures=figures, samples=2)[
        "circuit.bandwidth_margin"
    ].run(workers=0)
    slow, fast = table.by("circuit.bandwidth_margin").values()
    assert slow.outcomes == {"unstable equilibrium": 2}
    assert np.isinf(slow["slowest_mode_seconds"]).all()
    assert (slow.yield_of().passed, fast.yield_of().passed) == (0, 2)


@pytest.mark.slow
def test_the_slowest_mode_is_that_of_the_emulated_board():
    fixed = {"circuit.bandwidth_margin": (10.0,)}
    exact = {name: 0.0 for name in BOARD if name.startswith("tolerance.")}
    exact["tolerance.resistor"] = 1e-12  # none at all stands for what is typical
    study = yield_curves(PLANT, spec=SPEC, figures=fixed, board={**BOARD, **exact}, samples=1)
    (found,) = study["circuit.bandwidth_margin"].run(workers=0)["slowest_mode_seconds"]
    network = ann_dc.design(
        ann_dc.plants.get(PLANT)(), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    level = macro(gbw=10e6)
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    made = CircuitInstance(circuit=circuit, level=level, probe=probe)
    rightmost = np.linalg.eigvals(ann_dc.evaluator(made.emulation.network).jacobian(made.settled))
    assert found == pytest.approx(
        np.log(1000) * circuit.scaling.time / -rightmost.real.max(), rel=1e-5
    )


def test_a_spot_check_has_the_boards_of_the_curves():
    spot = [*spot_check(PLANT, samples=3).points()]
    curve = [*yield_curves(PLANT, samples=9)["circuit.a0"].points()]
    assert [p.seed for p in spot[:3]] == [p.seed for p in spot[3:]] == [p.seed for p in curve[:3]]
    assert {p.setting["run.backend"] for p in spot[3:]} == {"spice"}


def test_a_metric_that_does_not_exist_is_refused():
    with pytest.raises(StudyError, match="unknown metric 'slowest_mode'"):
        yield_curves(PLANT, spec={"slowest_mode": 1.0})
