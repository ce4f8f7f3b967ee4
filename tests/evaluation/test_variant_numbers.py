"""Numbers of networks of one wiring, and what is refused as another wiring."""

from dataclasses import replace

import numpy as np
import pytest
from designs import coordinated, small, wired_with

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers, numbers_of
from ann_dc.hardware.nonidealities.numbers import detuned, mismatch
from ann_dc.hardware.nonidealities.parts import extra_pole
from ann_dc.network.cell import Cell, Limiter, Neuron
from ann_dc.network.ends import FixedNeuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind


def network() -> Network:
    return coordinated("car")


def with_cell(**changes) -> Network:
    return replace(network(), cell=replace(network().cell, **changes))


def with_neuron(**changes) -> Network:
    first, *rest = network().cell.neurons
    return with_cell(neurons=(replace(first, **changes), *rest))


def other_gains() -> Network:
    preconditioner = network().preconditioner
    gains = tuple(1.1 * gain for gain in preconditioner.gains)
    return replace(network(), preconditioner=replace(preconditioner, gains=gains))


def test_they_are_those_that_evaluators_read():
    networks = [network(), mismatch(detuned(network(), 0.1, seed=1), 0.1, seed=2)]
    numbers = numbers_of(networks)
    for sample, own in enumerate(networks):
        tape = evaluator(own).tape
        np.testing.assert_array_equal(numbers.weights[sample], tape.weights)
        np.testing.assert_array_equal(numbers.rates[sample], tape.rates)


def test_the_network_of_a_sample_is_the_one_whose_numbers_these_are():
    networks = [network(), mismatch(detuned(network(), 0.1, seed=1), 0.1, seed=2)]
    numbers = numbers_of(networks)
    for sample, own in enumerate(networks):
        found = numbers_of([numbers.network_of(network(), sample)])
        np.testing.assert_array_equal(found.weights[0], evaluator(own).tape.weights)
        np.testing.assert_allclose(found.rates[0], evaluator(own).tape.rates, rtol=1e-15)


OTHERS = {
    "problem": (lambda: small("unicycle"), "number 1 has other inputs than the first: q_0.phi"),
    "rails": (lambda: with_neuron(limiter=Limiter(low=-1.0)), "other neurons than the first: q.x"),
    "wires": (
        lambda: with_cell(connections=network().cell.connections[:-1]),
        "other connections than the first: ",
    ),
    "blocks": (lambda: extra_pole(network(), 10.0), "number 1 has other"),
    "preconditioner": (other_gains, "other preconditioner than the first"),
    "kind of preconditioner": (
        lambda: wired_with("car", PreconditionerKind.DIAGONAL),
        "other preconditioner",
    ),
    "pins": (
        lambda: replace(
            network(), fixed=(*network().fixed, FixedNeuron(neuron="u.nu", stage=0, input="q_0.x"))
        ),
        "other fixed",
    ),
    "inputs": (lambda: network().with_inputs({"q_d.x": 9.0}), "q_d.x; pass them to run_batch"),
    "start": (lambda: replace(network(), start={}), "other start than the first"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_wiring_is_refused_by_what_differs(name):
    make, message = OTHERS[name]
    with pytest.raises(NetworkError, match=message):
        numbers_of([network(), make()])


def test_rows_of_another_length_are_refused():
    cell = Cell(neurons=(Neuron(name="x"),))
    with pytest.raises(NetworkError, match="number 1 has other stages than the first"):
        numbers_of([Network(cell=cell, stages=stages) for stages in (2, 3)])


def test_words_make_no_other_wiring():
    assert len(numbers_of([network(), replace(network(), title="another")])) == 2


def test_what_is_no_number_of_the_network_is_refused():
    numbers = numbers_of([network()])
    with pytest.raises(NetworkError, match="networks: expected one network or more"):
        numbers_of([])
    with pytest.raises(NetworkError, match="weights: a number is not finite"):
        replace(numbers, weights=numbers.weights * np.nan)
    with pytest.raises(NetworkError, match=r"rates: expected an array \(B, rows, N\)"):
        replace(numbers, rates=numbers.rates[0])
    with pytest.raises(NetworkError, match="samples and stages differ"):
        Numbers(weights=numbers.weights, rates=numbers.rates[:, :, 1:])
    with pytest.raises(NetworkError, match="numbers: weights of a network with another wiring"):
        numbers.check(small("unicycle"))
    with pytest.raises(NetworkError, match="expected positive rates for neurons of"):
        replace(numbers, rates=np.abs(numbers.rates) * 0).check(network())
