"""States over network time: the users' units, the controls among them, errors against an end."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc.backends.trajectory import Trajectory, control_error, control_values
from ann_dc.errors import UnknownNameError
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.scale import Scale

Q, U = Neuron(name="q.x", scale=Scale(2.0)), Neuron(name="u.a", scale=Scale(-3.0))
BOTH = Network(cell=Cell(neurons=(Q, U), connections=()), stages=2)
ALONE = Network(cell=Cell(neurons=(Q,), connections=()), stages=2)

TIME = np.array([0.0, 1.0, 2.0])
STATES = np.exp(-TIME)[:, None] * np.array([1.0, 2.0])
"""(T, stages): every neuron of every cell decays to zero."""


def decaying(network: Network) -> Trajectory:
    """x = exp(-s) in cell 0, twice that in cell 1; the residuals are those of a decay, too."""
    values = np.stack([STATES] * len(network.cell.neurons), axis=1)
    return Trajectory(
        network=network,
        time=TIME,
        states=network.pack(values),
        residual_time=TIME,
        residuals=np.stack([np.exp(-TIME), np.exp(TIME - 2.0)], axis=1),
    )


def test_the_larger_residual_counts():
    np.testing.assert_allclose(decaying(BOTH).kkt, np.exp([0.0, -1.0, 0.0]))


def test_the_end_is_the_last_state():
    np.testing.assert_array_equal(decaying(BOTH).final, decaying(BOTH).states[2])


@pytest.mark.parametrize("neuron", [Q, U], ids=lambda neuron: neuron.name)
def test_a_neuron_is_read_by_name_in_the_users_units(neuron):
    np.testing.assert_allclose(decaying(BOTH)[neuron.name], neuron.scale.factor * STATES)


def test_an_unknown_neuron_is_named():
    with pytest.raises(UnknownNameError, match=r"q\.y"):
        decaying(BOTH)["q.y"]


def test_controls_are_the_neurons_u():
    np.testing.assert_allclose(decaying(BOTH).controls, U.scale.factor * STATES)


def test_all_neurons_of_no_optimiser_count_as_controls():
    np.testing.assert_allclose(decaying(ALONE).controls, Q.scale.factor * STATES)


def test_a_control_that_is_absent_is_none():
    absent = Omitted(neuron="u.a", stage=1)
    network = Network(cell=BOTH.cell, stages=2, omitted=(absent,))
    assert control_values(network, np.ones(network.size)).shape == (1,)
    assert control_values(network, np.ones((5, network.size))).shape == (5, 1)


def test_the_end_has_no_error():
    wanted = decaying(BOTH)
    assert control_error(wanted.control_values[-1], wanted) == 0.0


@pytest.mark.parametrize("share", [-0.5, 0.01, 3.0])
def test_an_error_is_told_over_the_largest_control(share):
    """All controls off by the same share: the largest one is off by that."""
    wanted = decaying(BOTH)
    found = control_error((1 + share) * wanted.control_values[-1], wanted)
    assert found == pytest.approx(abs(share))


@pytest.mark.parametrize("rest", [0.0, 1e-12, 1e-3])
def test_control_error_of_controls_that_rest_at_zero_is_a_share_of_their_reach(rest):
    """They come from 2 and end at or near zero: 1 % of 2 is what an error is related to."""
    moved = decaying(BOTH)
    vanished = replace(moved, states=np.vstack([moved.states[:-1], 0 * moved.final + rest]))
    assert vanished.control_size == pytest.approx(0.02)
    assert vanished.size_in_words.startswith("1% of the largest magnitude of the controls")
    off = vanished.control_values[-1] + [0.0, 1e-5]
    assert control_error(off, vanished) == pytest.approx(5e-4)
    assert moved.size_in_words == "the largest control"


@pytest.mark.parametrize("units", [{}, {"u.a": "kW"}])
@pytest.mark.parametrize(
    ("kept", "says"),
    [
        (1.0, "the largest distance of a control from its offset ({})"),
        (1e-9, "1% of the largest distance of the controls from their offset on their way "
               "(they settle near it: {})"),
        (0.0, "1% of the scale of the controls (they stay at their offset: {})"),
    ],
)  # fmt: skip
def test_size_of_controls_with_offset_counts_from_it_and_names_it(kept, says, units):
    """Controls at 5 kW, 0 in the network, do not stay at zero; the number is the one named."""
    scale = Scale(factor=100.0, offset=5.0)
    network = replace(BOTH, cell=replace(BOTH.cell, neurons=(Q, replace(U, scale=scale))))
    moved = decaying(network).measured_in(units)
    states = moved.states if kept else 0 * moved.states
    ended = replace(moved, states=np.vstack([states[:-1], kept * states[-1]]), units=units)
    assert ended.size_in_words == says.format(f"u.a 5 {units.get('u.a', '')}".rstrip())
    off = np.abs(ended.controls - 5.0)  # the user's units
    named = [off[-1].max(), 0.01 * off.max(), 0.01 * 100.0][(1.0, 1e-9, 0.0).index(kept)]
    assert 100.0 * ended.control_size == pytest.approx(named)


def test_control_error_of_controls_that_never_move_is_a_share_of_their_scale():
    moved = decaying(BOTH)
    still = replace(moved, states=0 * moved.states)
    assert control_error(np.array([1e-5, 0.0]), still) == pytest.approx(1e-3)


def test_rows_that_were_half_computed_are_computed_again(monkeypatch):
    """Times and middle states are stored at once: another thread never finds one of them alone."""
    dense = decaying(BOTH).with_between(lambda known, at: known[1][: len(at)], with_middles=True)
    joined, calls = np.concatenate, []

    def interrupted(*given, **named):
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return joined(*given, **named)

    with monkeypatch.context() as patched:
        patched.setattr(np, "concatenate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            assert dense.time is not None
    assert len(dense.time) == len(dense.states) == 5
