"""Noise of settled circuits: closed forms, and the noise analysis of ngspice."""

import re
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.spice.ngspice.raw import Raw, read_raw
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.noise_run import settled_noise
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.emulation.noise_currents import (
    Noise,
    draw_noise,
    noise_input,
    noise_sources,
    noisy_network,
    white,
)
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.levels import macro
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.network.cell import Cell, Connection, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize

BOLTZMANN = 1.380649e-23
KTC = np.sqrt(BOLTZMANN * 300 / 1e-12)
"""64.4 uV."""

LEVEL = macro(a0=1e5)


@cache
def prepared(name: str, level=LEVEL):
    network = design(
        synthesize(SUITE[name].problem), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    return SpiceBackend(level=level).prepare(network)


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """An emulation at its equilibrium."""

    emulation: Emulation
    x: np.ndarray


@cache
def settled(name: str) -> Settled:
    circuit, probe = prepared(name)
    emulation = emulate(circuit, LEVEL)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    return Settled(emulation=emulation, x=x)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


# ---- closed forms --------------------------------------------------------------------------------

SHARE = 1 / 20
"""Step of the samples over the time constant."""
BAND = 1 - 7 / 30 * SHARE
"""Voltage that samples joined by lines leave of white noise, for steps short of a time constant."""


def filtered(samples: np.ndarray, step: float, tau: float) -> np.ndarray:
    """tau x' = u - x for samples (..., K) of u that straight lines join, exactly."""
    decay = np.exp(-step / tau)
    mean = tau / step * (1 - decay)
    x = np.zeros(samples.shape)
    for k in range(samples.shape[-1] - 1):
        before, after = samples[..., k], samples[..., k + 1]
        x[..., k + 1] = decay * x[..., k] + (mean - decay) * before + (1 - mean) * after
    return x


def resistors_on_capacitors(circuits: int, count: int):
    """(circuits, K) amperes of resistors of 1 megohm, the step, and the volts on their 1 pF."""
    ohms, step = 1e6, SHARE * 1e-6
    density = Noise(step=step).thermal(1 / ohms)
    amperes = np.array([white(density, step, count, [0, i]) for i in range(circuits)])
    amperes[:, 0] = 0
    return amperes, step, filtered(ohms * amperes, step, ohms * 1e-12)


def test_thermal_noise_on_a_capacitor_is_ktc():
    _, _, volts = resistors_on_capacitors(300, 2000)
    settled = volts[:, 100:]  # 28000 time constants: 0.4 % is a standard deviation
    assert rms(settled) == pytest.approx(KTC, rel=0.03)
    assert rms(settled) == pytest.approx(KTC * BAND, rel=0.01)


@cache
def leaky():
    """A hundred integrators that forget, x' = 1 - x: emulation and settled state, and the level."""
    cell = Cell(
        neurons=(Neuron(name="u.x"),),
        inputs=("drive",),
        connections=(
            Connection(source="drive", target="u.x"),
            Connection(source="u.x", target="u.x", weight=-1.0),
        ),
    )
    level = macro(a0=1e6)
    network = Network(cell=cell, stages=100, inputs={"drive": 1.0})
    circuit, probe = SpiceBackend(level=level, bandwidth_margin=100).prepare(network)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    return Settled(emulation=emulation, x=x)


def test_an_integrator_with_a_leak():
    """A leak R across C, and 1/R in all at the virtual ground: kT/C * R sum(1/R)."""
    rest, circuit = leaky(), leaky().emulation.circuit
    leak, drive = circuit.resistors["u.x"][1, 0], circuit.resistors["u.x"][0, 0]
    variance = BOLTZMANN * 300 / circuit.capacitors["u.x"][0] * (1 + leak / drive)
    noise = settled_noise(rest.emulation, rest.x, Noise(step=1.0))
    volts = rest.emulation.controls(noise) / circuit.value_of("u.x")
    assert np.abs(volts) == pytest.approx(np.sqrt(variance), rel=0.01)


# ---- the emulation -------------------------------------------------------------------------------


def test_a_current_for_an_op_amps_voltage_acts_as_an_offset():
    """Noise of an op amp and an offset are one: exactly, but for what integrators pass on."""
    volts = 3e-3
    circuit, _ = prepared("car")
    still, moved = (
        InterpretedEvaluator(with_offset(circuit, 0.0)),
        InterpretedEvaluator(with_offset(circuit, volts)),
    )
    network = still.network
    for source in noise_sources(circuit):
        row = np.array([network.node_index[noise_input(source)]])
        still.set_inputs(row, -volts * source.conductance)
    start = network.start_state
    x = start + 0.1 * np.random.default_rng(0).standard_normal(network.size)
    shifted = network.unpack(x)
    for part in circuit.schematic.parts:  # an integrator's capacitor takes up its offset
        if isinstance(part, Integrator):
            volt = circuit.schematic.polarity[part.name] * circuit.scaling.value(part.name, volts)
            shifted[network.neuron_index[AmplifierNodes(part.name).held]] += volt
    expected = moved.rhs(x)
    assert still.rhs(network.pack(shifted)) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.abs(still.rhs(x) - expected).max() > 1e-3


def with_offset(circuit, offset: float) -> Network:
    """The network with inputs for noise, of a circuit whose op amps all have an offset."""
    names = [p.name for p in circuit.parameters if p.name.startswith("vos_")]
    emulation = emulate(circuit, LEVEL, dict.fromkeys(names, offset))
    return noisy_network(emulation, draw_noise(circuit, Noise(step=1e-8), 1e-8))


@pytest.mark.parametrize(
    ("band", "rails"), [(np.inf, np.inf), (np.inf, 5.0), (2e6, np.inf)], ids=["", "rails", "pole"]
)
def test_the_noise_of_a_multiplier_behind_an_integrator_with_a_leak(band, rails):
    """e_m^2 / (4 R C) of the lag that follows, less what the multiplier's own pole takes."""
    level = macro(a0=1e8, multiplier_bandwidth=band, multiplier_output_swing=rails)
    wires = [("drive", "u.x"), ("u.x", "u.x"), ("drive", "v"), ("v", "v"), ("vv", "u.x")]
    cell = Cell(
        neurons=(Neuron(name="u.x"), Neuron(name="v")),
        inputs=("drive",),
        blocks=(Product(name="vv", a="v", b="v"),),
        connections=tuple(
            Connection(source=s, target=t, weight=-1.0 if s == t else 1.0) for s, t in wires
        ),
    )
    network = Network(cell=cell, stages=1, inputs={"drive": 1.0})
    circuit, probe = SpiceBackend(level=level, bandwidth_margin=100).prepare(network)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    noise = Noise(step=1.0, temperature=0.0, multiplier=1e-6)
    found = emulation.controls(settled_noise(emulation, x, noise))[0] / circuit.value_of("u.x")
    leak, given = (circuit.resistors["u.x"][row, 0] for row in (1, 2))
    tau, pole = leak * circuit.capacitors["u.x"][0], 1 / (2 * np.pi * band)
    expected = 1e-6 * leak / given / np.sqrt(4 * (tau + pole))
    assert abs(found) == pytest.approx(expected, rel=0.02)


def test_the_noise_of_parts_is_that_of_their_datasheet():
    parts = Parasitics(amplifier_noise=5e-9, multiplier_noise=1e-6)
    found = Noise.of_parts(parts, step=1e-6, temperature=350.0, seed=4)
    expected = Noise(step=1e-6, temperature=350.0, amplifier=5e-9, multiplier=1e-6, seed=4)
    assert found == expected


def released(rest: Settled) -> str:
    """A circuit near its operating point, with no noise but of its resistors, without analysis."""
    circuit, program = rest.emulation.circuit, evaluator(rest.emulation.network)
    written = deck_of(circuit, LEVEL, duration=1.0)

    def quiet(found):
        text = re.sub(r"^(R\w* .*)$", r"\1 noisy=0", found[0], flags=re.M)
        return re.sub(r"^D\w* .*\n", "", text, flags=re.M)

    near = " ".join(
        f"v({node})={circuit.schematic.polarity[name] * circuit.scaling.volts(name, value):.9g}"
        for (name, stage), node in written.signals.items()
        for value in [program.node(rest.x, name)[stage]]
    )
    text = written.text
    for pattern, new in (
        (r"^\.subckt (opamp|mul4q|func_\w+) (.|\n)*?^\.ends \1$", quiet),
        (r"^V_rst .*$", "V_rst rst 0 0"),
        (r"^(V_src__t_x_\S+ \S+ 0 \S+)$", r"\1 AC 1"),
        (r"^\.(save|tran|end\b)(.*\n)(\+.*\n)*", ""),
    ):
        text, count = re.subn(pattern, new, text, flags=re.M)
        assert count
    return f"{text}.nodeset {near}\n.save all\n"


def density(text: str, folder: Path) -> Raw:
    """The spectrum alone: its integral has a logarithm of zero where resistors are silent."""
    (folder / "deck.cir").write_text(text)
    command = [find_ngspice(), "-b", "-r", "noise.raw", "deck.cir"]
    subprocess.run(command, cwd=folder, capture_output=True, timeout=60, check=True)
    return read_raw(folder / "noise.raw")[0]


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_the_sources_are_those_that_ngspice_finds(name, tmp_path):
    """.noise of all resistors, at every frequency, against the covariance of the same sources."""
    circuit, network = settled(name).emulation.circuit, settled(name).emulation.network
    rest, text = settled(name), released(settled(name))
    expected = settled_noise(rest.emulation, rest.x, Noise(step=1.0, temperature=300.15))
    signals, stage = deck_of(circuit, LEVEL, duration=1.0).signals, network.stages // 2
    source = re.search(r"^(V_\S+) .* AC 1$", text, re.M)[1]
    for part in [part for part in circuit.schematic.parts if part.name in circuit.resistors][::4]:
        analysis = f".noise v({signals[part.name, stage]}) {source} dec 40 10 1e10\n.end\n"
        spectrum = density(text + analysis, tmp_path)
        hertz = np.real(spectrum["frequency"])
        square = np.real(spectrum["onoise_spectrum"]) ** 2
        found = np.trapezoid(square * hertz, np.log(hertz))
        place = network.state_index[network.neuron_index[part.name], stage]
        volts = circuit.scaling.volts(part.name, expected[place])
        assert np.sqrt(found) == pytest.approx(volts, rel=2e-3), part.name
