"""Capacitance and bias current of a virtual ground, and a second pole, by Kirchhoff's laws."""

import numpy as np
import pytest
from wired import neighbour_wired

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.scaling import ProbeRun, ScalingRules, scale
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network.cell import Cell, Connection, Neuron, Sum
from ann_dc.network.duals import PIDual
from ann_dc.network.network import Network

GBW, A0, SECOND, BIAS, FARADS = 1e6, 200.0, 2.5e6, 1e-7, 5e-12
OMEGA = 2 * np.pi * GBW
OFF = {"r_x_0": 0.1, "c_x": -0.2, "rf_m": 0.2, "c_m": 0.3, "rf_s": -0.1, "vos_x": 0.02}


def level(**parasitics: float) -> Level:
    parts = Datasheet(a0=A0, gbw=GBW, parasitics=Parasitics(**parasitics))
    return Level(name="op amps", models="macro", datasheet=parts)


def wired(*ends: tuple[str, str, float]) -> tuple[Connection, ...]:
    return tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends)


LEAKY = Cell(
    neurons=(Neuron(name="x", tau=0.5),),
    connections=wired(("x", "x", -2.0), ("one", "x", 3.0)),
)
DUAL = Cell(
    neurons=(Neuron(name="x", tau=0.5), Neuron(name="mu", tau=0.25)),
    blocks=(Sum(name="c"), Sum(name="m")),
    connections=wired(
        ("x", "c", 0.8), ("one", "c", -0.5), ("c", "mu", 1.0), ("mu", "m", 1.0), ("c", "m", 0.7),
        ("x", "x", -1.0), ("m", "x", -1.0),
    ),
    duals=(PIDual(neuron="mu", residual="c", multiplier="m"),),
)  # fmt: skip
SUMMED = Cell(
    neurons=(Neuron(name="x", tau=0.5),),
    blocks=(Sum(name="s"),),
    connections=wired(("x", "s", 2.0), ("one", "s", -1.0), ("s", "x", -1.0)),
)


def built(cell: Cell) -> Circuit:
    network = Network(cell=cell, stages=1)
    states = np.linspace(0, 1.5, 5)[:, None] * np.ones(network.size)
    probe = ProbeRun(states=states, times=np.arange(5.0), radius=4.0)
    return circuit_of(schematic_of(network), scale(network, probe, ScalingRules(gbw=GBW)))


class Nodal:
    """G v + C v' = i of a circuit of resistors, capacitors and op amps, node by node."""

    def __init__(self) -> None:
        self.rows: dict[str, int] = {}
        self.cards: list[tuple] = []

    def row(self, node: str) -> int:
        return self.rows.setdefault(node, len(self.rows))

    def pole(self, of: str, source: str, omega: float, *, leak: float = 1.0, bias: float = 0.0):
        """of' = omega (source + bias) - omega leak of."""
        self.cards.append(("pole", of, source, omega, leak, bias))
        self.row(of), self.row(source)

    def two(self, kind: str, a: str, b: str, value: float):
        """A resistor, a capacitor, or volts and a resistor to a source."""
        self.cards.append((kind, a, b, value))
        for node in (a, b):
            if isinstance(node, str) and node:
                self.row(node)

    def current(self, node: str, amperes: float):
        self.cards.append(("i", node, amperes))

    def solved(self):
        """(eigenvalues per second that are finite, settled volts by node)."""
        n = len(self.rows)
        G, C, i = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
        driven = {self.rows[card[1]] for card in self.cards if card[0] == "pole"}
        for card in self.cards:
            if card[0] == "i":
                i[self.rows[card[1]]] += card[2]
            elif card[0] == "pole":
                _, of, source, omega, leak, bias = card
                k, j = self.rows[of], self.rows[source]
                C[k, k] += 1.0
                G[k, k] += omega * leak
                G[k, j] -= omega
                i[k] += omega * bias
            else:
                self._two_ends(card, driven, G, C, i)
        dynamic = np.linalg.matrix_rank(C)
        found = 1 / np.linalg.eigvals(np.linalg.solve(-G, C))
        finite = found[np.argsort(np.abs(found))][:dynamic]
        return np.sort_complex(finite), dict(zip(self.rows, np.linalg.solve(G, i)))

    def _two_ends(self, card, driven, G, C, i):
        kind, a, b, value = card
        M, value = (C, value) if kind == "c" else (G, 1 / value)
        for here, there in ((a, b), (b, a)):
            if not isinstance(here, str) or not here or self.rows[here] in driven:
                continue
            k = self.rows[here]
            M[k, k] += value
            if isinstance(there, str) and there:
                M[k, self.rows[there]] -= value
            elif not isinstance(there, str):
                i[k] += there * value


def op_amp(net: Nodal, name: str, parasitics: Parasitics, vos: float = 0.0) -> None:
    """Output ``name``, ground ``g_<name>``: v' = OMEGA (vos - g - v / A0), behind a second pole."""
    first = f"first_{name}" if np.isfinite(parasitics.second_pole) else name
    net.row(name)
    net.pole(first, f"neg_{name}", OMEGA, leak=1 / A0, bias=vos)
    net.pole(f"neg_{name}", f"g_{name}", -1e15, leak=-1.0)  # -g, at once
    if first != name:
        net.pole(name, first, 2 * np.pi * parasitics.second_pole)
    net.two("c", f"g_{name}", "", parasitics.ground)
    net.current(f"g_{name}", -parasitics.bias_current)


def read(circuit: Circuit, part, wire) -> str | float:
    """The node that a resistor comes from, or the volts of a source."""
    sign = int(circuit.schematic.reading(part, wire)[0])
    if wire.source == "one":
        return sign * circuit.scaling.volts("one", 1.0)
    direct = sign == circuit.schematic.polarity[wire.source]
    return wire.source if direct else f"not_{wire.source}"


def by_hand(circuit: Circuit, parasitics: Parasitics, off: dict[str, float]) -> Nodal:
    """All op amps of a circuit, ``not_<part>`` the inverter behind one."""
    net, schematic = Nodal(), circuit.schematic

    def off_by(name: str, nominal: float) -> float:
        return nominal * (1 + off.get(name, 0.0))

    for part in schematic.parts:
        name = part.name
        op_amp(net, name, parasitics, off.get(f"vos_{name}", 0.0))
        for place, wire in enumerate(part.wires):
            ohms = off_by(f"r_{name}_{place}", circuit.resistors[name][place, 0])
            net.two("r", f"g_{name}", read(circuit, part, wire), ohms)
        far = f"h_{name}" if name in circuit.feedback and name in circuit.capacitors else name
        if name in circuit.feedback:
            net.two("r", f"g_{name}", far, off_by(f"rf_{name}", circuit.feedback[name]))
        if name in circuit.capacitors:
            near = far if far != name else f"g_{name}"
            net.two("c", near, name, off_by(f"c_{name}", circuit.capacitors[name][0]))
        if name in schematic.inverted:
            op_amp(net, f"not_{name}", parasitics)
            for end in (name, f"not_{name}"):
                net.two("r", f"g_not_{name}", end, circuit.inverter)
    return net


CELLS = {"leaky": LEAKY, "dual": DUAL, "summed": SUMMED}
EFFECTS = {
    "capacitance": {"stray_capacitance": FARADS},
    "more capacitance": {"input_capacitance": 4 * FARADS, "stray_capacitance": FARADS},
    "second pole": {"stray_capacitance": FARADS, "second_pole": SECOND},
    "bias current": {"stray_capacitance": FARADS, "bias_current": BIAS},
}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("which", CELLS)
def test_an_op_amp_with_parasitics_obeys_kirchhoffs_laws(which, effect):
    """Its eigenvalues are the circuit's, and it settles where the circuit does, with errors too."""
    circuit = built(CELLS[which])
    names = {parameter.name for parameter in circuit.parameters}
    off = {name: value for name, value in OFF.items() if name in names}
    emulation = emulate(circuit, level(**EFFECTS[effect]), off)
    network = emulation.network
    x = equilibrium(network, emulated_state(emulation, np.ones(circuit.schematic.network.size)))
    found = np.sort_complex(np.linalg.eigvals(evaluator(network).jacobian(x)))
    rates, volts = by_hand(circuit, Parasitics(**EFFECTS[effect]), off).solved()
    assert len(found) == network.size
    slow = np.sort_complex(rates[np.abs(rates) < 1e12]) * circuit.scaling.time
    np.testing.assert_allclose(found, slow, rtol=1e-6)
    for part in circuit.schematic.parts:
        settled = circuit.value_of(part.name) * volts[part.name]
        assert x[network.neuron_index[part.name]] == pytest.approx(settled, rel=1e-6)


def test_a_small_capacitance_is_left_out_and_its_pole_is_far():
    circuit = built(LEAKY)
    few = emulate(built(SUMMED), level(stray_capacitance=1e-15)).network.size
    assert few == emulate(built(SUMMED), level()).network.size
    assert emulate(built(SUMMED), level(stray_capacitance=FARADS)).network.size == few + 2
    assert emulate(circuit, level(stray_capacitance=FARADS)).network.size == 2  # a divider


@pytest.mark.parametrize("differential", [False, True])
def test_without_parasitics_the_emulation_is_what_it_was(differential):
    network = neighbour_wired("double_integrator", 4)
    plain = macro(differential=differential)
    circuit, _ = SpiceBackend(level=plain).prepare(network)
    found = emulate(circuit, plain).network.cell
    assert not [n.name for n in found.neurons if n.name.startswith(("ground.", "first."))]
    assert not [b.name for b in found.blocks if b.name.startswith("lagging.")]


def test_a_bias_current_moves_no_output_of_a_differential_circuit():
    network = neighbour_wired("double_integrator", 4)
    pairs = macro(differential=True)
    circuit, probe = SpiceBackend(level=pairs).prepare(network)
    biased = Datasheet(a0=1e6, parasitics=Parasitics(bias_current=1e-6))
    states = [
        equilibrium(e.network, emulated_state(e, probe.final))
        for e in (emulate(circuit, pairs), emulate(circuit, macro(biased, differential=True)))
    ]
    np.testing.assert_array_equal(*states)
