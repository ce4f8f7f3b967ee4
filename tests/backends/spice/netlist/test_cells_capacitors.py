"""Switched capacitors in ngspice are the recurrent layer, sample by sample."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from simulator import needs_ngspice
from wired import neighbour_wired

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import read_back
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.step_rules import FixedStep
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import switched_capacitor
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize


@cache
def short_lq() -> Network:
    problem = plants.double_integrator(N=3, dt=0.5, q_0=(1, 0), q_d=(0, 0))
    return design(synthesize(problem), preconditioner=(PreconditionerKind.DIAGONAL,)).network


@cache
def clocked(name: str, horizon: int | None):
    """(network, settled point, half of the largest stable step)."""
    network = short_lq() if name == "lq" else neighbour_wired(name, horizon)
    final = OdeBackend(method=DOP853, verify=False).run(network).trajectory.final
    return network, 0.5 * stability_limit(network, final)


def recurrent(network: Network, step: float, cycles: int) -> np.ndarray:
    """States (cycles + 1, n) of the recurrent layer with a fixed step."""
    layer = RecurrentLayer(network, step=FixedStep(step=step))
    states = [torch.tensor(network.start_state)[None]]
    with torch.no_grad():
        for _ in range(cycles):
            states.append(layer(states[-1], steps=1))
    return torch.cat(states).numpy()


def full_scales(circuit) -> np.ndarray:
    """Of every neuron in its own units; of a dual that of the op amp that it is part of."""
    network, units = circuit.schematic.network, dict(circuit.scaling.unit)
    units |= {p.dual: units[p.name] for p in circuit.schematic.parts if isinstance(p, PICell)}
    names = [neuron.name for neuron in network.cell.neurons]
    return np.array([units[names[row]] for row, _ in network.places])


def sampled(name: str, horizon: int | None, cycles: int, deviations=None, **given):
    """(states of a circuit, of the layer) once a period, in units of full scale."""
    network, step = clocked(name, horizon)
    level = switched_capacitor(step=step, **given)
    circuit, probe = SpiceBackend(level=level).prepare(network)
    written = deck_of(circuit, level, duration=cycles * step, deviations=deviations)
    raw = Ngspice(timeout=300).run(written.text, end_time=written.end)
    got = read_back(circuit, written, raw, probe).trajectory.states
    return got / full_scales(circuit), recurrent(network, step, cycles) / full_scales(circuit)


LQ = ("lq", None)
"""The double integrator from (1, 0) to rest in three steps of half a second: u = (-2, 0, 2)."""


@pytest.mark.slow
@needs_ngspice
def test_a_switched_capacitor_circuit_is_the_recurrent_layer_sample_by_sample():
    """Every neuron after every one of 200 periods; what is left is 1 / A0."""
    errors = []
    for a0 in (1e5, 1e7):
        got, wanted = sampled(*LQ, 200, a0=a0)
        assert got.shape == wanted.shape
        errors.append(np.abs(got - wanted).max())
    assert errors[0] < 2e-4
    assert errors[1] < 2e-6
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.1)


@pytest.mark.slow
@needs_ngspice
def test_the_first_periods_of_the_switched_capacitor_car():
    got, wanted = sampled("car", None, 3, a0=1e5)
    assert np.abs(got - wanted).max() < 1e-4


@needs_ngspice
@pytest.mark.slow
def test_a_hundred_periods_of_the_switched_capacitor_car():
    got, wanted = sampled("car", None, 100, a0=1e5)
    assert np.abs(got - wanted).max() < 1e-3


def charge_error(**given) -> float:
    got, wanted = sampled(*LQ, 10, a0=1e7, **given)
    return float(np.abs(got - wanted).max())


@pytest.mark.slow
@needs_ngspice
def test_charge_injection_grows_with_the_overlap_and_shrinks_with_the_capacitors():
    """What is left of the charge c_ov V of the clock edges, over the capacitors of the branches."""
    none = charge_error()
    small = charge_error(overlap=1e-15)
    assert none < 1e-5 < 1e-3 < small
    assert charge_error(overlap=2e-15) / small == pytest.approx(2, rel=0.1)
    assert charge_error(overlap=1e-15, unit_capacitor=4e-12) < 0.25 * small


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    ("resistor", "connection"), [("r_u_a_0", "u.a<-u.a"), ("r_m_v_2", "c.v<-u.a")]
)
def test_a_capacitor_that_is_off_is_a_weight_that_is_off(resistor, connection):
    """In PI duals both paths of a weight: branch and static capacitor."""
    got, nominal = sampled(*LQ, 20, {resistor: 0.01}, a0=1e7)
    network, step = clocked(*LQ)
    connections = tuple(
        replace(c, weight=np.asarray(c.weight) / 1.01) if c.name == connection else c
        for c in network.cell.connections
    )
    assert connections != network.cell.connections
    off = replace(network, cell=replace(network.cell, connections=connections))
    circuit, _ = SpiceBackend(level=switched_capacitor(step=step)).prepare(network)
    moved = recurrent(off, step, 20) / full_scales(circuit)
    primal = ~network.of_population("mu", "beta")  # mu = m - rho c is read with the nominal c
    assert np.abs(moved - nominal)[:, primal].max() > 1e-5
    assert np.abs(got - moved)[:, primal].max() < 0.05 * np.abs(moved - nominal)[:, primal].max()
