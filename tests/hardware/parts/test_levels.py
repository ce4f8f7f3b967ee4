"""The rungs of the ladder: real parts, both signs, transconductors, switched capacitors."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.recurrent.layer import RecurrentLayer
from ann_dc.backends.recurrent.steps import FixedStep
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import read_back
from ann_dc.backends.spice.netlist.deck import Writer, deck_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
from ann_dc.hardware.circuit.elements import PICell
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.levels import MACRO_PARAMETERS, macro, ota_c, switched_capacitor
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.resources import circuits_path
from ann_dc.synthesis.synthesis import synthesize


@cache
def neighbour_wired(name: str, horizon: int | None = None) -> Network:
    problem = SUITE[name].problem
    problem = problem.with_horizon(horizon) if horizon else problem
    return design(synthesize(problem), recipe=WITHOUT_COORDINATORS).network


@cache
def prepared(differential: bool, horizon: int | None = None):
    """The car, scaled for op amps of 10 MHz."""
    level = macro(differential=differential)
    return SpiceBackend(level=level).prepare(neighbour_wired("car", horizon))


def run_of(level):
    return simulate(SpiceBackend(level=level), *prepared(level.technology.differential))


def controls(run) -> np.ndarray:
    return run.trajectory.final[run.trajectory.network.of_population("u")]


def instances(text: str, kind: str) -> list[str]:
    """Cards of a subcircuit, in cells and at top level."""
    joined = text[text.index("* ---- cells") :].replace("\n+ ", " ")
    return re.findall(rf"^X\S* [^\n]*? {kind}(?: \w+=\S+)*$", joined, re.MULTILINE)


# ---- presets -------------------------------------------------------------------------------------


def test_every_preset_has_the_figures_of_its_file():
    folder = circuits_path() / "models" / "presets"
    known = presets()
    assert known.keys() == {file.stem for file in folder.glob("*.lib")}
    for name, level in known.items():
        text = (folder / f"{name}.lib").read_text(encoding="utf-8")
        figures = {k: float(v) for k, v in re.findall(r"^\.param (\w+)=(\S+)$", text, re.MULTILINE)}
        tolerances = level.datasheet.tolerances
        found = level.parameters | {
            "full_scale": level.full_scale,
            "resistor_tolerance": tolerances.resistor,
            "opamp_vos": tolerances.offset,
            "mul_ge": tolerances.gain,
            "mul_offset": tolerances.product_offset,
        }
        assert {figure: figures[figure] for figure in found} == found, name
        assert found.keys() > MACRO_PARAMETERS.keys()


def test_a_preset_by_name():
    datasheet = presets.get("tl072_ad633").datasheet
    assert (datasheet.gbw, datasheet.a0, datasheet.slew) == (4e6, 2e5, 13e6)
    assert datasheet.usable_bandwidth == 3e6  # three times that of its multipliers
    assert (datasheet.tolerances.offset, datasheet.tolerances.resistor) == (3e-3, 0.01)
    assert presets.get("tl072_ad633").full_scale == 10


def test_an_unknown_preset_lists_those_that_there_are():
    with pytest.raises(UnknownNameError, match=r"'lm741'.*choose one of: .*tl072_ad633") as meaning:
        presets.get("lm741")
    assert all(name in str(meaning.value) for name in presets.names())


def seeded(seed: int | None) -> str:
    level = presets.get("ad8065_ad835")
    backend = SpiceBackend(level=level, seed=seed)
    circuit, probe = prepared(False, 4)
    return deck_of(
        circuit, level, duration=float(probe.time[-1]), deviations=backend.deviations(circuit)
    ).text


def test_a_seed_decides_the_numbers_and_nothing_else():
    assert seeded(1) == seeded(1)
    assert seeded(1) != seeded(2)

    def without_numbers(text: str) -> str:
        return re.sub(r"=[-+.\de]+", "=", text.replace("\n+ ", " "))

    assert without_numbers(seeded(1)) == without_numbers(seeded(2))


# ---- both signs ----------------------------------------------------------------------------------


@needs_ngspice
def test_differential_op_amps_settle_at_the_optimum_without_inverters():
    run = run_of(macro(a0=1e6, differential=True))
    assert run.control_error < 1e-4
    assert run.settled()
    assert not instances(run.deck.text, "inv")
    assert ".subckt inv " not in run.deck.text
    circuit, _ = prepared(False)
    single = deck_of(circuit, macro(), duration=1.0).text
    assert instances(single, "inv")
    both = {kind: len(instances(run.deck.text, f"{kind}_fd")) for kind in ("integ", "pi_cell")}
    assert both == {kind: len(instances(single, kind)) for kind in both}


@needs_ngspice
def test_differential_circuits_that_are_off_settle_where_their_emulation_does():
    """Each half sees half of an offset, and there are no inverters to be off."""
    tolerances = Tolerances(resistor=1e-2, offset=1e-3, gain=1e-2, product_offset=1e-3)
    level = macro(Datasheet(a0=1e5, tolerances=tolerances), differential=True)
    run = SpiceBackend(level=level, seed=3).run(neighbour_wired("double_integrator", 5))
    off = SpiceBackend(level=level, seed=3).deviations(run.circuit)
    meaning = predict(run.circuit, level, run.probe, off)
    assert run.control_error == pytest.approx(meaning.control_error, rel=1e-3)


# ---- transconductors -----------------------------------------------------------------------------


@needs_ngspice
def test_the_error_of_transconductors_falls_with_the_square_of_their_linear_range():
    """tanh(v / VL) VL = v - v^3 / (3 VL^2): twice the range, a quarter of the error."""
    errors = [run_of(ota_c(linear_range=v)).control_error for v in (10.0, 20.0, 40.0)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.03)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.03)
    assert errors[0] * 10**2 == pytest.approx(0.187, rel=0.05)


@needs_ngspice
def test_the_error_of_leaks_falls_as_one_over_the_gain():
    """An integrator of gain A0 leaks into A0 times the resistors of its inputs in parallel."""
    best = controls(run_of(ota_c(linear_range=1e3)))
    errors = [
        np.abs(controls(run_of(ota_c(linear_range=1e3, a0=a0))) - best).max() for a0 in (1e4, 1e5)
    ]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.02)


def test_transconductors_need_no_op_amps_and_pair_up():
    circuit, _ = prepared(True)
    level = ota_c()
    text = deck_of(circuit, level, duration=1.0).text
    assert not re.search(r"\bopamp", text[text.index("* ---- cells") :])
    assert ".subckt opamp" not in text
    assert not instances(text, "inv")
    assert instances(text, "ota_diff")
    defined = re.split(r"^\.subckt ", text, flags=re.MULTILINE)[1:]
    behavioural = {d.split()[0] for d in defined if re.search(r"^B", d, re.MULTILINE)}
    functions = {name for name in behavioural if name.startswith("func_")}
    assert behavioural - functions == {"ota", "ota_diff", "mul4q"}


def test_pairs_and_single_ones_add_up_to_the_weights():
    """Whatever shares a pair, every source weighs -1 / R with the sign of its node."""
    circuit, _ = prepared(True, 4)
    writer = Writer(circuit, ota_c(), {})
    cell = writer.cell(2)
    cards = " \n".join(cell.lines).replace("\n+ ", "").splitlines()
    for part in circuit.schematic.parts:
        if part.name not in circuit.resistors:
            continue
        alias, found = circuit.schematic.alias[part.name], {}
        for card in cards:
            match = re.match(rf"X\w*?_{alias}_\d+ (.*) (ota|ota_diff) gm={{(\w+)}}", card)
            if match and match[1].split()[-1] == alias:
                gm, nodes = cell.values[match[3]], match[1].split()[:-1]
                for node, sign in zip(nodes, (1, -1)):
                    found[node] = found.get(node, 0.0) + sign * gm
        wanted: dict[str, float] = {}
        for _, source, ohms in writer.resistors(part, 2):
            node = cell.ports[writer.plain(source)]
            wanted[node] = wanted.get(node, 0.0) - writer.sign(source) / ohms
        assert found == pytest.approx(wanted), part.name


# ---- switched capacitors -------------------------------------------------------------------------


@cache
def short_lq() -> Network:
    problem = plants.double_integrator(N=3, dt=0.5, q_0=(1, 0), q_d=(0, 0))
    return design(synthesize(problem), recipe=WITHOUT_COORDINATORS).network


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


@needs_ngspice
def test_charge_injection_grows_with_the_overlap_and_shrinks_with_the_capacitors():
    """What is left of the charge c_ov V of the clock edges, over the capacitors of the branches."""
    none = charge_error()
    small = charge_error(overlap=1e-15)
    assert none < 1e-5 < 1e-3 < small
    assert charge_error(overlap=2e-15) / small == pytest.approx(2, rel=0.1)
    assert charge_error(overlap=1e-15, unit_capacitor=4e-12) < 0.25 * small


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


# ---- what every technology keeps to --------------------------------------------------------------

TECHNOLOGIES = {
    "op amps": macro(),
    "differential": macro(differential=True),
    "transconductors": ota_c(a0=1e4),
    "switched capacitors": switched_capacitor(step=0.1),
}


def pair(a: str, b: str) -> Network:
    """a' = b and b' = 0.5 - a - b."""
    wires = ((a, b, -1.0), (b, a, 1.0), (b, b, -1.0), ("one", b, 0.5))
    cell = Cell(
        neurons=(Neuron(name=a), Neuron(name=b)),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    return Network(cell=cell, stages=1)


@pytest.mark.parametrize("level", TECHNOLOGIES.values(), ids=TECHNOLOGIES.keys())
@pytest.mark.parametrize(("a", "b"), [("x", "y"), ("x", "x_0"), ("x_1", "x"), ("p_x", "x")])
def test_cards_of_a_cell_have_names_of_their_own(level, a, b):
    circuit, _ = SpiceBackend(level=level).prepare(pair(a, b))
    cell = Writer(circuit, level, {}).cell(0)
    names = [line.split()[0].lower() for line in cell.lines if line[0] not in "*+"]
    assert len(set(names)) == len(names)


@needs_ngspice
@pytest.mark.parametrize("name", ["op amps", "differential", "transconductors"])
def test_a_pair_of_neurons_settles_where_it_should(name):
    run = SpiceBackend(level=TECHNOLOGIES[name]).run(pair("x", "y"))
    np.testing.assert_allclose(run.trajectory.final, [0.5, 0.0], atol=1e-3)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: ota_c(linear_range=0.0), "linear_range"),
        (lambda: ota_c(linear_range=np.nan), "linear_range"),
        (lambda: switched_capacitor(step=0.0), "step"),
        (lambda: switched_capacitor(step=np.nan), "step"),
        (lambda: switched_capacitor(step=0.1, clock=-1e6), "clock"),
        (lambda: switched_capacitor(step=0.1, unit_capacitor=0.0), "unit_capacitor"),
        (lambda: switched_capacitor(step=0.1, overlap=-1e-15), "overlap"),
    ],
)
def test_a_setting_out_of_range_is_named(make, field):
    with pytest.raises(NetworkError, match=f"^{field}: expected"):
        make()
