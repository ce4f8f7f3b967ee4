"""Examples of property tests: always the same ones in `make test`, others in `make fuzz`.

`make fuzz` sets ``FUZZ_SEED``, which it prints, and ``FUZZ``, the number of examples relative to
that of `make test`. The same two numbers give the same examples again, test by test.
"""

import os

import hypothesis
import pytest
from hypothesis import is_hypothesis_test, seed, settings
from hypothesis.internal.conjecture import providers

SEED = int(os.environ.get("FUZZ_SEED") or 0)
"""Seed of `make fuzz`; 0 in `make test`."""
TIMES = int(os.environ.get("FUZZ") or 1) if SEED else 1
"""Number of examples relative to that of `make test`."""


def load_profile() -> None:
    """Load the settings of all property tests: no time limit and no memory of earlier runs.

    Hypothesis also draws numbers that occur in the modules that are loaded, and these depend on
    the tests that the same process ran before. So it gets none.
    """
    check_private(providers, "_get_local_constants", "Constants")
    providers._get_local_constants = providers.Constants
    repeatable = {"derandomize": not SEED, "print_blob": bool(SEED), "database": None}
    settings.register_profile("ann_dc", deadline=None, **repeatable)
    settings.load_profile("ann_dc")


def check_private(owner: object, *names: str) -> None:
    """Raise an error if hypothesis lacks private names that this module uses."""
    missing = [name for name in names if not hasattr(owner, name)]
    assert not missing, (
        f"hypothesis {hypothesis.__version__} has no {', '.join(missing)} in {owner!r:.60}; adapt "
        "tests/seeds.py, or examples depend on the order of the tests"
    )


def seeds(count: int, first: int = 0):
    """Parametrize a test by ``seed``: ``count`` numbers from ``first``; in `make fuzz` others."""
    chosen = range(SEED, SEED + TIMES * count) if SEED else range(first, first + count)
    marks = pytest.mark.property
    return pytest.mark.parametrize("seed", [pytest.param(each, marks=marks) for each in chosen])


def mark_properties(items: list) -> None:
    """Mark tests that hypothesis runs as properties; in `make fuzz` they get more examples."""
    properties = [item for item in items if is_hypothesis_test(getattr(item, "obj", None))]
    for item in properties:
        item.add_marker(pytest.mark.property)
    for test in {item.obj for item in properties if SEED}:
        check_private(test, "_hypothesis_internal_use_settings")
        own = test._hypothesis_internal_use_settings
        more = settings(own, max_examples=TIMES * own.max_examples)
        test._hypothesis_internal_use_settings = more
        seed(SEED)(test)
