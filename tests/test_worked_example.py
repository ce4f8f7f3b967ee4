"""The paper's worked example (28)-(30): two stages, and what becomes of t_0 and beta_1.

Every recurrence is written out in NumPy beside the network that has it as a form.
"""

from dataclasses import replace

import numpy as np
import pytest
from car_by_hand import DT, A, control_matrix, solved_stage, step

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import Form, LowerForm, switch
from ann_dc.evaluation.populations import neuron_values
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.solver import synthesize
from ann_dc.synthesis.row import start_values
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.upper_gains import UpperMap
from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator

GAIN, SMALL = 0.05, 1e-3
"""The plain Lagrangian's optimum repels: a large gain leaves it within three iterations."""

Q_0, CONTROLS = np.array([0.0, 0.0, 0.3, 0.2]), np.array([[1.0, 0.5], [1.2, -0.4]])
"""Two steps have four controls for four ends: a target that they reach fixes them."""
Q_1 = step(Q_0, CONTROLS[0])
CAR = plants.car(N=2, q_0=tuple(Q_0), q_d=tuple(step(Q_1, CONTROLS[1])))
T = np.array([0.4, -0.3, 0.2, 0.1])
BETA = np.array([[0.3, 0.1, -0.2, 0.4], [-0.5, 0.6, 0.7, -0.2]])
"""Where t_0, beta_0 and beta_1 start, in the user's units."""


def network_of(form: Form) -> Network:
    """On the plain Lagrangian, in the user's units all through."""
    network = synthesize(decompose(CAR, form), rho=0.0)
    return apply_gains(network, manual_gains(network))


def started(network: Network, t: np.ndarray, beta: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """A state: t_0 (4,), beta (2, 4) and q, u, mu of the stages (2, 10), in the user's units."""
    q, u, mu = stages[:, :4], stages[:, 4:6], stages[:, 6:]
    chain = np.column_stack([q[0], t, CAR.q_d])
    x = start_values(network, InitialGuess(q=chain, u=u.T, mu=mu.T, beta=beta.T))
    rows = network.unpack(x)
    for name, values in zip(CAR.states, q.T):
        place = network.neuron_index[f"q.{name}"]
        rows[place] = network.neuron(f"q.{name}").scale.network(values)
    return network.pack(rows)


def in_user_units(network: Network, gain: float) -> tuple[np.ndarray, np.ndarray]:
    """A gain of t and of beta, each (4,): a drive counts by the scales of its state and of cost."""
    state = np.array([network.neuron(f"q.{s}").scale.factor for s in CAR.states])
    multiplier = np.array([network.neuron(f"mu.{s}").scale.factor for s in CAR.states])
    return gain * state / multiplier, gain * multiplier / state


@pytest.mark.parametrize("rounds", [0, 1, 4])
def test_the_example_corrected(rounds):
    """t_0 += lambda (mu_0 + beta_1) and beta_1 += lambda (q_1 - t_0), after stages that settle."""
    network = network_of(switch("S14"))
    of_t, of_beta = in_user_units(network, SMALL)
    t, beta = Q_1 + 0.01 * T, 0.05 * BETA
    first = np.array([[*Q_0, *CONTROLS[0], *-BETA[1]], [*Q_1, *CONTROLS[1], *-BETA[1]]])
    stages = np.array([*map(solved_stage, (t, CAR.q_d), beta, first)])
    layer = TwoLevels(network, upper=Gradient(lambda_t=SMALL, lambda_beta=SMALL))
    run = layer.run(started(network, t, beta, stages), limit=rounds, tolerance=1e-300)
    for _ in range(rounds):
        move_t = of_t * (stages[0, 6:] + beta[1])
        move_beta = of_beta * (stages[:, :4] - [Q_0, t])
        t, beta = t + move_t, beta + move_beta
        stages = np.array([*map(solved_stage, (t, np.array(CAR.q_d)), beta, stages)])
    found = neuron_values(network, run.states[0])
    np.testing.assert_allclose(found["t"][0], t, atol=1e-8)
    np.testing.assert_allclose(found["beta"], beta, atol=1e-8)
    np.testing.assert_allclose(np.hstack([found[p] for p in ("q", "u", "mu")]), stages, atol=1e-6)


def test_the_example_ends_where_its_controls_lead():
    run = TwoLevels(network_of(switch("S14")), upper=NewtonCoordinator()).run(tolerance=1e-10)
    assert run.settled.all()
    found = neuron_values(network_of(switch("S14")), run.states[0])
    np.testing.assert_allclose(found["u"], CONTROLS, atol=1e-6)
    np.testing.assert_allclose(found["t"][0], Q_1, atol=1e-6)
    for k, q in enumerate((Q_0, Q_1)):
        np.testing.assert_allclose(
            found["u"][k], -DT * control_matrix(q).T @ found["mu"][k], atol=1e-5
        )
    np.testing.assert_allclose(found["mu"][0], -found["beta"][1], rtol=1e-5)


def test_two_gains_solve_two_stages_of_a_linear_plant():
    """From rest over a distance s: a_0 = s / dt^2, and a_1 takes it all back."""
    distance = 0.02
    problem = plants.double_integrator(N=2, q_d=(distance, 0.0))
    found = design(
        synthesize(decompose(problem, switch("S14"))),
        preconditioner=PreconditionerKind.MULTILEVEL,
    )
    gains = UpperMap(network=found.network, settled=found.state).best()
    upper = Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)
    run = TwoLevels(found.network, upper=upper).run(tolerance=1e-9)
    assert run.settled.all()
    controls = neuron_values(found.network, run.states[0])["u"][:, 0]
    np.testing.assert_allclose(controls, [distance / DT**2, -distance / DT**2], rtol=1e-6)


LITERAL = replace(switch("S14"), lower_level=LowerForm.LITERAL)
AS_PRINTED = replace(LITERAL, coupling_adds=True, coupling_reads_next=True)
"""(28)-(30), all of it to the letter; t_2 is beyond a row of two stages, and carries nothing."""


def literal_stages(t: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """(q, u, mu) of (30): q_k = t_{k-1} / 0.99, mu_k = beta_{k+1}, u_k = B mu_k / 0.1.

    Its first line, q_0 = (t_0 0.1 B u_0) / 0.99, computes what is given; no cell has it.
    """
    q, mu = np.array([Q_0, t]) / A, np.array([beta[1], np.zeros(4)])
    return np.hstack([q, [control_matrix(at).T @ m / DT for at, m in zip(q, mu)], mu])


@pytest.mark.parametrize("rounds", [0, 1, 5])
@pytest.mark.parametrize("form", [LITERAL, AS_PRINTED], ids=["(30)", "(28)-(30)"])
def test_the_example_to_the_letter(form, rounds):
    """t_0 and beta_1 say the same to each other again and again, and no control is asked."""
    network = network_of(form)
    of_t, of_beta = in_user_units(network, GAIN)
    nowhere = [network.neuron(f"t.{s}").scale.offset for s in CAR.states]
    t, beta = T, BETA
    for _ in range(rounds):
        q = literal_stages(t, beta)[:, :4]
        read = np.array([CAR.q_d, nowhere] if form is AS_PRINTED else [-Q_0, -t])
        t, beta = t + of_t * 2 * beta[1], beta + of_beta * (q + read)
    layer = TwoLevels(network, upper=Gradient(lambda_t=GAIN, lambda_beta=GAIN))
    x = started(network, T, BETA, np.zeros((2, 10)))
    found = neuron_values(network, layer.run(x, limit=rounds, tolerance=1e-300).states[0])
    np.testing.assert_allclose(found["t"][0], t, rtol=1e-9)
    np.testing.assert_allclose(found["beta"], beta, rtol=1e-9)
    stages = np.hstack([found[p] for p in ("q", "u", "mu")])
    np.testing.assert_allclose(stages, literal_stages(t, beta), rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_to_the_letter_the_example_runs_away():
    """t_0 += 2 lambda beta_1 and beta_1 += lambda t_0 (1/0.99 - 1): a factor above one."""
    network = network_of(LITERAL)
    of_t, of_beta = in_user_units(network, GAIN)
    growth = 1 + np.sqrt(2 * of_t * of_beta * (1 / A - 1))
    layer = TwoLevels(network, upper=Gradient(lambda_t=GAIN, lambda_beta=GAIN))
    x = started(network, T, BETA, np.zeros((2, 10)))
    late, later = (
        neuron_values(network, layer.run(x, limit=rounds, tolerance=1e-300).states[0])["t"][0]
        for rounds in (900, 1000)
    )
    np.testing.assert_allclose(later / late, growth**100, rtol=1e-3)
