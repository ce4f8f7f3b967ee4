"""How a run ended, in one sentence: what is blamed, when, and what to do."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ann_dc
from ann_dc import OdeBackend, RecurrentBackend, SpiceBackend, ode
from ann_dc.backends import status
from ann_dc.backends.status import (
    EXPLANATIONS,
    UNMET,
    Outcome,
    Status,
    completed,
    diverged,
    infeasible,
    left_domain,
    not_settled,
    settled,
    stalled,
    stopped,
    unbounded,
)
from ann_dc.errors import NetworkError
from ann_dc.network.cell import ONE, Cell, Connection, Function, Limiter, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.solution.running import found_without

CELL = Cell(
    neurons=(Neuron(name="q.x"), Neuron(name="q.v")),
    blocks=(Function(name="tan_x", function="tan", x="q.x"),),
    connections=(),
)
ROW = Network(cell=CELL, stages=2)


def state(**values: list[float]) -> np.ndarray:
    """State vector (n,) of `ROW` by neuron and stage."""
    return ROW.pack(np.array([values["x"], values["v"]]))


ENDS = {
    Outcome.SETTLED: settled(1e-9, 7.0),
    Outcome.COMPLETED: completed((1e-9, 1e-2), 7.0),
    Outcome.NOT_SETTLED: not_settled((1e-9, 1e-2), 7.0, "900 steps"),
    Outcome.DIVERGED: diverged(ROW, np.ones(4), 7.0),
    Outcome.LEFT_DOMAIN: left_domain(ROW, 0, 1, 7.0),
    Outcome.STALLED: stalled((1e-9, 1e-2), 7.0, "nothing moves", "try another guess"),
    Outcome.STOPPED: stopped((1e-9, 1e-2), 7.0, "interrupted"),
    Outcome.FOUND: found_without("the search", not_settled((1e-9, 1e-2), 7.0, "900 steps")),
    Outcome.INFEASIBLE: infeasible("no controls reach q_d.x", 7.0),
    Outcome.UNBOUNDED: unbounded("the cost has no minimum", 7.0),
}

FIRST_WORDS = {
    Outcome.SETTLED: "settled after",
    Outcome.COMPLETED: "completed after",
    Outcome.NOT_SETTLED: "not settled within",
    Outcome.DIVERGED: "diverged after",
    Outcome.LEFT_DOMAIN: "left the domain of",
    Outcome.STALLED: "stalled after",
    Outcome.STOPPED: "stopped after",
    Outcome.FOUND: "found by the search",
    Outcome.INFEASIBLE: "infeasible: no controls",
    Outcome.UNBOUNDED: "unbounded: the cost",
}
HOPELESS = (Outcome.INFEASIBLE, Outcome.UNBOUNDED)


@pytest.mark.parametrize("outcome", Outcome)
def test_every_outcome_has_its_sentence(outcome):
    status = ENDS[outcome]
    assert status.outcome is outcome
    assert status.time == 7.0
    assert str(status) == status.message
    timed = any(part in str(status) for part in ("after 7 unit time constants", "(s = 7)"))
    assert timed == (outcome not in HOPELESS)
    assert str(status).startswith(FIRST_WORDS[outcome])


@pytest.mark.parametrize("outcome", Outcome)
def test_only_what_settled_is_settled(outcome):
    assert ENDS[outcome].settled == (outcome is Outcome.SETTLED)


@pytest.mark.parametrize("outcome", [Outcome.SETTLED, Outcome.NOT_SETTLED])
def test_nobody_is_blamed_for_a_bound(outcome):
    assert ENDS[outcome].neuron is None


def blamed(x: np.ndarray) -> Status:
    return diverged(ROW, x, 1.0)


def test_the_largest_state_is_blamed_whatever_its_sign():
    status = blamed(state(x=[1.0, 2.0], v=[3.0, -4e9]))
    assert status.neuron == "q[1].v"
    assert "q[1].v reached -4e+09" in str(status)


@pytest.mark.parametrize("lost", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_blamed_before_what_is_large(lost):
    assert blamed(state(x=[1e300, lost], v=[3.0, 4.0])).neuron == "q[1].x"


def test_a_solver_may_add_a_note():
    assert str(diverged(ROW, np.ones(4), 1.0, "the step is too small")).endswith(
        "(the step is too small)"
    )


def test_a_block_is_named_with_its_cell_and_what_helps():
    status = left_domain(ROW, 0, 1, 2.5)
    assert status.neuron == "tan_x [1]"
    assert "tan_x in cell 1" in str(status)
    assert "start closer" in str(status)


@pytest.mark.parametrize("unmet", [UNMET, 1.0, np.nan])
def test_a_target_out_of_reach_is_suspected_where_constraints_are_not_met(unmet):
    assert "target is within reach" in str(not_settled((unmet, 0.0), 1.0, "900 steps"))


def test_no_suspicion_where_they_are_met():
    text = str(not_settled((0.99 * UNMET, 0.5), 1.0, "900 steps"))
    assert text == "not settled within 900 steps (s = 1): KKT residual 5.0e-01"


def leak(weight: float) -> Network:
    """x' = weight x + 1, wired by hand."""
    wires = (
        Connection(source="x", target="x", weight=weight),
        Connection(source=ONE, target="x"),
    )
    return Network(cell=Cell(neurons=(Neuron(name="x"),), connections=wires), stages=1)


@pytest.mark.parametrize(
    ("backend", "words"),
    [
        (OdeBackend(), "settled after"),
        (OdeBackend(duration=1.0), "completed after 1 unit time constants"),
        (RecurrentBackend(), "settled after"),
        (RecurrentBackend(limit=2), "not settled within 2 steps"),
    ],
)
def test_a_network_wired_by_hand_has_a_residual_without_kkt_conditions(backend, words):
    text = str(backend.run(leak(-1.0)).status)
    assert text.startswith(words)
    assert ": residual " in text
    assert "KKT" not in text


# Advice: a network can follow it, and where it is followed the run settles.


def wire(source: str, target: str, weight: float = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def stiff(fast: float = 1e6) -> Network:
    """A lag of one time constant, followed by one that is much faster."""
    wires = wire("x", "x", -fast), wire("y", "x", fast), wire("y", "y", -1.0), wire(ONE, "y")
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=wires)
    return Network(cell=cell, stages=1, title="stiff")


def limit_cycle(leak: float = 0.0) -> Network:
    """Van der Pol's oscillator, which never settles without a leak."""
    blocks = Product(name="xx", a="x", b="x"), Product(name="xxy", a="xx", b="y")
    wires = wire("y", "x"), wire("x", "y", -1.0), wire("xxy", "y", -1.0)
    wires += wire("x", "x", -leak), wire("y", "y", 1.0 - leak)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), blocks=blocks, connections=wires)
    return Network(cell=cell, stages=1, start={"x": 0.1}, title="limit cycle")


def lag(**rails: float) -> Network:
    """A lag of one time constant that settles at 1."""
    neuron, wires = (
        Neuron(name="x", limiter=Limiter(**rails)),
        (wire(ONE, "x"), wire("x", "x", -1.0)),
    )
    return Network(cell=Cell(neurons=(neuron,), connections=wires), stages=1, title="lag")


def damped() -> Network:
    """A swing that takes long to settle, begun near its end."""
    wires = wire("v", "x"), wire("x", "v", -1.0), wire(ONE, "v"), wire("v", "v", -0.02)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=wires)
    return Network(cell=cell, stages=1, start={"x": 1.000001}, title="damped")


def with_limits() -> Network:
    """The lag between rails, which hold it where its steps are too long."""
    return lag(low=-1.0, high=2.0)


def rooted(start: float) -> Network:
    """A damped swing about 1, and the square root of where it is."""
    blocks = (Function(name="root", function="sqrt", x="x"),)
    wires = wire("v", "x"), wire("x", "v", -1.0), wire(ONE, "v"), wire("v", "v", -0.5)
    wires += wire("root", "y"), wire("y", "y", -1.0)
    neurons = tuple(Neuron(name=name) for name in "xvy")
    cell = Cell(neurons=neurons, blocks=blocks, connections=wires)
    return Network(cell=cell, stages=1, start={"x": start}, title="rooted")


@cache
def pushed(most: float = 60.0, target: float = 4.0, price: float | None = None) -> Network:
    """A mass at rest that comes as far as 4 only if it is pushed by more than 60."""
    plant = ann_dc.plants.double_integrator(N=4)
    soft = {"soft": {"push": price}} if price else {}
    limited = replace(plant, constraints={"push": plant.controls[0] <= most}, **soft)
    return ann_dc.design(limited).network.with_inputs({"q_d.x": target})


ODE = OdeBackend(limit=1e9, most_steps=9000, verify=False)
STEPS, FIXED = RecurrentBackend(limit=9000), ann_dc.FixedStep(step=2.5)
RADAU, BDF = replace(ODE, method=ode.RADAU), replace(ODE, method=ode.BDF)
LATE, STALLED = Outcome.NOT_SETTLED, Outcome.STALLED
DAMPING = "damp it: reduce the weights of the neurons' connections to themselves"
IMPLICIT = "use an implicit method: method=ann_dc.ode.RADAU or --method Radau"
REACH = "check that the target is within reach"
GROWTH = "multipliers z.push, beta.v, mu.v, beta.x grow linearly"
LOOSEN, SOFT, TARGET = "widen the bounds", "make a constraint soft", "change the target"
ADVICE = [
    (LATE, "steps (most_steps)", replace(ODE, most_steps=9), lag, ODE, lag),
    (LATE, "tau_min (limit)", replace(ODE, limit=2.0), lag, ODE, lag),
    (LATE, "9 steps (limit)", replace(STEPS, limit=9), lag, STEPS, lag),
    (LATE, REACH, OdeBackend(), pushed, ODE, lambda: pushed(target=1.0)),
    (LATE, GROWTH, OdeBackend(), pushed, ODE, lambda: pushed(target=1.0)),
    (LATE, LOOSEN, OdeBackend(), pushed, ODE, lambda: pushed(240.0)),
    (LATE, SOFT, OdeBackend(), pushed, ODE, lambda: pushed(price=300.0)),
    (STALLED, TARGET, STEPS, pushed, STEPS, lambda: pushed(target=1.0)),
    (STALLED, LOOSEN, STEPS, pushed, STEPS, lambda: pushed(240.0)),
    (STALLED, SOFT, STEPS, pushed, STEPS, lambda: pushed(price=300.0)),
    (STALLED, IMPLICIT, ODE, stiff, RADAU, stiff),
    (STALLED, IMPLICIT, replace(ODE, method=ode.DOP853), stiff, RADAU, stiff),
    (STALLED, "--method compiled", BDF, damped, ODE, damped),
    (STALLED, "method.tighter()", BDF, damped, replace(ODE, method=ode.BDF.tighter()), damped),
    (STALLED, DAMPING, ODE, limit_cycle, ODE, lambda: limit_cycle(leak=2.0)),
    pytest.param(
        STALLED,
        DAMPING,
        RADAU,
        limit_cycle,
        RADAU,
        lambda: limit_cycle(leak=2.0),
        marks=pytest.mark.slow,
    ),
    (STALLED, DAMPING, STEPS, limit_cycle, STEPS, lambda: limit_cycle(leak=2.0)),
    (
        STALLED,
        "step=ann_dc.AdaptiveStep()",
        replace(STEPS, step=FIXED),
        with_limits,
        STEPS,
        with_limits,
    ),
    (Outcome.LEFT_DOMAIN, "start closer", ODE, lambda: rooted(6.0), ODE, lambda: rooted(1.2)),
    (Outcome.LEFT_DOMAIN, "start closer", STEPS, lambda: rooted(6.0), STEPS, lambda: rooted(1.2)),
]  # fmt: skip
"""Outcome, advice, the backend and network that are told so, and those that follow."""


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore:.*step:UserWarning")
@pytest.mark.parametrize(("outcome", "advice", "backend", "network", "other", "changed"), ADVICE)
def test_run_that_follows_advice_settles(outcome, advice, backend, network, other, changed):
    reported = backend.run(network()).status
    assert reported.outcome is outcome
    assert advice in str(reported)
    assert other.run(changed()).status.settled


@pytest.mark.parametrize("backend", [ODE, STEPS])
def test_limit_cycle_is_not_told_to_start_elsewhere(backend):
    reported = str(backend.run(limit_cycle()).status)
    assert "neuron y[0] continued to oscillate by 5." in reported
    assert "another --initial-guess" not in reported


@pytest.mark.slow
def test_error_of_an_implicit_method_is_not_blamed_on_the_network():
    reported = str(BDF.run(damped()).status)
    assert (
        "did not reduce it: it equals the error of BDF with rtol=1e-06; use the compiled method"
        in reported
    )
    assert "another --initial-guess" not in reported
    _, advice = status.no_headway(damped(), np.ones((9, 2)), 9, 1e-4, ode.BDF)
    assert advice == "try another --initial-guess"  # the method errs less than that


def test_contradicting_constraints_are_not_told_to_start_elsewhere():
    assert "another --initial-guess" not in str(STEPS.run(pushed()).status)


@pytest.mark.slow
def test_network_without_duals_is_not_told_of_a_design_or_a_preconditioner():
    run = OdeBackend(limit=1e6, most_steps=9000, verify=False).run(limit_cycle())
    assert run.status.outcome is Outcome.STALLED
    assert "design" not in str(run.status)
    with pytest.raises(NetworkError, match="has to settle") as error:
        SpiceBackend().run(limit_cycle())
    assert "MULTILEVEL" not in str(error.value)


def test_network_without_duals_is_not_told_of_more_penalty():
    """x' = -1 from 0.5 leaves the domain of sqrt; from further up it would, too, but later."""
    blocks = (Function(name="root", function="sqrt", x="x"),)
    wires = wire(ONE, "x", -1.0), wire("root", "x", 0.01)
    cell = Cell(neurons=(Neuron(name="x"),), blocks=blocks, connections=wires)
    run = RecurrentBackend().run(Network(cell=cell, stages=1, start={"x": 0.5}, title="root"))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert "start closer" in str(run.status)
    assert "penalty" not in str(run.status)


@pytest.mark.parametrize("outcome", Outcome)
def test_every_outcome_has_a_meaning_and_a_next_step(outcome):
    meaning, next_step = EXPLANATIONS[outcome]
    assert meaning[:1].isupper()
    assert meaning.endswith(".")
    assert next_step[:1].islower()
    assert not next_step.endswith(".")
    assert max(len(meaning), len(next_step)) <= 90
    assert "\n" not in meaning + next_step


def test_explanations_differ_and_name_outcomes_only():
    assert EXPLANATIONS.keys() == {*Outcome}
    assert len({*EXPLANATIONS.values()}) == len(Outcome)
    assert len({next_step for _, next_step in EXPLANATIONS.values()}) == len(Outcome)
