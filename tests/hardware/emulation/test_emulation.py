"""A circuit as a network: closed forms of one op amp, limits of ideal parts, and ngspice."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from preconditioner_networks import BEYOND, with_preconditioner
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.settling import last_exit
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import read_back
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError, SpiceError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.circuit.circuit import Circuit, Quantity, circuit_of
from ann_dc.hardware.circuit.deviations import draw
from ann_dc.hardware.circuit.scaling import MARGIN
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.emulation.states import emulated_state, pole_spectrum
from ann_dc.hardware.parts.datasheet import Datasheet, Kind, Tolerances
from ann_dc.hardware.parts.levels import Level, macro, ota_c, switched_capacitor
from ann_dc.hardware.schematic.elements import Adder, GridNode, Part
from ann_dc.hardware.schematic.preconditioner_wiring import wiring_of
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.network import preconditioners
from ann_dc.solver import synthesize

PLANTS = ("car", "unicycle", "double_integrator", "van_der_pol")
QUICK = ("car", "unicycle", "double_integrator")
SIMULATED = (
    "double_integrator",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("car", "unicycle", "van_der_pol")),
)
LEVEL = macro(a0=1e5)
BACKEND = SpiceBackend(level=LEVEL, require_stable=False)
FINE = replace(BACKEND, simulation=Simulation(points=1000))
IDEAL = Datasheet(gbw=1e14)  # so fast that nothing of an op amp is left


@cache
def prepared(name: str):
    """(components, probe run) of a neighbour-wired problem of the suite."""
    network = design(
        synthesize(SUITE[name].problem),
        preconditioner=(preconditioners.PreconditionerKind.DIAGONAL,),
    ).network
    return BACKEND.prepare(network)


def op_amps(datasheet: Datasheet) -> Level:
    """A level of those op amps, whatever the macro models can do."""
    return Level(name="op amps", models="ideal", datasheet=datasheet)


def inverter(name: str) -> str:
    """The node of a part's inverter."""
    return AmplifierNodes(name, inverter=True).output


def settled(circuit: Circuit, datasheet: Datasheet, near: np.ndarray, deviations=None):
    """(emulation, its equilibrium) near a state of the ideal network."""
    emulation = emulate(circuit, op_amps(datasheet), deviations)
    return emulation, equilibrium(emulation.network, emulated_state(emulation, near))


def controls_of(name: str, datasheet: Datasheet, deviations=None) -> np.ndarray:
    circuit, probe = prepared(name)
    emulation, x = settled(circuit, datasheet, probe.final, deviations)
    return emulation.controls(x)


def optimum(name: str) -> np.ndarray:
    circuit, probe = prepared(name)
    return equilibrium(circuit.schematic.network, probe.final)


def relative(error: np.ndarray, to: np.ndarray) -> float:
    return float(np.abs(error).max() / np.abs(to).max())


# ---- limits --------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in (*PLANTS, "cstr")],
)
def test_ideal_parts_settle_at_the_optimum(name):
    """Every op amp, capacitor and inverter, not the controls alone."""
    circuit, probe = prepared(name)
    emulation, x = settled(circuit, IDEAL, probe.final)
    wanted = emulated_state(emulation, optimum(name))
    assert relative(x - wanted, wanted) < 1e-9


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [*QUICK, pytest.param("van_der_pol", marks=pytest.mark.slow)])
def test_slow_eigenvalues_approach_the_networks_as_the_op_amps_get_faster(name):
    """The shift is of first order in 1 / GBW."""
    circuit, _ = prepared(name)
    x = optimum(name)
    wanted = np.linalg.eigvals(evaluator(circuit.schematic.network).jacobian(x))
    shift = {}
    for gbw in (1e11, 1e12):
        emulation = emulate(circuit, op_amps(Datasheet(gbw=gbw)))
        found = np.linalg.eigvals(
            evaluator(emulation.network).jacobian(emulated_state(emulation, x))
        )
        nearest = np.abs(wanted[:, None] - found).min(axis=1)
        shift[gbw] = nearest.max() / np.abs(wanted).max()
    assert shift[1e12] < 1e-3
    assert shift[1e11] / shift[1e12] == pytest.approx(10, rel=0.2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PLANTS)
def test_the_error_of_finite_gain_falls_as_one_over_the_gain(name):
    best = optimum(name)[prepared(name)[0].schematic.network.of_population("u")]
    errors = [relative(controls_of(name, Datasheet(a0=a0)) - best, best) for a0 in (1e5, 1e6, 1e7)]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.02)


# ---- deviations ----------------------------------------------------------------------------------


def test_deviations_of_zero_are_the_identity():
    circuit, probe = prepared("car")
    nothing = {p.name: np.zeros(p.present.shape) for p in circuit.parameters}
    plain, zero = emulate(circuit, LEVEL), emulate(circuit, LEVEL, nothing)
    x = emulated_state(plain, probe.final)
    x = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape)
    assert (evaluator(plain.network).rhs(x) == evaluator(zero.network).rhs(x)).all()
    assert (plain.network.start_state == zero.network.start_state).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.CAPACITOR])
def test_parts_that_are_off_move_the_equilibrium(kind):
    circuit, _ = prepared("car")
    size = 1e-3 if kind.unit == "V" else 1e-2
    off = draw(circuit.parameters, Tolerances(**{kind.value: size}), seed=1)
    moved = controls_of("car", LEVEL.datasheet, off) - controls_of("car", LEVEL.datasheet)
    assert 1e-4 < relative(moved, controls_of("car", LEVEL.datasheet)) < 0.2


def test_capacitors_that_are_off_move_the_spectrum_only():
    circuit, probe = prepared("car")
    off = draw(circuit.parameters, Tolerances(capacitor=0.05), seed=1)
    (plain, x), (moved, y) = (
        settled(circuit, LEVEL.datasheet, probe.final, d) for d in (None, off)
    )
    assert relative(x - y, x) < 1e-9
    rates = [np.linalg.eigvals(evaluator(e.network).jacobian(x)).real.max() for e in (plain, moved)]
    assert abs(rates[1] / rates[0] - 1) > 1e-3


def test_a_product_that_is_off_is_off_in_the_network():
    """(1 + ge) (a + ox) (b + oy) + oz, in volts over full scale."""
    circuit, probe = prepared("car")
    part = next(p for p in circuit.schematic.parts if hasattr(p, "b"))
    alias, stage = circuit.alias[part.name], 3
    off = {f"ge_{alias}": 0.02, f"ox_{alias}": 3e-3, f"oy_{alias}": -2e-3, f"oz_{alias}": 1e-3}
    values = []
    for given in ({}, off):
        emulation = emulate(circuit, LEVEL, given)
        network = emulation.network
        x = emulated_state(emulation, probe.final)
        values.append(
            {n: evaluator(network).node(x, n)[stage] for n in (part.a, part.b, part.name)}
        )
    volts = {n: circuit.scaling.volts(n, v) for n, v in values[0].items()}
    polarity = {n: circuit.schematic.polarity.get(n, 1) for n in volts}
    a, b = (polarity[n] * volts[n] for n in (part.a, part.b))  # at the pins
    crossed = -1 if polarity[part.a] * polarity[part.b] * polarity[part.name] < 0 else 1
    wanted = 1.02 * (crossed * a + 3e-3) * (b - 2e-3) + 1e-3
    found = polarity[part.name] * circuit.scaling.volts(part.name, values[1][part.name])
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "error", "meaning"),
    [
        ({"r_nothing_0": 0.1}, UnknownNameError, "r_nothing_0.*choose one of"),
        ({"vos_q_x": np.nan}, NetworkError, "vos_q_x.*finite"),
        ({"vos_q_x": np.inf}, NetworkError, "vos_q_x.*finite"),
        ({"r_q_x_0": -1.0}, NetworkError, "r_q_x_0.*above -1"),
    ],
)
def test_a_deviation_that_makes_no_sense_is_named(given, error, meaning):
    with pytest.raises(error, match=meaning):
        emulate(prepared("car")[0], LEVEL, given)


# ---- slew and rails ------------------------------------------------------------------------------


def run_of(name: str, datasheet: Datasheet):
    """(seconds to 0.1 % of the controls, the controls at the end) of a run of the emulation."""
    circuit, _ = prepared(name)
    emulation = emulate(circuit, op_amps(datasheet))
    run = OdeBackend(method=DOP853, verify=False).run(emulation.network).trajectory
    controls = emulation.controls(run.states)
    error = np.abs(controls - controls[-1]).max(axis=1) / np.abs(controls[-1]).max()
    return last_exit(run.time, error, 1e-3) * circuit.scaling.time, controls[-1]


SLEWING = macro(a0=1e5, slew=1.7e5)


@pytest.mark.slow
def test_slew_delays_and_rails_mislead():
    time, free = run_of("car", Datasheet(a0=1e5))
    slow, same = run_of("car", SLEWING.datasheet)
    assert slow > 1.03 * time
    assert relative(same - free, free) < 1e-5
    _, clipped = run_of("car", Datasheet(a0=1e5, output_swing=0.5))
    assert relative(clipped - free, free) > 1e-2
    again, wide = run_of("car", Datasheet(a0=1e5, output_swing=5.0, slew=1e9))
    assert again == pytest.approx(time, rel=1e-3)
    assert relative(wide - free, free) < 1e-5


# ---- stability -----------------------------------------------------------------------------------


def faster(circuit: Circuit, k: float) -> Circuit:
    """The same circuit with op amps k times as fast as the network's fastest mode."""
    scaling = replace(circuit.scaling, time=circuit.scaling.time * k / MARGIN)
    return circuit_of(circuit.schematic, scaling)


def abscissa(circuit: Circuit, near: np.ndarray) -> float:
    emulation, x = settled(circuit, LEVEL.datasheet, near)
    return float(np.linalg.eigvals(evaluator(emulation.network).jacobian(x)).real.max())


@cache
def threshold(name: str, differential: bool = False) -> float:
    """k at which the emulation's spectral abscissa crosses zero, to 3 %."""
    circuit, probe = prepared(name)
    if differential:
        twin = schematic_of(circuit.schematic.network, differential=True)
        circuit = circuit_of(twin, circuit.scaling)
    low, high = (1.0, 6.0) if differential else (4.0, 12.0)
    while high / low > 1.03:
        k = float(np.sqrt(low * high))
        low, high = (low, k) if abscissa(faster(circuit, k), probe.final) < 0 else (k, high)
    return high


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["car", "double_integrator"])
def test_a_differential_circuit_has_no_inverters_and_is_stable_with_slower_op_amps(name):
    circuit, _ = prepared(name)
    twin = circuit_of(schematic_of(circuit.schematic.network, differential=True), circuit.scaling)
    inverters = {inverter(name) for name in circuit.schematic.inverted}
    assert inverters
    assert inverters <= emulate(circuit, LEVEL).network.neuron_index.keys()
    assert not any(n.startswith("not.") for n in emulate(twin, LEVEL).network.neuron_index)
    assert threshold(name, differential=True) < 0.95 * threshold(name)


def swings(name: str, k: float, duration: float):
    """Ranges of the controls in the middle and at the end of a run in ngspice."""
    circuit, probe = faster(prepared(name)[0], k), prepared(name)[1]
    written = deck_of(circuit, LEVEL, duration=duration)
    raw = Ngspice(timeout=20).run(written.text, end_time=written.end)
    run = read_back(circuit, written, raw, probe).trajectory
    u = run.states[:, run.network.of_population("u")]
    share = run.time / run.time[-1]
    return [np.ptp(u[(share >= a) & (share <= a + 0.1)], axis=0).max() for a in (0.5, 0.9)]


@needs_ngspice
@pytest.mark.parametrize("name", SIMULATED)
@pytest.mark.slow
def test_ngspice_rings_below_the_threshold_and_settles_above(name):
    circuit, probe = prepared(name)
    k = threshold(name)
    growth = abscissa(faster(circuit, 0.9 * k), probe.final)
    try:
        middle, end = swings(name, 0.9 * k, duration=5 / growth)
        assert np.log(end / middle) == pytest.approx(0.4 * 5, abs=0.8)  # as fast as predicted
    except SpiceError:
        pass  # rings so hard that ngspice gives up
    calm = faster(circuit, 1.1 * k)
    assert simulate(BACKEND, calm, probe).settled()


# ---- the emulation against ngspice ---------------------------------------------------------------


@cache
def nominal(name: str):
    return simulate(BACKEND, *prepared(name))


@needs_ngspice
@pytest.mark.parametrize("name", SIMULATED)
def test_ngspice_settles_when_the_emulation_does(name):
    time, _ = run_of(name, LEVEL.datasheet)
    assert simulate(FINE, *prepared(name)).settling_time(1e-3) == pytest.approx(time, rel=0.01)


@pytest.mark.slow
@needs_ngspice
def test_slew_delays_ngspice_as_much():
    run = simulate(replace(BACKEND, level=SLEWING), *prepared("car"))
    time, _ = run_of("car", SLEWING.datasheet)
    assert run.settling_time(1e-3) == pytest.approx(time, rel=0.01)


@needs_ngspice
@pytest.mark.parametrize("name", SIMULATED)
def test_ngspice_settles_where_the_emulation_does_with_every_part_off(name):
    """Offsets of 1 mV, all R, C and gains 1 % off: the shift of every control."""
    circuit, probe = prepared(name)
    tolerances = Tolerances(
        resistor=0.01, capacitor=0.01, offset=1e-3, gain=0.01, product_offset=1e-3
    )
    off = draw(circuit.parameters, tolerances, seed=1)
    run = simulate(BACKEND, circuit, probe, off)
    u = circuit.schematic.network.of_population("u")
    measured = run.trajectory.final[u] - nominal(name).trajectory.final[u]
    predicted = controls_of(name, LEVEL.datasheet, off) - controls_of(name, LEVEL.datasheet)
    assert relative(measured, predicted) > 0.5
    assert relative(predicted - measured, measured) < 2e-5


# ---- preconditioners -----------------------------------------------------------------------------

every_kind = pytest.mark.parametrize("kind", BEYOND)


def with_level(
    kind: preconditioners.PreconditionerKind,
    horizon: int | None,
    bandwidth_margin: float,
    plant: str = "car",
    **datasheet,
):
    backend = SpiceBackend(
        level=macro(**datasheet), bandwidth_margin=bandwidth_margin, node_lag=1e-3
    )
    return backend, *backend.prepare(with_preconditioner(plant, kind, horizon))


def of_the_preconditioner(part: Part) -> bool:
    """True if a part is a node of the preconditioner: an adder or a grid node of some cells."""
    return isinstance(part, (Adder, GridNode)) and part.present is not None


@pytest.mark.sampled(2)
@every_kind
def test_with_fast_op_amps_a_preconditioner_is_the_network(kind):
    """The slowest modes are those of the network, and its settled point is one of the circuit."""
    backend, circuit, probe = with_level(kind, 5, 1e6, a0=1e8)
    emulation = emulate(circuit, backend.level)
    ideal = spectrum(circuit.schematic.network, probe.final).abscissa
    assert pole_spectrum(emulation, probe.final).abscissa == pytest.approx(ideal, rel=0.02)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    expected = emulation.controls(emulated_state(emulation, probe.final))
    np.testing.assert_allclose(emulation.controls(x), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.sampled(2)
@every_kind
def test_errors_of_a_preconditioner_move_no_equilibrium(kind):
    """Resistors between its nodes 1 % off: the controls stay, where those of the cells move."""
    backend, circuit, probe = with_level(kind, 5, 200.0, a0=1e8)
    inner = {part.name for part in circuit.schematic.parts if of_the_preconditioner(part)}
    drawn = draw(circuit.parameters, Tolerances(resistor=0.01), 0)
    of = {  # an inverter behind a neuron belongs to those who read it
        parameter.name: "" if parameter.quantity is Quantity.INVERTER else parameter.part
        for parameter in circuit.parameters
    }
    errors = {}
    for inside in (True, False):
        off = {name: value for name, value in drawn.items() if (of[name] in inner) == inside}
        emulation = emulate(circuit, backend.level, off)
        start = emulated_state(emulation, probe.final)
        x = equilibrium(emulation.network, start)
        errors[inside] = np.abs(emulation.controls(x) - emulation.controls(start)).max()
    assert errors[True] < 1e-4 * errors[False]


@pytest.mark.parametrize(
    "kind",
    [
        preconditioners.PreconditionerKind.MULTILEVEL,
        preconditioners.PreconditionerKind.CYCLIC_REDUCTION,
    ],
)
def test_every_wire_of_a_preconditioner_has_a_name(kind):
    _, circuit, _ = with_level(kind, 5, 200.0)
    wiring = wiring_of(circuit.schematic.network)
    listed = [
        parameter
        for parameter in circuit.parameters
        if of_the_preconditioner(circuit.schematic.by_name[parameter.part])
        and parameter.quantity is Quantity.INPUT
    ]
    wires = wiring.weights.nnz + np.count_nonzero(wiring.constants)
    assert sum(int(parameter.present.sum()) for parameter in listed) == wires
    emulation = emulate(circuit, macro())
    assert {parameter.name for parameter in listed} <= set(emulation.slopes)


@needs_ngspice
@pytest.mark.parametrize(
    ("kind", "bandwidth_margin", "plant", "horizon"),
    [
        (preconditioners.PreconditionerKind.MULTILEVEL, 20.0, "double_integrator", 3),
        pytest.param(
            preconditioners.PreconditionerKind.MULTILEVEL,
            20.0,
            "double_integrator",
            6,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            preconditioners.PreconditionerKind.MULTILEVEL, 20.0, "car", None, marks=pytest.mark.slow
        ),
        pytest.param(
            preconditioners.PreconditionerKind.CYCLIC_REDUCTION,
            150.0,
            "car",
            5,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            preconditioners.PreconditionerKind.CYCLIC_REDUCTION,
            150.0,
            "car",
            None,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_ngspice_agrees_with_the_emulation_of_a_preconditioner(
    kind, bandwidth_margin, plant, horizon
):
    """Settling and error within 5 %, with every error of single parts drawn."""
    backend, circuit, probe = with_level(kind, horizon, bandwidth_margin, plant)
    off = draw(circuit.parameters, Tolerances(resistor=1e-3, offset=1e-4), 1)
    reported = predict(circuit, backend.level, probe, off)
    run = simulate(backend, circuit, probe, off)
    assert run.control_error == pytest.approx(reported.control_error, rel=0.05)
    assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.05)


@pytest.mark.slow
@needs_ngspice
def test_coordinators_of_a_long_row_in_ngspice():
    """N = 36: settled when emulated, in less than half the time of time constants alone."""
    found = {}
    for kind, bandwidth_margin in (
        (preconditioners.PreconditionerKind.MULTILEVEL, 42.0),
        (preconditioners.PreconditionerKind.DIAGONAL, 10.0),
    ):
        network = with_preconditioner("double_integrator", kind, 36)
        backend = SpiceBackend(
            level=macro(), bandwidth_margin=bandwidth_margin, simulation=Simulation(patience=1500)
        )
        circuit, probe = backend.prepare(network)
        reported, run = predict(circuit, macro(), probe), simulate(backend, circuit, probe, {})
        assert run.settling_time() == pytest.approx(reported.settling_time, rel=0.05)
        assert reported.control_error < 1e-4
        found[kind] = run.settling_time()
    assert (
        found[preconditioners.PreconditionerKind.MULTILEVEL]
        < 0.5 * found[preconditioners.PreconditionerKind.DIAGONAL]
    )


@pytest.mark.parametrize("level", [ota_c(), switched_capacitor(step=0.1)], ids=str)
@every_kind
def test_levels_that_cannot_build_a_preconditioner_say_so(kind, level):
    with pytest.raises(NetworkError, match=rf"{level.name} circuits cannot build a {kind.value}"):
        SpiceBackend(level=level).prepare(with_preconditioner("car", kind, 5))


def test_differential_op_amps_build_no_grid():
    backend = SpiceBackend(level=macro(differential=True))
    with pytest.raises(NetworkError, match="diagonal, multilevel"):
        backend.prepare(
            with_preconditioner("car", preconditioners.PreconditionerKind.RESISTIVE_GRID, 5)
        )
