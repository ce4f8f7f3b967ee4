"""One op amp with finite gain and bandwidth is what Kirchhoff's laws say of it, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.hardware.emulation.building import emulate, emulate_clamps
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Neuron, Sum
from ann_dc.network.duals import PIDual
from ann_dc.network.network import Network


def op_amps(datasheet: Datasheet) -> Level:
    """A level of those op amps, whatever the macro models can do."""
    return Level(name="op amps", models="ideal", datasheet=datasheet)


def inverter(name: str) -> str:
    """The node of a part's inverter."""
    return AmplifierNodes(name, inverter=True).output


GBW, OMEGA = 1e6, 2 * np.pi * 1e6
A0 = 200.0


def built(network: Network, largest: float = 1.5) -> Circuit:
    """Components of a hand-wired network, scaled as if all it did was reach ``largest``."""
    states = np.linspace(0, largest, 5)[:, None] * np.ones(network.size)
    scaling = scale(
        network,
        ProbeRun(states=states, times=np.arange(5.0), radius=4.0),
        ScalingRules(gbw=GBW),
    )
    return circuit_of(schematic_of(network), scaling)


def leaky() -> Network:
    """0.5 x' = -2 x + 3."""
    wires = (
        Connection(source="x", target="x", weight=-2.0),
        Connection(source="one", target="x", weight=3.0),
    )
    return Network(cell=Cell(neurons=(Neuron(name="x", tau=0.5),), connections=wires), stages=1)


def dual() -> Network:
    """0.25 mu' = c and m = mu + 0.7 c, of an error c that comes from outside."""
    cell = Cell(
        neurons=(Neuron(name="mu", tau=0.25),),
        inputs=("error",),
        blocks=(Sum(name="c"), Sum(name="m")),
        connections=(
            Connection(source="error", target="c", weight=0.8),
            Connection(source="c", target="mu"),
            Connection(source="mu", target="m"),
            Connection(source="c", target="m", weight=0.7),
        ),
        duals=(PIDual(neuron="mu", residual="c", multiplier="m"),),
    )
    return Network(cell=cell, stages=1, inputs={"error": 0.3})


def op_amp(circuit: Circuit, name: str, volts: float, off: dict[str, float]):
    """(M, b) of d/dt (v, h) = M (v, h) + b in seconds: Kirchhoff's laws at the virtual ground.

    v is the output, h the voltage across the capacitor with the sign of v; the first resistor of an
    integrator comes from v, the last one of either part from a source of ``volts``. The virtual
    ground s and the current i into it obey i = sum (v_j - s) / R_j and s = v - h + R_f i.
    """
    fed_back = name in circuit.feedback  # by R_f and C in series
    g = [
        1 / ohms * 1 / (1 + off.get(f"r_{name}_{j}", 0.0))
        for j, ohms in enumerate(circuit.resistors[name][:, 0])
    ]
    rf = circuit.feedback[name] * (1 + off.get(f"rf_{name}", 0.0)) if fed_back else 0.0
    c = circuit.capacitors[name][0] * (1 + off.get(f"c_{name}", 0.0))
    own = 0.0 if fed_back else g[0]
    # the current and the virtual ground as rows over (v, h, 1)
    i = np.array([own - sum(g), sum(g), g[-1] * volts]) / (1 + rf * sum(g))
    s = np.array([1.0, -1.0, 0.0]) + rf * i
    v = OMEGA * (np.array([-1 / A0, 0.0, off.get(f"vos_{name}", 0.0)]) - s)
    rows = np.array([v, -i / c])
    return rows[:, :2], rows[:, 2]


PARTS = {"x": (leaky, "one", 1.0), "m": (dual, "error", 0.3)}
"""Each with its network, and the source at its last resistor."""


def by_hand(name: str, off: dict[str, float]):
    """(emulation, network order of (v, h), value of a volt, M, b) of one part."""
    network, source, value = PARTS[name]
    circuit = built(network())
    part = circuit.schematic.by_name[name]
    sign = float(circuit.schematic.reading(part, part.wires[-1])[0])
    M, b = op_amp(circuit, name, sign * circuit.scaling.volts(source, value), off)
    emulation = emulate(circuit, op_amps(Datasheet(a0=A0, gbw=GBW)), off)
    rows = [emulation.network.neuron_index[n] for n in (name, AmplifierNodes(name).held)]
    volt = circuit.schematic.polarity[name] * circuit.scaling.value(name, 1.0)
    return emulation, rows, volt, M, b


OFF = {
    "x": ({}, {"r_x_0": 0.1}, {"r_x_1": -0.2, "c_x": 0.3}, {"vos_x": 0.02, "r_x_1": 0.1}),
    "m": ({}, {"r_m_0": 0.1}, {"rf_m": 0.2, "c_m": -0.3}, {"vos_m": -0.02, "rf_m": 0.1}),
}
CASES = [(name, off) for name, cases in OFF.items() for off in cases]


@pytest.mark.parametrize(("name", "off"), CASES)
def test_one_op_amp_obeys_kirchhoffs_laws(name, off):
    """In volts and seconds the emulation's state matrix is the circuit's, to rounding."""
    emulation, rows, volt, M, b = by_hand(name, off)
    network, time = emulation.network, emulation.circuit.scaling.time
    jacobian = evaluator(network).jacobian(np.zeros(2))[np.ix_(rows, rows)]
    np.testing.assert_allclose(jacobian, time * M, rtol=1e-12, atol=1e-12 * np.abs(jacobian).max())
    np.testing.assert_allclose(
        evaluator(network).rhs(np.zeros(2))[rows], time * volt * b, rtol=1e-12
    )


@pytest.mark.parametrize(("name", "off"), CASES)
def test_its_step_is_the_matrix_exponential(name, off):
    emulation, rows, volt, M, b = by_hand(name, off)
    network, time = emulation.network, emulation.circuit.scaling.time
    run = OdeBackend(method=DOP853.tighter(), verify=False, limit=40).run(network).trajectory
    start = network.start_state[rows] / volt
    for k in (len(run.time) // 4, len(run.time) // 2, -1):
        seconds = run.time[k] * time
        augmented = np.block([[M, b[:, None]], [np.zeros((1, 3))]]) * seconds
        wanted = (expm(augmented) @ np.append(start, 1.0))[:2]
        np.testing.assert_allclose(run.states[k][rows] / volt, wanted, rtol=1e-6)


def test_gain_and_poles_of_an_integrator_in_closed_form():
    """x = 3/2 less what the gain of its summing node over A0 takes; one slow and one fast pole."""
    emulation, *_ = by_hand("x", {})
    network, unit = emulation.network, emulation.circuit.scaling.unit["x"]
    gamma = 2 + 3 / unit  # conductance of both resistors, in weights
    x = equilibrium(network, np.zeros(2))
    assert x[network.neuron_index["x"]] == pytest.approx(3 / (2 + gamma / A0), rel=1e-12)
    omega = OMEGA * emulation.circuit.scaling.time
    slow, fast = np.sort(np.linalg.eigvals(evaluator(network).jacobian(x)).real)[::-1]
    # s^2 + (omega (1 + 1/A0) + 2 gamma) s + 2 omega (2 + gamma / A0) = 0
    assert slow * fast == pytest.approx(2 * omega * (2 + gamma / A0), rel=1e-12)
    assert slow + fast == pytest.approx(-(omega * (1 + 1 / A0) + 2 * gamma), rel=1e-12)


def test_gain_and_leak_of_a_dual_in_closed_form():
    """At rest no current flows: m = A0 times the input in volts. It leaks with R C (1 + A0)."""
    emulation, *_ = by_hand("m", {})
    network, circuit = emulation.network, emulation.circuit
    x = equilibrium(network, np.zeros(2))
    volts = circuit.scaling.volts("error", 0.3)
    m = x[network.neuron_index["m"]]
    assert abs(circuit.scaling.volts("m", m)) == pytest.approx(A0 * volts, rel=1e-9)
    ohms, rf, c = circuit.resistors["m"][0, 0], circuit.feedback["m"], circuit.capacitors["m"][0]
    leak = c * (ohms * (1 + A0) + rf) + A0 / OMEGA  # the sum of both time constants
    poles = np.linalg.eigvals(evaluator(network).jacobian(x)).real / circuit.scaling.time
    assert -(1 / poles).sum() == pytest.approx(leak, rel=1e-9)


def summing() -> Network:
    """x' = -x + y with y = -0.5 x + 0.8: around such a loop one sign has to be inverted."""
    wires = (("x", "x", -1.0), ("y", "x", 1.0), ("x", "y", -0.5), ("one", "y", 0.8))
    connections = tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires)
    cell = Cell(neurons=(Neuron(name="x"),), blocks=(Sum(name="y"),), connections=connections)
    return Network(cell=cell, stages=1)


ERRORS = {"rf_y": 0.1, "r_y_0": -0.2, "vos_y": 5e-3, "e_n": 0.05, "vos_n": -4e-3}


@pytest.mark.parametrize("off", [{}, {"rf_y": 0.1}, {"vos_y": 5e-3}, ERRORS])
def test_adders_and_inverters_obey_kirchhoffs_laws(off):
    """No current is left at the virtual ground s: s = sum (v_j / R_j) / sum (1 / R_j)."""
    circuit = built(summing())
    (turned,) = circuit.schematic.inverted
    off = {k if k.endswith("y") or "_y_" in k else f"{k}_{turned}": v for k, v in off.items()}
    emulation = emulate(circuit, op_amps(Datasheet(a0=A0, gbw=GBW)), off)
    network, scaling, polarity = emulation.network, circuit.scaling, circuit.schematic.polarity
    x = np.random.default_rng(0).standard_normal(network.size)
    values, rates = (dict(zip(network.neuron_index, a)) for a in (x, evaluator(network).rhs(x)))

    def volts(name, of=values):
        node = emulation.origins[name].node
        return polarity[node] * scaling.volts(node, of[name])

    def rate(s, name, vos):
        return scaling.time * OMEGA * (off.get(vos, 0.0) - s - volts(name) / A0)

    adder, r = circuit.schematic.by_name["y"], circuit.resistors["y"][:, 0]
    rf = circuit.feedback["y"] * (1 + off.get("rf_y", 0.0))
    g, v = [1 / rf], [volts("y")]
    for j, wire in enumerate(adder.wires):
        sign = circuit.schematic.reading(adder, wire)[0]
        own = polarity.get(wire.source) == sign
        given = wire.source if own else inverter(wire.source)
        v.append(sign * scaling.volts("one", 1.0) if wire.source == "one" else volts(given))
        g.append(1 / (r[j] * (1 + off.get(f"r_y_{j}", 0.0))))
    s = np.dot(g, v) / np.sum(g)
    assert volts("y", rates) == pytest.approx(rate(s, "y", "vos_y"), rel=1e-12)
    g = [1.0, 1 / (1 + off.get(f"e_n_{turned}", 0.0))]
    s = np.dot(g, [volts(turned), volts(inverter(turned))]) / np.sum(g)
    wanted = rate(s, inverter(turned), f"vos_n_{turned}")
    assert volts(inverter(turned), rates) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(("share", "times"), [(1 / 3, 1.0), (0.1, 1.5)])
def test_pi_cell_with_output_resistance_responds_as_kirchhoffs_laws_say(share, times):
    """At ``times`` the rate of its capacitor: the current of R_f crosses r, too."""
    circuit = built(dual())
    rf, c = circuit.feedback["m"], float(circuit.capacitors["m"][0])
    r, s = share * rf, 1j * times / (rf * c)
    gamma = rf * float((1 / circuit.resistors["m"][:, 0]).sum())
    # unknowns x, h, e, y for an input that adds 1 to x where the virtual ground is at zero
    laws = np.array([
        [1 + r / rf, -r / rf, -r / rf, -1],  # x = y - r (x - e - h) / R_f
        [1, -1, -(1 + gamma), 0],  # e (1 + Gamma) = x - h - A
        [-1, 1 + s * rf * c, 1, 0],  # C h' = (x - e - h) / R_f
        [0, 0, OMEGA, s + OMEGA / A0],  # y' = -Omega (e + y / A0)
    ])  # fmt: skip
    wanted = np.linalg.solve(laws, [0, 1, 0, 0])[0]
    level = op_amps(Datasheet(a0=A0, gbw=GBW, rout=r))
    network = emulate(circuit, level).network
    more = replace(network, inputs={"error": 1.3})
    zero = np.zeros(network.size)
    drive = evaluator(more).rhs(zero) - evaluator(network).rhs(zero)
    system = s * circuit.scaling.time * np.eye(network.size) - evaluator(network).jacobian(zero)
    row = network.neuron_index["m"]
    found = np.linalg.solve(system, drive)[row]
    assert abs(found / (0.7 * 0.8) / wanted) == pytest.approx(1, rel=8e-3)
    assert np.angle(found / wanted) == pytest.approx(0, abs=1e-2)


@pytest.mark.parametrize(("share", "times"), [(0.3, 0.5), (0.1, 1.0)])
def test_moving_integrator_with_output_resistance_responds_as_kirchhoffs_laws_say(share, times):
    """Against one without, at ``times`` its rate: the current of the capacitor crosses r, too."""
    wire = Connection(source="error", target="x", weight=0.8)
    cell = Cell(neurons=(Neuron(name="x", tau=0.5),), inputs=("error",), connections=(wire,))
    circuit = built(Network(cell=cell, stages=1, inputs={"error": 0.3}))
    ohms, c = circuit.resistors["x"][0, 0], circuit.capacitors["x"][0]
    s = 1j * times / (ohms * c)

    def by_laws(r):
        laws = np.array([
            [1, r * s * c, 0, -1],  # x = y - r C h'
            [1, -1, -1, 0],  # e = x - h
            [0, s * c * ohms, -1, 0],  # C h' = (1 + e) / R
            [0, 0, OMEGA, s],  # y' = -Omega e
        ])  # fmt: skip
        return np.linalg.solve(laws, [0, 0, 1, 0])[0]

    def emulated(r):
        level = op_amps(Datasheet(a0=1e6, gbw=GBW, rout=r))
        network = emulate_clamps(circuit, level).network
        zero, at = np.zeros(network.size), evaluator(network)
        drive = evaluator(replace(network, inputs={"error": 1.3})).rhs(zero) - at.rhs(zero)
        system = s * circuit.scaling.time * np.eye(network.size) - at.jacobian(zero)
        return np.linalg.solve(system, drive)[network.neuron_index["x"]]

    wanted, found = (f(share * ohms) / f(0.0) - 1 for f in (by_laws, emulated))
    assert abs(found / wanted - 1) < 0.05
