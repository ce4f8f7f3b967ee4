"""Noise in ngspice and on the equations: the same samples, the same voltages, and closed forms."""

import re
import subprocess
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import read_back
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.spice.ngspice.raw import Raw, read_raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.noise import STEPS, source_card, with_noise
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.noise_run import run_with_noise, settled_noise, started_at
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.deviations import Deviations, draw
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
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.levels import BEHAVIOURAL, Level, macro
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
SPREAD = Tolerances(resistor=1e-2, offset=1e-4, gain=1e-3)


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
    probe: Trajectory
    level: Level = LEVEL
    off: Deviations = field(default_factory=dict)


@cache
def settled(name: str, spread: bool = False) -> Settled:
    circuit, probe = prepared(name)
    off = draw(circuit.parameters, SPREAD, seed=1) if spread else {}
    emulation = emulate(circuit, LEVEL, off)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    return Settled(emulation=emulation, x=x, probe=probe, off=off)


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


@pytest.mark.slow
@needs_ngspice
def test_ngspice_is_driven_by_the_samples():
    amperes, step, volts = resistors_on_capacitors(150, 800)
    times = step * np.arange(amperes.shape[1])
    lines = ["* a resistor on a capacitor, many times"]
    for i, row in enumerate(amperes):
        lines += [f"R{i} x{i} 0 1meg", f"C{i} x{i} 0 1p"]
        lines += [source_card(f"I{i}", "0", f"x{i}", times, row)]
    lines += [".options method=trap chgtol=1e-22"]
    lines += [f".tran {step} {times[-1]} 0 {step}", ".end"]
    raw = Ngspice().run("\n".join(lines) + "\n", end_time=times[-1])
    found = np.array([np.interp(times, raw.time, raw[f"x{i}"]) for i in range(len(amperes))])
    assert rms(found - volts) < 1e-3 * rms(volts)
    assert rms(found[:, 100:]) == pytest.approx(KTC, rel=0.03)


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
    circuit, probe = SpiceBackend(level=level, margin=100).prepare(network)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    return Settled(emulation=emulation, x=x, level=level, probe=probe)


@pytest.mark.slow
@needs_ngspice
def test_an_integrator_with_a_leak():
    """A leak R across C, and 1/R in all at the virtual ground: kT/C * R sum(1/R)."""
    circuit = leaky().emulation.circuit
    noise = Noise(step=SHARE * circuit.scaling.time)
    simulated, equations = voltages_of_controls(leaky(), noise, duration=30.0)
    assert rms(simulated - equations) < 0.01 * rms(equations)
    leak, drive = circuit.resistors["u.x"][1, 0], circuit.resistors["u.x"][0, 0]
    variance = BOLTZMANN * 300 / circuit.capacitors["u.x"][0] * (1 + leak / drive)
    for volts in (simulated, equations):
        assert rms(volts[80:]) == pytest.approx(np.sqrt(variance) * BAND, rel=0.03)


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


def test_no_noise_changes_nothing():
    emulation, x = settled("car").emulation, settled("car").x
    nothing = draw_noise(emulation.circuit, Noise(step=1e-8, temperature=0), 1e-6)
    assert noisy_network(emulation, nothing).cell.inputs == emulation.network.cell.inputs
    still = run_with_noise(emulation, nothing, start=x).trajectory
    assert still.states == pytest.approx(np.broadcast_to(x, still.states.shape), abs=1e-9)
    silent = draw_noise(emulation.circuit, Noise(step=1e-8), 1e-6)
    silent = replace(silent, samples=0 * silent.samples)
    again = run_with_noise(emulation, silent, start=x).trajectory
    assert (again.states == still.states).all()


def test_the_same_seed_gives_the_same_run():
    emulation, x = settled("double_integrator").emulation, settled("double_integrator").x
    once, twice, other = (
        run_with_noise(
            emulation, draw_noise(emulation.circuit, Noise(step=1e-7, seed=seed), 2e-6), start=x
        ).trajectory.states
        for seed in (0, 0, 1)
    )
    assert (once == twice).all()
    assert not (once[1:] == other[1:]).any(axis=1).all()


def test_shorter_steps_change_nothing():
    emulation, x = settled("car").emulation, settled("car").x
    currents = draw_noise(emulation.circuit, Noise(step=1e-7), 2e-6)
    long, short = (
        run_with_noise(emulation, currents, start=x, reach=reach).trajectory.states - x
        for reach in (0.25, 0.05)
    )
    assert rms(long - short) < 1e-4 * rms(short)


def test_a_run_tells_how_it_ended():
    emulation, x = settled("double_integrator").emulation, settled("double_integrator").x
    currents = draw_noise(emulation.circuit, Noise(step=1e-7), 1e-6)
    run = run_with_noise(emulation, currents, start=x)
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert "when the noise ended" in str(run.status)
    assert len(run.trajectory.time) == 11
    loud = replace(currents, samples=1e18 * currents.samples)
    broken = run_with_noise(emulation, loud, start=x)
    assert broken.status.outcome is Outcome.DIVERGED
    assert len(broken.trajectory.time) < 11
    with pytest.raises(NetworkError, match="reach"):
        run_with_noise(emulation, currents, reach=0.0)


# ---- ngspice against the equations ---------------------------------------------------------------


def voltages_of_controls(rest: Settled, noise: Noise, duration: float):
    """(T, controls) volts of noise: in ngspice, less those of a run without, and by equations."""
    circuit = started_at(rest.emulation, rest.x)
    network = circuit.schematic.network
    plain = deck_of(circuit, rest.level, duration=duration, deviations=rest.off)
    span = plain.timing.end - plain.timing.release
    noisy = draw_noise(circuit, noise, span)
    silent = replace(noisy, samples=0 * noisy.samples)
    run = run_with_noise(rest.emulation, noisy, start=rest.x, deviations=rest.off).trajectory
    controls = network.of_population("u")
    states = []
    for currents in (noisy, silent):
        written = with_noise(plain, circuit, currents)
        raw = Ngspice().run(written.text, end_time=written.end)
        simulated = read_back(circuit, written, raw, rest.probe).trajectory
        rows = [np.interp(run.time, simulated.time, row) for row in simulated.states[:, controls].T]
        states.append(np.array(rows).T)
    names = [network.cell.neurons[i].name for i in network.places[controls, 0]]
    volts = circuit.scaling.full_scale / np.array([circuit.scaling.unit[name] for name in names])
    return (states[0] - states[1]) * volts, rest.emulation.controls(run.states - rest.x) * volts


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("spread", [False, True])
def test_the_papers_car_hears_the_same_noise(spread):
    noise = Noise(step=1e-7, amplifier=5e-9, seed=2)
    simulated, equations = voltages_of_controls(settled("car", spread), noise, duration=60.0)
    for a, b in zip(simulated.T, equations.T):
        assert np.corrcoef(a, b)[0, 1] > 0.999
    assert rms(simulated) == pytest.approx(rms(equations), rel=0.01)
    assert rms(simulated - equations) < 0.03 * rms(equations)
    assert 1e-5 < rms(equations) < 1e-3


@needs_ngspice
@pytest.mark.slow
def test_the_papers_car_hears_the_same_multipliers():
    """Those of an AD734, behind their pole; nothing else makes noise."""
    level = macro(a0=1e5, multiplier_bandwidth=30e6)
    circuit, probe = prepared("car", level)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    rest = Settled(emulation=emulation, x=x, level=level, probe=probe)
    noise = Noise(step=1e-7, temperature=0.0, multiplier=1e-6, seed=2)
    simulated, equations = voltages_of_controls(rest, noise, duration=20.0)
    for a, b in zip(simulated.T, equations.T):
        assert np.corrcoef(a, b)[0, 1] > 0.99
    assert rms(simulated) == pytest.approx(rms(equations), rel=0.01)
    assert rms(simulated - equations) < 0.05 * rms(equations)


@pytest.mark.parametrize(
    ("band", "rails"), [(np.inf, np.inf), (np.inf, 5.0), (2e6, np.inf)], ids=["", "rails", "pole"]
)
def test_the_noise_of_a_multiplier_behind_an_integrator_with_a_leak(band, rails):
    """e_m^2 / (4 R C) of the lag that follows, less what the multiplier's own pole takes."""
    level = macro(a0=1e8, multiplier_bandwidth=band, multiplier_rails=rails)
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
    circuit, probe = SpiceBackend(level=level, margin=100).prepare(network)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    noise = Noise(step=1.0, temperature=0.0, multiplier=1e-6)
    found = emulation.controls(settled_noise(emulation, x, noise))[0] / circuit.value_of("u.x")
    leak, given = (circuit.resistors["u.x"][row, 0] for row in (1, 2))
    tau, pole = leak * circuit.capacitors["u.x"][0], 1 / (2 * np.pi * band)
    expected = 1e-6 * leak / given / np.sqrt(4 * (tau + pole))
    assert abs(found) == pytest.approx(expected, rel=0.02)


def test_multipliers_that_are_no_macro_models_are_refused():
    circuit, probe = prepared("car")
    noise = Noise(step=1e-6, multiplier=1e-6)
    span = 2 * float(probe.time[-1]) * circuit.scaling.time
    plain = deck_of(circuit, BEHAVIOURAL, duration=float(probe.time[-1]))
    with pytest.raises(NetworkError, match="noise: that of multipliers is known for macro models"):
        with_noise(plain, circuit, draw_noise(circuit, noise, span))


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
        square = np.real(spectrum["onoise_spectrum"]) ** 2
        found = np.trapezoid(square * spectrum.frequency, np.log(spectrum.frequency))
        place = network.state_index[network.neuron_index[part.name], stage]
        volts = circuit.scaling.volts(part.name, expected[place])
        assert np.sqrt(found) == pytest.approx(volts, rel=2e-3), part.name


# ---- the deck ------------------------------------------------------------------------------------


def written_with(currents_span: float, **given):
    circuit, _ = prepared("double_integrator")
    plain = deck_of(circuit, LEVEL, duration=2.0)
    span = (plain.timing.end - plain.timing.release) * currents_span
    return plain, with_noise(plain, circuit, draw_noise(circuit, Noise(step=2e-9, **given), span))


def test_a_deck_without_noise_stays_as_it_is():
    plain, noisy = written_with(1.0, temperature=0.0)
    assert noisy is plain


def test_every_current_has_a_card():
    plain, noisy = written_with(1.0)
    sources = noise_sources(prepared("double_integrator")[0])
    cards = re.findall(r"^I_(ground|feedback|inverter)__", noisy.text, re.MULTILINE)
    assert len(cards) == sum(np.count_nonzero(source.conductance) for source in sources)
    assert set(cards) == {source.place.name.lower() for source in sources}
    longest = max(len(line) for line in plain.text.splitlines())
    assert max(len(line) for line in noisy.text.splitlines()) == longest


def test_the_simulator_steps_no_further_than_the_samples():
    plain, noisy = written_with(1.0)
    assert noisy.timing.step == pytest.approx(2e-9 / STEPS)
    assert noisy.timing.step < plain.timing.step
    assert re.search(r"^\.tran 4e-10 \S+ 0 4e-10$", noisy.text, re.MULTILINE)


def test_same_noise_same_bytes():
    assert written_with(1.0)[1].text == written_with(1.0)[1].text
    assert written_with(1.0)[1].text != written_with(1.0, seed=1)[1].text


def test_samples_have_to_last():
    with pytest.raises(NetworkError, match="before the run does"):
        written_with(0.5)
