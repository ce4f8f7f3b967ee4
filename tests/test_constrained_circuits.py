"""Networks with inequalities as circuits: rails are clamps, diode neurons op amps with diodes.

What they settle to is compared with the ODE's settled point: the same rows and limits are active,
and controls are as near as the emulation says that finite gains let them be.
"""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from constrained import CONSTRAINED, a, bioreactor, cart, integrator, past_disc, two_tanks, v
from simulator import needs_ngspice
from small_pdk import needs_pdk

from ann_dc import (
    OdeBackend,
    OptimalControlProblem,
    PreconditionerKind,
    Soft,
    SpiceBackend,
    design,
    emulate,
    equilibrium,
    levels,
    ode,
    synthesize,
)
from ann_dc.backends.spice.backend import simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.fitting import fitted
from ann_dc.fidelity.noise_run import settled_noise
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.bill import bill_of
from ann_dc.hardware.circuit.circuit import CLAMP_OFFSETS, CLAMP_REFERENCE
from ann_dc.hardware.emulation.noise_currents import Noise
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.e_series import E96, EXACT
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.resources import circuits_path

SMALL = {
    "limited control": lambda: integrator(N=8, dt=0.25, bounds={a: (-1.2, 1.2)}),
    "limited speed": lambda: integrator(N=8, dt=0.25, bounds={v: (None, 0.65)}),
}
FULL = ("dint_u", "dint_v", "car_steer", "car_disc1", "lander")
ACTIVE = 2e-3
"""Of the largest multiplier, or of the largest control: what counts as active, or at a rail."""


@cache
def network_of(name):
    build = SMALL[name] if name in SMALL else CONSTRAINED[name].build
    return design(build(), preconditioner=PreconditionerKind.DIAGONAL).network


@cache
def prepared(name, level):
    return SpiceBackend(level=level).prepare(network_of(name))


MACRO = levels.macro()


def active(network, x: np.ndarray) -> list[list[bool]]:
    """Which rows and which rails are active at a state."""
    values, found = network.unpack(x), []
    for diode in network.cell.inequality_duals:
        z = values[network.neuron_index[diode.neuron]]
        found.append(list(z > ACTIVE * max(np.abs(x).max(), 1e-12)))
    for neuron in network.cell.neurons:
        u = values[network.neuron_index[neuron.name]]
        for rail in (neuron.limiter.low, neuron.limiter.high):
            if np.isfinite(rail):
                found.append(list(np.abs(u - rail) < ACTIVE * np.abs(u).max()))
    return found


def check_active(run: CircuitRun) -> None:
    network = run.circuit.schematic.network
    assert active(network, run.trajectory.states[-1]) == active(network, run.probe.final)


@needs_ngspice
@pytest.mark.parametrize("name", SMALL)
def test_ideal_parts_settle_where_the_network_does(name):
    run = SpiceBackend().run(network_of(name))
    assert run.settled()
    assert run.control_error < 2e-6
    assert np.array(active(run.circuit.schematic.network, run.probe.final)).any()
    check_active(run)


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    ("name", "share", "sooner"), [("limited control", 0.1, 0.05), ("limited speed", 0.03, 0.02)]
)
def test_op_amps_settle_where_their_emulation_says(name, share, sooner):
    """Diodes of rows are emulated with their drops, those of rails by their laws."""
    run = SpiceBackend(level=MACRO).run(network_of(name))
    found = predict(run.circuit, MACRO, run.probe)
    assert run.settled()
    assert run.control_error < 1e-4
    assert run.control_error == pytest.approx(found.control_error, rel=share)
    assert run.settling_time() == pytest.approx(found.settling_time, rel=sooner)
    check_active(run)


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    ("problem", "level", "seed"),
    [
        (cart, replace(presets.get("tl072_ad633"), full_scale=1.0), 2),
        (cart, levels.macro(gbw=3e6, parasitics=Parasitics(bias_current=1e-6)), None),
        pytest.param(
            SMALL["limited control"],
            levels.macro(tolerances=Tolerances(resistor=1e-3, offset=3e-3)),
            1,
            marks=pytest.mark.slow,
        ),
    ],
    ids=["offsets, pressed", "bias current", "offsets, some pressed"],
)
def test_controls_at_rails_are_where_their_clamps_hold_them(problem, level, seed):
    """Beside them by the clamps' own offsets; what the op amp itself is off by, rails stop."""
    network = design(problem(), preconditioner=PreconditionerKind.DIAGONAL).network
    backend = SpiceBackend(level=level, seed=seed)
    circuit, probe = backend.prepare(network)
    off = backend.deviations(circuit)
    run = simulate(backend, circuit, probe, off)
    nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    found = replace(nominal, deviations=off)
    ideal = probe.control_values[-1].ravel()
    reported, given = (s.emulation.controls(s.settled) - ideal for s in (found, nominal))
    moved = run.trajectory.control_values[-1].ravel() - ideal
    np.testing.assert_allclose(reported, moved, atol=5e-3 * np.abs(moved).max())
    (part,) = (p for p in circuit.schematic.parts if getattr(p, "with_limits", False))
    held = [np.isclose(ideal, end, rtol=1e-6) for end in (part.limiter.low, part.limiter.high)]
    if circuit.value_of(part.name) < 0:
        held.reverse()
    assert np.any(held)
    bias = level.datasheet.parasitics.bias_current * CLAMP_REFERENCE / level.datasheet.gbw
    given = given + bias * circuit.value_of(part.name)  # what finite gain gives way alone
    for at, quantity in zip(held, CLAMP_OFFSETS):
        volts = off.get(circuit.parameter_name(part.name, quantity), np.zeros(len(ideal))) + bias
        wanted = given[at] - volts[at] * circuit.value_of(part.name)
        np.testing.assert_allclose(moved[at], wanted, atol=2e-5 * np.abs(ideal).max())


BOARDS = {
    "rang": (two_tanks, PreconditionerKind.MULTILEVEL, "ad8065_ad835"),
    "rang at 31 MHz": (SMALL["limited control"], PreconditionerKind.MULTILEVEL, "opa828_ad734"),
    "rang, large": (CONSTRAINED["dint_u"].build, PreconditionerKind.MULTILEVEL, "opa828_ad734"),
    "rests beside rails": (
        CONSTRAINED["dint_u"].build,
        PreconditionerKind.MULTILEVEL,
        "tl072_ad633",
    ),
    "passes rails": (
        CONSTRAINED["car_steer"].build,
        PreconditionerKind.DIAGONAL,
        "zero_drift_trimmed",
    ),
}


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "name", ["rang", *(pytest.param(n, marks=pytest.mark.slow) for n in [*BOARDS][1:])]
)
def test_a_board_with_rails_is_as_it_is_emulated(name):
    """Some rang by what idle clamps drive; some were too late, by their diodes, or too early."""
    problem, kind, preset = BOARDS[name]
    level = replace(presets.get(preset), full_scale=1.0)
    network = design(problem(), preconditioner=[kind]).network
    run = SpiceBackend(level=level, simulation=Simulation(patience=1800.0)).run(network)
    found = predict(run.circuit, level, run.probe)
    assert found.stable
    assert run.settled()
    assert run.control_error == pytest.approx(found.control_error, rel=0.02)
    assert run.settling_time() == pytest.approx(found.settling_time, rel=0.02)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.DIAGONAL,
        pytest.param(PreconditionerKind.MULTILEVEL, marks=pytest.mark.slow),
    ],
)
def test_clamps_that_conduct_come_to_rest(kind):
    """Of a tank that is filled until its pump ends at its lower bound; steps shook the diodes."""
    h, u = sp.symbols("h u")
    problem = OptimalControlProblem(
        states=(h,), controls=(u,), dynamics=(h + (u - 0.5 * h - 0.1 * h**2) / 5,), dt=0.2,
        cost=(h - 1) ** 2 + u**2 / 10, horizon=8, q_0=(0.1,), bounds={"u": (0.0, 1.2)},
    )  # fmt: skip
    level = replace(presets.get("tl072_ad633"), full_scale=1.0)
    run = SpiceBackend(level=level).run(design(problem, preconditioner=[kind]).network)
    found = predict(run.circuit, level, run.probe)
    assert not found.other_equilibrium
    assert run.settling_time() == pytest.approx(found.settling_time, rel=0.01)


def test_a_network_that_does_not_settle_is_told_of_a_preconditioner_that_may():
    problem = two_tanks().with_horizon(12)
    network = design(problem, preconditioner=PreconditionerKind.DIAGONAL).network
    network = network.with_start(synthesize(problem).start_state)  # the design found presets
    with pytest.raises(
        NetworkError, match=r"has to settle for scaling; .*--preconditioner multilevel"
    ):
        SpiceBackend().prepare(network)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "level",
    [
        levels.TRANSISTOR,
        pytest.param(SKY130, marks=[needs_pdk, pytest.mark.slow]),
    ],
    ids=lambda level: level.name,
)
def test_rows_that_do_not_press_push_nothing(level):
    """A diode neuron that is off has 10 kohm to ground, where base currents of multipliers show."""
    network = design(past_disc(), preconditioner=PreconditionerKind.DIAGONAL).network
    run = SpiceBackend(level=level).run(network)
    found = predict(run.circuit, level, run.probe)
    assert run.settled()
    check_active(run)
    assert run.control_error == pytest.approx(found.control_error, rel=0.1)
    assert run.settling_time() == pytest.approx(found.settling_time, rel=0.1)


SPEEDS = {
    "hard": lambda: network_of("limited speed"),
    "compliant": lambda: (
        design(
            integrator(N=8, dt=0.25, bounds={v: (None, 0.6)}, soft=Soft(compliance=0.05)),
            preconditioner=PreconditionerKind.DIAGONAL,
        ).network
    ),
}


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("name", SPEEDS)
def test_the_way_is_that_of_the_emulation(name):
    """An op amp takes its time between the diodes of a row: without that it is 2 to 5 % off."""
    run = SpiceBackend(level=MACRO).run(SPEEDS[name]())
    emulation = emulate(run.circuit, MACRO)
    other = OdeBackend(method=ode.DOP853, verify=False).run(emulation.network).trajectory
    time = np.linspace(0, run.settling_time() / run.deck.timing.unit, 200)
    wanted = [np.interp(time, other.time, u) for u in emulation.controls(other.states).T]
    controls = run.trajectory.control_values.reshape(len(run.trajectory.time), -1)
    found = [np.interp(time, run.trajectory.time, u) for u in controls.T]
    np.testing.assert_allclose(found, wanted, atol=1e-2 * np.abs(wanted).max())


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("level", [levels.BEHAVIOURAL, MACRO], ids=["behavioural", "macro"])
@pytest.mark.parametrize("name", FULL)
def test_problems_of_the_suite_settle_as_circuits(name, level):
    """A gain of a million costs up to 2.5e-4 of the largest control, as predicted."""
    patient = Simulation(patience=1800.0)
    run = SpiceBackend(level=level, simulation=patient).run(network_of(name))
    assert run.settled()
    check_active(run)
    if level is MACRO:
        instance = CircuitInstance(circuit=run.circuit, level=level, probe=run.probe)
        assert run.control_error == pytest.approx(instance.control_error, rel=0.3)
        assert run.control_error < 2.5e-4
    else:
        assert run.control_error < 5e-6


def states_over(ideal, run: CircuitRun) -> list[np.ndarray]:
    """States of the plant in both runs, while the ideal one lasts."""
    time, found = np.linspace(0, ideal.time[-1], 1000), []
    for way in (ideal, run.trajectory):
        states = way.states[:, way.network.of_population("q")]
        found.append(np.array([np.interp(time, way.time, q) for q in states.T]))
    return found


def scalar() -> OptimalControlProblem:
    """Of one state, pressed against its lower rail from the middle on."""
    x, u = sp.symbols("x u")
    return OptimalControlProblem(
        states=(x,), controls=(u,), dynamics=(u - 0.2 * x,), dt=0.2, horizon=9, name="scalar",
        cost=(u**2 + 0.5 * x**2) / 2, q_0=(0,), q_d=(-1.4,), bounds={u: (-1, 1)},
    )  # fmt: skip


COUPLED = SMALL | {"scalar": scalar, "cart": cart, "bioreactor": bioreactor}


@cache
def coupled(name, kind):
    build = COUPLED[name] if name in COUPLED else CONSTRAINED[name].build
    return design(build(), preconditioner=[kind]).network


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    ("name", "kind", "course"),
    [
        ("limited control", PreconditionerKind.RESISTIVE_GRID, 0.04),
        ("scalar", PreconditionerKind.RESISTIVE_GRID, 0.05),
        pytest.param("cart", PreconditionerKind.RESISTIVE_GRID, 0.05, marks=pytest.mark.slow),
        pytest.param("bioreactor", PreconditionerKind.RESISTIVE_GRID, 0.05, marks=pytest.mark.slow),
        pytest.param(
            "limited control", PreconditionerKind.CYCLIC_REDUCTION, 0.04, marks=pytest.mark.slow
        ),
        pytest.param("tank_level", PreconditionerKind.RESISTIVE_GRID, 0.03, marks=pytest.mark.slow),
        pytest.param("car_steer", PreconditionerKind.RESISTIVE_GRID, 0.08, marks=pytest.mark.slow),
        pytest.param("lander", PreconditionerKind.RESISTIVE_GRID, 0.08, marks=pytest.mark.slow),
    ],
)
def test_rails_of_coupled_neurons_hold_circuits_as_they_are_emulated(name, kind, course):
    """Within `course`, rms, the states take the way of the projection in the norm of M^-1."""
    network = coupled(name, kind)
    patient = Simulation(patience=1800.0)
    run = SpiceBackend(level=MACRO, simulation=patient).run(network)
    found = predict(run.circuit, MACRO, run.probe)
    assert run.settled()
    assert run.control_error < 1e-3
    assert run.control_error == pytest.approx(found.control_error, rel=0.05, abs=5e-7)
    assert run.settling_time() == pytest.approx(found.settling_time, rel=0.05)
    ideal = OdeBackend(method=ode.DOP853, verify=False).run(network).trajectory
    wanted, settled = (t.control_values[-1] for t in (ideal, run.trajectory))
    np.testing.assert_allclose(settled, wanted, atol=1e-3 * np.abs(wanted).max())
    theirs, ours = states_over(ideal, run)
    assert np.sqrt(((ours - theirs) ** 2).mean() / (theirs**2).mean()) < course


@pytest.mark.slow
@needs_ngspice
def test_states_follow_the_projection_as_closely_as_they_follow_clamps():
    """At a margin of 60, rows are up to 1.9 % off and clamps 1.5 %; at 10, 4.9 % and 8.8 %."""
    problem = integrator(N=4, dt=0.5, bounds={a: (-1.1, 1.1)})
    for kind in (PreconditionerKind.DIAGONAL, PreconditionerKind.RESISTIVE_GRID):
        network = design(problem, preconditioner=[kind]).network
        run = SpiceBackend(level=MACRO, bandwidth_margin=60.0).run(network)
        ideal = OdeBackend(method=ode.DOP853, verify=False).run(network).trajectory
        wanted, found = states_over(ideal, run)
        assert np.abs(wanted - found).max() < 0.022 * np.abs(wanted).max()


@pytest.mark.slow
def test_fitted_intervals_of_rows_are_taken_with_the_network_that_has_rails():
    """Rows that stand in the place of rails have intervals, too."""
    network = coupled("limited control", PreconditionerKind.RESISTIVE_GRID)
    backend = fitted(SpiceBackend(level=MACRO), network)
    assert "zeta_high.u.a" in backend.intervals
    circuit, probe = backend.prepare(network)
    assert predict(circuit, MACRO, probe).stable


def test_a_rail_holds_a_circuit_as_it_holds_the_network():
    """Of ideal parts the emulation settles to the network's own point; none counts as clipped."""
    circuit, probe = prepared("limited control", MACRO)
    emulation = emulate(circuit, levels.macro(a0=1e8))
    network = emulation.network
    x = equilibrium(network, emulated_state(emulation, probe.final))
    low, high = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons]).T
    at = network.places[:, 0]
    held = (x <= low[at]) | (x >= high[at])
    assert held.sum() == np.sum(active(circuit.schematic.network, probe.final)) > 0
    assert not (held & emulation.clips).any()
    assert np.abs(emulation.controls(x) - probe.control_values[-1].ravel()).max() < 1e-6


@pytest.mark.parametrize(
    "level", [levels.TRANSISTOR, levels.ota_c(), levels.macro(differential=True)]
)
def test_levels_without_rails_refuse_them_by_name(level):
    with pytest.raises(
        NetworkError, match=f"limits of u.a are not supported at level {level.name}"
    ):
        SpiceBackend(level=level).prepare(network_of("limited control"))
    circuit, _ = prepared("limited control", MACRO)
    with pytest.raises(NetworkError, match="limits of"):
        emulate(circuit, level)


def test_rails_beyond_one_volt_are_refused():
    tall = replace(MACRO, full_scale=5.0)
    with pytest.raises(
        NetworkError, match=r"up to 1 V, level macro has 5 V; .*macro, ad8065_ad835$"
    ):
        SpiceBackend(level=tall).prepare(network_of("limited control"))


def test_a_rail_beyond_full_scale_is_not_built():
    network = design(
        integrator(N=6, dt=0.3, bounds={a: (-50, 1.5)}),
        preconditioner=PreconditionerKind.DIAGONAL,
    )
    circuit, probe = SpiceBackend().prepare(network.network)
    text = SpiceBackend().deck(circuit, probe, {}).text
    built = [c for c in ("clamp_low", "clamp_high") if f" {c} " in text.partition("---- cells")[2]]
    polarity = circuit.schematic.polarity["u.a"]
    assert built == ["clamp_high" if polarity > 0 else "clamp_low"]


def test_the_bill_has_the_parts_of_clamps_and_diodes():
    circuit, _ = prepared("limited control", MACRO)
    bought = [row.split(",") for row in bill_of(circuit, MACRO, EXACT).splitlines()]
    clamp = {row[1] for row in bought if row[0] == "3" and row[-1] == "clamp of u.a"}
    assert {"x_lo_u_a", "x_hi_u_a", "d_lo_u_a", "c_hi_u_a", "v_hi_u_a"} <= clamp
    whole = float(circuit.capacitors["u.a"][3])
    farads = [
        float(row[3]) for row in bought if row[0] == "3" and row[4] == "F" and "u_a" in row[1]
    ]
    assert sum(farads) / whole == pytest.approx(1, rel=1e-5)
    model = (circuits_path() / "models" / "macro" / "clamp.lib").read_text(encoding="utf-8")
    values = {"opamp_gbw": MACRO.datasheet.gbw, "opamp_rout": MACRO.datasheet.rout, "c": whole}
    for name, prefix in (("R1", "rr"), ("R2", "rd"), ("R3", "rc")):
        formula = re.search(rf"^{name} .*\{{(.*)\}}", model, re.M)[1].replace("20g", "20e9")
        ohms = [float(row[3]) for row in bought if row[:2] == ["3", f"{prefix}_hi_u_a"]]
        assert ohms == [pytest.approx(float(sp.sympify(formula).subs(values)), rel=1e-5)]
    circuit, _ = prepared("limited speed", MACRO)
    rows = [row.split(",") for row in bill_of(circuit, MACRO, E96).splitlines()]
    diodes = [row for row in rows if row[-1] == "rectifier of zeta.v_high" and row[5] == "diode"]
    assert len(diodes) == 7  # none in the first cell, whose speed is given


def test_a_little_capacitance_at_its_ground_hardly_changes_the_noise_of_a_diode_neuron():
    """The same resistors: what they bring goes by way of another node."""
    network = design(SMALL["limited speed"](), preconditioner=PreconditionerKind.DIAGONAL).network
    heard = []
    for farads in (0.0, 1e-13):
        level = levels.macro(parasitics=Parasitics(stray_capacitance=farads))
        circuit, probe = SpiceBackend(level=level).prepare(network)
        built = CircuitInstance(circuit=circuit, level=level, probe=probe)
        lagging = [n.name for n in built.emulation.network.cell.neurons if "lagging" in n.name]
        assert bool(lagging) == (farads > 0)
        rms = settled_noise(built.emulation, built.settled, Noise(step=1.0))
        heard.append(built.emulation.controls(rms))
    np.testing.assert_allclose(*heard, rtol=0.01)
