"""What a batch says of its samples."""

import re
from dataclasses import replace

import numpy as np
import pytest
from designs import designed
from recurrent_runs import RECURRENT, growing, pole, short, targets

from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import FixedStep
from ann_dc.errors import ArgumentError, NetworkError
from ann_dc.evaluation.reference import evaluator


def test_a_sample_that_is_no_number_costs_itself_alone():
    network, goals = designed("car").network, np.full((5, 9), 5.0)
    whole = RECURRENT.run_batch(network, {"q_d.x": goals})
    goals[1, -1], goals[3] = np.nan, np.nan
    run = RECURRENT.run_batch(network, {"q_d.x": goals})
    assert run.settled.tolist() == [True, False, True, False, True]
    np.testing.assert_allclose(run.states[[0, 2, 4]], whole.states[[0, 2, 4]], atol=1e-9)
    for sample in (1, 3):
        assert run.message(sample) == f"sample {sample}: input q_d.x is not a finite number"
        assert run.message(sample) in str(run)
        with pytest.raises(NetworkError, match=r"q_d.x.* is not finite"):
            run.network_of(sample)


def test_a_batch_tells_how_it_ended():
    network, rng = short("unicycle"), np.random.default_rng(2)
    goals = rng.uniform(1.5, 2.5, 20)
    run = RECURRENT.run_batch(network, {"q_d.x": goals})
    steps = run.settling_steps
    said = f"20 of 20 samples settled, in {int(np.median(steps))} steps (median), at most "
    assert str(run) == said + str(steps.max())
    assert len(run) == 20
    goals[:13] = np.nan
    lines = str(RECURRENT.run_batch(network, {"q_d.x": goals})).splitlines()
    assert lines[0].startswith("7 of 20 samples settled, in ")
    assert [line.strip().partition(":")[0] for line in lines[1:-1]] == [
        f"sample {i}" for i in range(10)
    ]
    assert lines[-1] == "  and 3 more"


def test_a_batch_that_did_not_settle():
    run = replace(RECURRENT, limit=8).run_batch(short("car"), {"q_d.x": [5.0, 4.0]})
    assert run.outcomes == (Outcome.NOT_SETTLED,) * 2
    assert run.steps.tolist() == [8, 8]
    assert run.settling_steps.tolist() == [-1, -1]
    said = r"sample 1: not settled within the limit, after 8 steps, KKT residual \d.\de[+-]\d+"
    assert re.fullmatch(said, run.message(1))
    assert str(run).startswith("0 of 2 samples settled\n  sample 0: not settled")


def test_a_sample_that_diverges_is_told_by_name():
    run = replace(RECURRENT, step=FixedStep(step=0.5)).run_batch(growing(), {"push": [0.0, 1.0]})
    assert run.outcomes == (Outcome.SETTLED, Outcome.DIVERGED)
    said = r"sample 1: diverged, after \d+ steps: neuron x\[2\] reached \S+"
    assert re.fullmatch(said, run.message(1))


def test_a_sample_that_leaves_a_domain():
    backend = replace(RECURRENT, step=FixedStep(step=0.2))
    run = backend.run_batch(pole(), {"pull": [2.0, 40.0, 1.0]})
    assert run.outcomes == (Outcome.SETTLED, Outcome.LEFT_DOMAIN, Outcome.SETTLED)
    np.testing.assert_allclose(run.states[[0, 2]], [[0.5], [1.0]], rtol=1e-7)
    assert run.message(1).startswith("sample 1: left the domain of a function block, after ")


def test_network_of_a_sample():
    network, goals = short("car"), targets("car", 3)
    run = RECURRENT.run_batch(network, goals)
    own = run.network_of(2)
    assert own.cell is network.cell
    for name in network.cell.inputs:
        expected = goals[name][2] if name in goals else network.inputs[name]
        np.testing.assert_array_equal(own.inputs[name], np.broadcast_to(expected, 6))
    np.testing.assert_allclose(evaluator(own).rhs(run.states[2]), 0.0, atol=1e-6)


def test_every_sample_of_one_set_of_inputs_has_a_network():
    network = short("unicycle")
    run = RECURRENT.run_batch(network, {"q_d.x": 1.5}, np.repeat([network.start_state], 3, axis=0))
    assert all(run.network_of(sample).inputs["q_d.x"][0] == 1.5 for sample in range(3))
    assert run.message(2).startswith("sample 2: settled")


def test_an_infinite_input_costs_its_sample_alone():
    run = RECURRENT.run_batch(short("unicycle"), {"q_d.x": [1.5, np.inf]})
    assert run.settled.tolist() == [True, False]
    assert run.message(1) == "sample 1: input q_d.x is not a finite number"


GOALS = (1.0, 2.0, 2.5)


@pytest.fixture(scope="module")
def kept():
    return replace(RECURRENT, curves=10_000).run_batch(short("unicycle"), {"q_d.x": GOALS})


@pytest.mark.parametrize("look", [1, 2, 7])
def test_a_curve_is_where_shorter_runs_end(kept, look):
    """A batch looks at every fifth step."""
    ended = replace(RECURRENT, limit=5 * look).run_batch(short("unicycle"), {"q_d.x": GOALS})
    for sample in range(3):
        trajectory = kept.trajectory(sample)
        np.testing.assert_array_equal(trajectory.states[look], ended.states[sample])
        np.testing.assert_array_equal(trajectory.residuals[look], ended.residuals[sample])


@pytest.mark.parametrize("sample", range(3))
def test_the_curve_of_a_sample_is_about_that_sample(kept, sample):
    trajectory = kept.trajectory(sample)
    np.testing.assert_array_equal(trajectory.network.inputs["q_d.x"], GOALS[sample])
    np.testing.assert_array_equal(trajectory.final, kept.states[sample])
    np.testing.assert_array_equal(trajectory.residuals[-1], kept.residuals[sample])
    assert len(trajectory.time) == len(trajectory.residuals) == kept.steps[sample] // 5 + 1
    assert (np.diff(trajectory.time) > 0).all()
    assert "q.x[1]" in trajectory.curves.columns()


def test_curves_change_nothing_and_are_thinned(kept):
    thin = replace(RECURRENT, curves=6).run_batch(short("unicycle"), {"q_d.x": GOALS})
    np.testing.assert_array_equal(thin.states, kept.states)
    for sample in range(3):
        assert 3 <= len(thin.trajectory(sample).time) <= 7
        np.testing.assert_array_equal(thin.trajectory(sample).final, kept.states[sample])
        assert set(thin.trajectory(sample).time) <= set(kept.trajectory(sample).time)


def test_without_curves_a_sentence_says_how_to_keep_them():
    run = RECURRENT.run_batch(short("unicycle"), {"q_d.x": [2.0]})
    assert run.curves is None
    with pytest.raises(NetworkError, match=r"stored no trajectories; .*curves=200"):
        run.trajectory(0)


def test_a_sample_that_is_no_number_has_no_curve():
    backend = replace(RECURRENT, curves=100)
    run = backend.run_batch(short("unicycle"), {"q_d.x": [np.nan, 2.0]})
    assert run.trajectory(1).final.tolist() == run.states[1].tolist()
    with pytest.raises(NetworkError, match="not finite"):
        run.trajectory(0)


@pytest.mark.parametrize("curves", [-1, 2.5, True, "many", None])
def test_curves_are_a_number_of_states(curves):
    with pytest.raises(ArgumentError, match="curves: expected a whole number"):
        replace(RECURRENT, curves=curves).run_batch(short("unicycle"), {"q_d.x": [2.0]})
