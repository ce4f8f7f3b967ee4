"""One problem by the two-level algorithm: what is known before, what came of it."""

import numpy as np
import pytest

from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.problem import plants
from ann_dc.two_level.coordination import (
    COORDINATORS,
    Coordination,
    Undesigned,
    best_gradient,
    coordinate,
    newton,
)
from ann_dc.two_level.lower_level import Iterated

MASS = plants.double_integrator(N=5)


def coordinated(**options) -> Coordination:
    found = coordinate(MASS, **options)
    assert isinstance(found, Coordination)
    return found


@pytest.mark.parametrize(
    ("coordinator", "lower", "names"),
    [
        (best_gradient, None, ("gradient", "closed")),
        pytest.param(
            *(best_gradient, Iterated(tolerance=1e-10), ("gradient", "iterated")),
            marks=pytest.mark.slow,
        ),
        (newton, None, ("newton", "linearised")),
    ],
    ids=["gradient", "iterated", "newton"],
)
def test_it_settles_to_the_optimum(coordinator, lower, names):
    """Least effort from rest to rest: a = 20, 10, 0, -10, -20, whose halved squares are 500."""
    found = coordinated(coordinator=coordinator, lower=lower)
    assert (found.coordinator, found.lower) == names
    assert found.certified
    assert found.certificate.objective == pytest.approx(500, rel=1e-6)
    np.testing.assert_allclose(found.values["a"], [20, 10, 0, -10, -20], atol=1e-3)
    assert [found.values[name][-1] for name in ("x", "v")] == pytest.approx([1, 0])
    assert len(found.theta) == found.run.rounds + 1
    assert not found.elsewhere
    assert found.needed is not None
    assert found.needed <= found.run.rounds


def test_iterations_are_counted_to_the_tolerance_and_go_on_beyond():
    found = coordinated(coordinator=newton, settling=Settling(tolerance=1e-4, confirm=0.1))
    assert found.tolerance == 1e-4
    assert found.run.tolerance == pytest.approx(1e-5)


def test_without_gains_nothing_is_predicted():
    assert coordinated(coordinator=newton).predicted is None
    found = coordinated()
    assert found.gains is not None
    assert found.predicted == pytest.approx(found.gains.predicted(1e-6))


def test_what_did_not_settle_is_not_certified():
    found = coordinated(coordinator=COORDINATORS["oracle"], limit=3)
    assert found.outcome is Outcome.NOT_SETTLED
    assert found.message.startswith("not settled after 3 outer iterations")
    assert found.needed is None
    assert not found.certified
    assert found.verdict == "the two levels did not settle"


@pytest.mark.slow
def test_without_a_solution_there_is_no_run():
    """One stage cannot bring a mass to rest anywhere."""
    found = coordinate(plants.double_integrator(N=1))
    assert isinstance(found, Undesigned)
    assert not found.certified
    assert "the design did not settle" in found.message
