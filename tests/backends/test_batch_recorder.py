"""The record of a batch: every sample its own curve, with its end, in bounded memory."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ann_dc.backends.batch import BatchRecorder


def recorded(lasts, most):
    """Samples that run for so many looks each: at look k, sample s is in state 100 s + k."""
    recorder = BatchRecorder(most)
    for look in range(max(lasts)):
        samples = np.flatnonzero(np.array(lasts) > look)
        states = (100.0 * samples + look)[:, None]
        both = np.full((len(samples), 2), float(look))
        recorder.record(samples, np.full(len(samples), look / 2), states, both)
    ends = 100.0 * np.arange(len(lasts)) + np.array(lasts) - 1
    return recorder.curves(ends[:, None], np.repeat(np.array(lasts, float)[:, None] - 1, 2, axis=1))


LASTS = st.lists(st.integers(1, 40), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None)
@given(LASTS, st.integers(2, 50))
def test_every_sample_has_its_own_curve_and_its_end(lasts, most):
    curves = recorded(lasts, most)
    for sample, last in enumerate(lasts):
        rows = slice(*curves.first[sample : sample + 2])
        checks = curves.states[rows, 0] - 100.0 * sample
        assert checks[0] == 0
        assert checks[-1] == last - 1
        assert len(checks) <= most + 1
        assert (np.diff(checks) > 0).all()
        np.testing.assert_array_equal(curves.time[rows], checks / 2)
        np.testing.assert_array_equal(curves.residuals[rows], np.stack([checks, checks], axis=1))
        if last <= most:  # however long the others went on
            assert len(checks) == last
    assert curves.first[-1] == len(curves.time)


def test_the_end_stands_for_what_was_seen_at_its_time():
    recorder = BatchRecorder(5)
    recorder.record(np.array([0]), np.zeros(1), np.ones((1, 1)), np.ones((1, 2)))
    curves = recorder.curves(np.full((1, 1), 7.0), np.zeros((1, 2)))
    assert curves.states.tolist() == [[7.0]]
    assert curves.residuals.tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("sample", [2, -3, 99])
def test_there_is_no_such_sample(sample):
    with pytest.raises(IndexError):
        recorded([3, 4], 5).trajectory(sample, None)
