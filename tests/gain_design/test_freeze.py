"""The freeze: which candidates are compared."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ann_dc.gain_design import WITH_COORDINATORS, freeze

BOOST = 4.0
FIRST: Any = SimpleNamespace(state=np.zeros(1), boost=BOOST)


def factors(monkeypatch, ratio) -> list[float]:
    """Factors on the first run's penalty that are tried, where ``ratio`` is of the factor."""

    def candidate_of(linear, state, recipe, boost):
        spectrum = SimpleNamespace(ratio=ratio(boost / BOOST))
        return freeze.Candidate(
            recipe=recipe, boost=boost, gains=cast(Any, None), spectrum=cast(Any, spectrum)
        )

    monkeypatch.setattr(freeze, "candidate_of", candidate_of)
    candidates = freeze.compare(cast(Any, None), FIRST, (WITH_COORDINATORS,))
    return [candidate.boost / BOOST for candidate in candidates]


def test_downhill_to_the_smallest_ratio(monkeypatch):
    assert factors(monkeypatch, lambda f: abs(np.log2(f / 8))) == [1, 0.5, 2, 4, 8, 16]
    assert factors(monkeypatch, lambda f: abs(np.log2(f * 4))) == [1, 0.5, 2, 0.25, 0.125]


def test_where_the_first_run_froze_unstable_the_penalty_grows(monkeypatch):
    found = factors(monkeypatch, lambda f: np.inf if f < 4 else f)
    assert found == [1, 2, 4, 8]


@pytest.mark.parametrize(
    ("ratio", "last"),
    [
        (lambda f: 1 / f, 2 * freeze.LARGEST_FACTOR),
        (lambda f: f, 0.5 / freeze.LARGEST_FACTOR),
        (lambda f: np.inf, 2 * freeze.LARGEST_FACTOR),
    ],
    ids=["up", "down", "never stable"],
)
def test_a_descent_ends_either_way(monkeypatch, ratio, last):
    """The octave next to the largest factor is looked at, and none beyond it."""
    assert factors(monkeypatch, ratio)[-1] == last
