"""A circuit's figure: volts and microseconds, N and dt in the title."""

import pytest

import ann_dc
from ann_dc import plotting

PROBLEM = ann_dc.plants.double_integrator(N=4)


@pytest.fixture(scope="module")
def drawn():
    network = ann_dc.design(PROBLEM, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    return plotting.circuit(ann_dc.SpiceBackend().run(network), PROBLEM)


def test_time_is_real_and_axes_have_units(drawn):
    assert [axes.get_ylabel() for axes in drawn.axes] == [
        "voltage (V)", "distance of the controls\n(relative to the largest control)",
    ]  # fmt: skip
    assert drawn.axes[-1].get_xlabel() == "time (µs)"


def test_the_title_carries_n_and_dt(drawn):
    head, outcome = drawn.get_suptitle().split("\n")
    assert head == "double_integrator: N = 4, dt = 0.1 s, as a circuit"
    assert outcome.startswith("within 0.1 % after ")


def test_no_decades_for_what_is_outside_of_the_picture(drawn):
    error, end = drawn.axes[1], drawn.axes[1].get_xlim()[1]
    seen = [line.get_ydata()[line.get_xdata() <= end].min() for line in error.lines[:2]]
    assert min(seen) / 10 < error.get_ylim()[0] <= min(seen)
