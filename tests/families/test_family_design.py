"""One network for many inputs: it settles where it says, and says where it does not."""

import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from reference import ipopt

from ann_dc import STEPS, GainRule, OdeBackend, design, plants, synthesize
from ann_dc.errors import DesignError, RangeWarning
from ann_dc.families.family import family_of
from ann_dc.families.family_design import Failure, FamilyDesign, design_family, why
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import certificate_of

OVER = {"q_d.x": (0.5, 2.0), "q_0.v": (-0.5, 0.5)}


@pytest.fixture(scope="module")
def unicycles() -> FamilyDesign:
    over = {"q_d.x": (1.0, 3.0), "q_d.y": (0.5, 2.0), "q_0.theta": (-0.5, 0.5)}
    return design_family(plants.unicycle(), over, held_out=60)


@pytest.mark.slow
def test_held_out_inputs_settle_in_continuous_time(unicycles):
    """What the validation says of a sample, SciPy's solver and IPOPT say too."""
    found, family = unicycles.validation, unicycles.family
    assert found.share >= 0.95
    for number in np.flatnonzero(found.certified)[:4]:
        network = family.network_of(found.samples[number])
        problem = family.problem_of(found.samples[number])
        run = OdeBackend(verify=False).run(network)
        assert run.status.settled
        certificate = certificate_of(problem, network, run.trajectory.final)
        assert certificate.certified
        np.testing.assert_allclose(certificate.objective, found.objectives[number], rtol=1e-6)
        np.testing.assert_allclose(certificate.objective, ipopt(problem).objective, rtol=1e-6)
        taken = run.settling_time * unicycles.winner.pace.radius
        np.testing.assert_allclose(found.settling[number], taken, rtol=0.25)


@pytest.mark.slow
def test_the_share_comes_with_its_interval(unicycles):
    found = unicycles.validation
    low, high = found.interval
    assert low < found.share <= high <= 1.0
    assert f"of {len(found)} settle to a certified optimum" in str(unicycles)


@pytest.mark.slow
def test_a_failure_is_told_with_its_reason(unicycles):
    """A network whose penalties are next to nothing holds no optimum."""
    weak = design(plants.unicycle(), preconditioner=PreconditionerKind.DIAGONAL)
    gains = replace(weak.gains, rho=1e-6 * weak.gains.rho)
    from ann_dc.gain_design.gains import apply_gains

    network = apply_gains(weak.network, gains)
    end = OdeBackend(verify=False, limit=100.0).run(network).trajectory.final
    assert why(network, end, lost=False) in (Failure.PENALTY, Failure.SLOW)


@pytest.mark.slow
def test_inputs_outside_the_ranges_are_warned_of(unicycles):
    with pytest.warns(RangeWarning, match=r"q_d.x = 9 lies outside the range from 1 to 3"):
        unicycles.network.with_inputs({"q_d.x": 9.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        unicycles.network.with_inputs({"q_d.x": 2.0, "q_0.x": 9.0})


@pytest.mark.slow
def test_ranges_are_kept_in_a_file(unicycles, tmp_path):
    from ann_dc.weights.network_file import load, save

    save(unicycles.network, tmp_path / "n.npz")
    assert load(tmp_path / "n.npz").ranges == unicycles.family.ranges


@pytest.mark.slow
def test_ranges_without_a_feasible_point_are_told():
    x, a = sp.symbols("x a")
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + sp.tanh(a),), cost=a**2, horizon=3,
        q_0=(0,), q_d=(40,),
    )  # fmt: skip
    with pytest.raises(DesignError, match=r"none of 16 inputs leads .*: no controls reach q_d\.x"):
        design_family(problem, {"q_d.x": (30.0, 50.0)})


@pytest.mark.parametrize("given", [{"gain_rule": GainRule()}, {"refine": STEPS}])
def test_a_family_takes_neither_recipe_nor_refinement(given):
    with pytest.raises(DesignError, match="neither gain_rule= nor refine="):
        design(plants.double_integrator(), ranges=OVER, **given)


def test_a_network_has_no_family():
    network = design(plants.double_integrator(N=3)).network
    with pytest.raises(DesignError, match="needs a problem"):
        design(network, ranges=OVER)


def test_no_held_out_inputs_are_refused():
    with pytest.raises(DesignError, match="held_out: expected a number of inputs of at least 1"):
        design_family(plants.double_integrator(), OVER, held_out=0)


TWO_PASSES = """
import hashlib, sys, tempfile, pathlib
from ann_dc import design, multistart, plants, save
folder = pathlib.Path(tempfile.mkdtemp())
problem = plants.double_integrator(N=8)
save(design(problem, ranges={"q_d.x": (0.5, 2.0)}).network, folder / "family.npz")
save(design(plants.unicycle()).network, folder / "single.npz")
found = multistart(plants.unicycle(), 4)
digest = hashlib.sha256()
for file in sorted(folder.iterdir()):
    digest.update(file.read_bytes())
for optimum in found.optima:
    digest.update(optimum.state.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_two_passes_in_two_processes_give_the_same_bytes():
    reported = [
        subprocess.run(
            [sys.executable, "-c", TWO_PASSES], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert reported[0] == reported[1]
    assert len(reported[0].strip()) == 64


def test_held_out_inputs_are_independent_and_those_of_a_list_have_no_interval():
    """Of 64 of Sobol's points every quarter of a range holds 16."""
    problem = plants.double_integrator(N=3)
    family = family_of(problem, synthesize(problem), {"q_d.x": (0.0, 4.0)})
    counts = [
        np.bincount([int(sample["q_d.x"][0]) for sample in drawn(64, seed=3)], minlength=4)
        for drawn in (family.samples, family.held_out)
    ]
    assert counts[0].tolist() == [16] * 4
    assert counts[1].tolist() != [16] * 4
    found = design_family(problem, [{"q_d.x": 0.5}, {"q_d.x": 1.5}]).validation
    assert found.interval == (found.share, found.share)
    assert str(found).startswith("listed inputs          2 of 2")
    assert "confidence" not in str(found)


@pytest.mark.slow
def test_a_sampler_may_go_beyond_what_was_met():
    """Its ranges are those of a thousand samples; no warning comes from others."""

    def far(draws, count):
        return [{"q_d.x": 0.5 + draws.exponential(0.1)} for _ in range(count)]

    problem = plants.double_integrator(N=3)
    designed = design_family(
        problem, far, preconditioner=PreconditionerKind.DIAGONAL, held_out=2000, seed=8
    )
    _, high = designed.network.ranges["q_d.x"]
    held_out = designed.family.held_out(2000, seed=10)
    assert max(sample["q_d.x"].max() for sample in held_out) > high
    assert designed.validation.share == 1.0
