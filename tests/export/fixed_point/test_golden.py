"""Networks in integers: as accurate as asked, bit for bit as told, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from clamped_runs import with_limits
from designs import wired_with
from fixed_points import PROBLEMS, in_integers, pressed, walk, walked

import ann_dc
from ann_dc.errors import ArgumentError, ExportError
from ann_dc.export.fixed_point import formats
from ann_dc.export.fixed_point.machine import Integers
from ann_dc.export.fixed_point.widths import fixed_point
from ann_dc.export.reference.vector import reference_vector
from ann_dc.lowering.writing import program_of
from ann_dc.network.preconditioners.diagonal import Diagonal

QUICK = ["double_integrator", "car", "bounds", "objectives"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", QUICK)
def test_integers_are_what_the_rules_say(name):
    """Another machine, with integers that cannot overflow, comes to the same states."""
    model = in_integers(name)
    assert model.states_after(5).tolist() == walk(model, 5)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_integers_are_what_the_rules_say_for_long(name):
    model = in_integers(name)
    assert model.states_after(2000).tolist() == walk(model, 2000)


@pytest.mark.parametrize("name", QUICK)
def test_controls_are_as_accurate_as_asked(name):
    """Where it settles, and long after; judged by another backend's end."""
    network, _ = walked(name)
    model = in_integers(name)
    end = network.unpack(ann_dc.OdeBackend().run(network).trajectory.final)
    controls = network.of_population("u")
    own = network.cell.neurons
    wanted = np.array([own[p].scale.user(end[p, k]) for p, k in network.places[controls]])
    for steps in (model.steps, 3 * model.steps):
        states = np.ldexp(
            model.states_after(steps).astype(float),
            -model.fraction[model.machine.neurons[:, 0]] - model.machine.guard,
        )
        found = network.user_units(states)[controls]
        assert np.abs(found - wanted).max() < 1.2e-3 * np.abs(wanted).max()
    assert model.error <= 1e-3


def test_words_of_16_bits_are_enough_for_the_car():
    assert fixed_point(*walked("car"), bits=16).error <= 1e-3


def test_wider_words_are_more_accurate():
    errors = [fixed_point(*walked("car"), bits=bits, accuracy=1.0).error for bits in (10, 12, 16)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-1 * errors[0]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", list(ann_dc.PreconditionerKind))
def test_every_preconditioner_is_carried(kind):
    model = fixed_point(*walked("double_integrator", kind))
    assert model.error <= 1e-3


def test_rails_hold():
    """The acceleration is limited to 1: it comes to its rails, and never past them."""
    network, _ = walked("bounds")
    model = in_integers("bounds")
    at = network.of_population("u")
    _, _, low, high, *_ = model.machine.neurons[at].T
    ends = []
    for steps in range(0, model.steps, 16):
        states = model.states_after(steps)[at]
        assert ((low <= states) & (states <= high)).all()
        ends.append(((states == low) | (states == high)).any())
    assert any(ends)


@pytest.mark.parametrize(
    "kind", [ann_dc.PreconditionerKind.RESISTIVE_GRID, ann_dc.PreconditionerKind.CYCLIC_REDUCTION]
)
def test_rails_of_coupled_neurons_are_refused_by_name(kind):
    network = with_limits(wired_with("double_integrator", kind), 0.5, "u")
    with pytest.raises(
        ExportError, match=rf"its {kind.value} couples neurons with saturation limits \(u\.a\)"
    ):
        program_of(network, 0.1)
    assert len(program_of(replace(network, preconditioner=Diagonal()), 0.1).limits) == network.size


def test_rails_of_neurons_that_the_preconditioner_does_not_couple_are_carried():
    network = with_limits(
        wired_with("double_integrator", ann_dc.PreconditionerKind.MULTILEVEL), 0.5, "u"
    )
    assert np.isfinite(program_of(network, 0.1).limits).any()


def test_a_drive_that_a_rail_stops_does_not_saturate():
    """No walk in floating point shows how large it is: it counts as zero there."""
    model = fixed_point(*pressed(), bits=16)
    assert model.model({}).settle(model.limit).settled[0]
    assert model.error == 0


def test_a_number_that_a_walk_cuts_off_is_named(monkeypatch):
    """Words of states have half of the range that they need, or arguments of functions."""
    monkeypatch.setattr(formats, "HEADROOM", 0.5)
    with pytest.raises(ExportError, match=r"vector: \S.* leaves -[\d.e+-]+ \.\. [\d.e+-]+ network"):
        fixed_point(*walked("double_integrator"), bits=16)


def test_it_settles_where_its_vector_ends_and_only_there():
    model = in_integers("car")
    run = Integers(model.machine).settle(10 * model.steps)
    assert run.steps.tolist() == [model.steps]
    assert run.states[:, 0].tolist() == model.vectors[model.steps].tolist()


def test_other_inputs_settle_elsewhere():
    """Words of inputs are written as a user of the C code writes them."""
    network, _ = walked("double_integrator")
    model = in_integers("double_integrator", 16)
    machine = Integers(model.machine)
    target = next(port for port in model.inputs if port.name == "q_d.x")
    fraction = int(model.fraction[target.words[0]])
    number = round(target.scale.network(0.5) * 2**fraction)
    machine.load(target.words, np.full(len(target.words), number))
    machine.run(20_000)
    expected = reference_vector(network.with_inputs({"q_d.x": 0.5}))
    assert model.control_error(machine.states, expected) < 5e-3


def test_a_word_too_small_says_what_it_costs():
    with pytest.raises(ExportError, match=r"words of 10 bits .* control error .* use bits=12 \("):
        fixed_point(*walked("car"), bits=10)


@pytest.mark.parametrize(("name", "bits", "node"), [("car", 6, "cos"), ("cstr", 8, "reciprocal")])
def test_a_node_that_words_cannot_carry_is_named(name, bits, node):
    with pytest.raises(ExportError, match=rf"words of {bits} bits cannot carry {node}\("):
        fixed_point(*walked(name), bits=bits)


def test_accuracy_beyond_all_words_is_refused():
    with pytest.raises(ExportError, match="no word of up to 32 bits"):
        fixed_point(*walked("double_integrator"), accuracy=1e-12)


def test_bits_and_accuracy_are_checked():
    network, vector = walked("double_integrator")
    with pytest.raises(ExportError, match="expected 4 to 32"):
        fixed_point(network, vector, bits=3)
    with pytest.raises(ArgumentError, match="bits"):
        fixed_point(network, vector, bits=33)
    with pytest.raises(ArgumentError, match="accuracy"):
        fixed_point(network, vector, accuracy=0.0)


def test_a_walk_that_does_not_settle_is_refused():
    network, vector = walked("double_integrator")
    with pytest.raises(ExportError, match="settles within the steps"):
        fixed_point(network, replace(vector, steps=-1))
