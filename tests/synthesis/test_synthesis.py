"""The wired cell against the stage equations, evaluated by SymPy without any wiring."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from designs import near_start, small
from problems import SUITE

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, PRINTED, SWITCHES, Form
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Function, Product
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess, interpolated_guess
from ann_dc.problem.scales import Scales, scales_of
from ann_dc.scale import Scale
from ann_dc.synthesis.synthesis import synthesize

RHO = 0.7


class ByTheBook:
    """Drives of every neuron (neurons, N) in network units, straight from (11)-(15)."""

    def __init__(self, problem, form: Form, scales: Scales, rho: float) -> None:
        self.equations, self.scales, self.rho = decompose(problem, form), scales, rho
        self.problem, self.form = problem, form

    def drives(self, network: Network, x: np.ndarray) -> np.ndarray:
        equations, problem, stages = self.equations, self.problem, self.problem.horizon
        rows = in_user_units(network, network.unpack(x))
        n, m = problem.n, problem.m
        q, u, t, mu, beta = np.split(rows, np.cumsum([n, m, n, n]))
        given: dict[sp.Symbol, np.ndarray] = dict(problem.inputs)
        for symbols, values in (
            (problem.states, q),
            (problem.controls, u),
            (equations.t, t),
            (equations.mu, mu),
            (equations.beta, beta),
        ):
            given |= dict(zip(symbols, values))
        given |= dict(zip(equations.t_neighbour, self._neighbour(t)))
        rho = self.rho * self.scales.cost / self.scales.state_factors[:, None] ** 2
        c = self._evaluate(equations.grad_mu, given | self._no_news())
        m_values = mu + (0.0 if self.form.closed_lower_level else rho) * c
        b_values = beta + rho * self._evaluate(equations.grad_beta, given)
        b_values[~np.array(problem.fixed_start), 0] = 0.0  # nothing ties a free q_0
        given |= dict(zip(equations.mu, m_values)) | dict(zip(equations.beta, b_values))
        given |= dict(zip(equations.beta_next, np.pad(b_values[:, 1:], ((0, 0), (0, 1)))))
        parts = [equation.sign * self._evaluate([equation], given) for equation in equations.all]
        drives = np.concatenate(parts)
        drives[n + m : 2 * n + m, -1] -= self._terminal_slope(given, stages)
        return np.where(network.live, drives * self._scales()[:, None], 0.0)

    def _no_news(self) -> Mapping:
        return dict.fromkeys(self.equations.beta_next, np.zeros(self.problem.horizon))

    def _neighbour(self, t: np.ndarray) -> np.ndarray:
        if self.form.coupling_reads_next:
            beyond = [scale.offset for scale in self.scales.states]  # a wire to nowhere carries 0
            return np.column_stack([t[:, 1:], beyond])
        before = np.pad(t[:, :-1], ((0, 0), (1, 0)))
        if self.form.start_is_neuron:
            before[:, 0] = self.problem.ends[0]
        return before

    def _scales(self) -> np.ndarray:
        """A gradient counts by the scales of cost and variable, a constraint by its state's."""
        state, cost = self.scales.state_factors, self.scales.cost
        of_q, of_mu = state / cost, 1.0 / state
        if self.form.closed_lower_level:  # (30) swaps them
            of_q, of_mu = of_mu, of_q
        control = self.scales.control_factors / cost
        return np.concatenate([of_q, control, state / cost, of_mu, 1.0 / state])

    def _terminal_slope(self, given: Mapping, stages: int) -> np.ndarray:
        slopes = []
        for symbol, fixed in zip(self.equations.t, self.problem.fixed):
            slope = self.equations.terminal_cost.diff(symbol)
            free = self.form.terminal_free or not fixed
            slopes.append(_call(slope, given, stages)[-1] if free else 0.0)
        return np.array(slopes)

    def _evaluate(self, equations, given: Mapping) -> np.ndarray:
        return np.array([_call(e.expression, given, self.problem.horizon) for e in equations])


def in_user_units(network: Network, rows: np.ndarray) -> np.ndarray:
    """Neurons (neurons, N) as the user measures them; absent ones stay zero."""
    by_name = zip(network.cell.neurons, rows)
    values = np.stack([neuron.scale.user(row) for neuron, row in by_name])
    for absent in network.omitted:
        values[network.neuron_index[absent.neuron], absent.stage] = 0.0
    return values


def _call(expression: sp.Expr, given: Mapping, stages: int) -> np.ndarray:
    symbols = sorted(expression.free_symbols, key=str)
    value = sp.lambdify(symbols, expression, "numpy")(*(given[s] for s in symbols))
    return np.broadcast_to(value, (stages,))


def assert_by_the_book(
    problem, form: Form = CORRECTED, scales: Scales | None = None, rho: float = RHO
):
    scales = scales or scales_of(problem)
    network = synthesize(decompose(problem, form), scales=scales, rho=rho)
    book = ByTheBook(problem, form, scales, rho)
    for x in near_start(network, 0, count=3):
        expected = book.drives(network, x)
        scale = np.abs(expected).max()
        assert scale > 0
        np.testing.assert_allclose(
            evaluator(network).drives(x), expected, rtol=1e-12, atol=1e-13 * scale
        )


@pytest.mark.parametrize("name", SUITE)
@pytest.mark.sampled(3)
def test_every_problem_by_the_book(name):
    assert_by_the_book(SUITE[name].problem.with_horizon(4))


@pytest.mark.parametrize("rho", [0.0, RHO])
@pytest.mark.parametrize("switched", SWITCHES)
@pytest.mark.sampled(4)
def test_every_switch_of_the_car(switched, rho):
    assert_by_the_book(plants.car(N=4, D=0.7, c_over_m=1.3), SWITCHES[switched], rho=rho)


@pytest.mark.parametrize("rho", [0.0, RHO])
def test_the_printed_form(rho):
    assert_by_the_book(plants.car(N=4), PRINTED, rho=rho)


@pytest.mark.parametrize("switched", ["S3", "S4", "S5", "S6", "S12", "S13", "S14", "S15", "S17"])
@pytest.mark.parametrize("name", ["pendulum_state_cost", "unicycle_obstacle", "cstr"])
@pytest.mark.sampled(3)
def test_switches_where_states_cost(name, switched):
    assert_by_the_book(SUITE[name].problem.with_horizon(4), SWITCHES[switched])


def by_hand(problem: OptimalControlProblem) -> Scales:
    """Scales and offsets of which none is one or zero."""
    factors = np.linspace(0.3, 4.0, problem.n + problem.m)
    scales = [Scale(float(f), 1.7 - 0.4 * f) for f in factors]
    return Scales(states=tuple(scales[: problem.n]), controls=tuple(scales[problem.n :]), cost=20.0)


def test_the_users_own_units():
    problem = plants.car(N=4)
    assert_by_the_book(problem, scales=Scales.none(problem))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("switched", ["S3", "S5", "S7", "S8", "S9", "S14", "S15"])
def test_scales_by_hand(switched):
    problem = plants.car(N=4, D=0.7)
    assert_by_the_book(problem, scales=by_hand(problem))
    assert_by_the_book(problem, SWITCHES[switched], scales=by_hand(problem))


@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S14"]], ids=str)
def test_scales_by_hand_where_ends_are_free(form):
    problem = tracking(q_d=(None, 0.5))
    assert_by_the_book(problem, form, scales=by_hand(problem))


def test_plain_wires_have_weight_one():
    """What the scales cancel in, they cancel in to the bit."""
    problem = plants.car(N=4)
    for scales in (scales_of(problem), by_hand(problem)):
        cell = synthesize(decompose(problem), scales=scales).cell
        coupling = [c for c in cell.connections if c.target.startswith("r.")]
        targets = [c for c in cell.connections if c.target.startswith("t.")]
        assert {c.weight for c in coupling} == {1.0, -1.0}
        assert {c.weight for c in targets} == {1.0}  # t' = m + b
        assert len(coupling) == len(targets) == 8


def tracking(stages: int = 4, **changes) -> OptimalControlProblem:
    """A free end with a price, a reference that differs by stage, a disturbed map."""
    x, v, a, wanted, gust = sp.symbols("x v a wanted gust")
    fields = {
        "states": (x, v),
        "controls": (a,),
        "dynamics": (v, a - gust * v**3),
        "dt": 0.2,
        "cost": (x - wanted) ** 2 + a**2 / 2,
        "terminal_cost": 3 * (x - wanted) ** 2 + x**2 * v**2 + sp.cos(v),
        "horizon": stages,
        "q_0": (0.3, -0.1),
        "inputs": {wanted: np.linspace(0, 2, stages), gust: 0.3},
    }
    return OptimalControlProblem(**(fields | changes))


@pytest.mark.parametrize("q_d", [None, (None, 0.5), (1.0, None), (1.0, 0.5)])
@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S14"]], ids=str)
def test_free_ends_and_inputs_by_stage(q_d, form):
    assert_by_the_book(tracking(q_d=q_d), form)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("q_0", [(None, -0.1), (0.3, None), (None, None)])
@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S14"], SWITCHES["S10"]], ids=str)
def test_free_starts(q_0, form):
    assert_by_the_book(tracking(q_0=q_0, q_d=(1.0, None)), form)
    assert_by_the_book(tracking(1, q_0=q_0), form)


def test_one_stage():
    assert_by_the_book(tracking(1))
    assert_by_the_book(tracking(1), SWITCHES["S14"])


def test_two_switches_at_once():
    form = replace(SWITCHES["S14"], terminal_free=True, coupling_coefficient=0.55)
    assert_by_the_book(plants.car(N=3), form)


# ---- what is built -----------------------------------------------------------------------------


def test_the_cell_of_the_car():
    cell = small("car").cell
    assert len(cell.neurons) == 18
    assert sorted(b.function for b in cell.blocks if isinstance(b, Function)) == [
        "cos",
        "sin",
        "tan",
    ]
    assert cell.count(Product) <= 11


@pytest.mark.parametrize("name", SUITE)
def test_no_block_is_built_twice(name):
    cell = small(name).cell
    functions = [(b.function, b.x) for b in cell.blocks if isinstance(b, Function)]
    products = [frozenset((b.a, b.b)) for b in cell.blocks if isinstance(b, Product)]
    wires = [connection.name for connection in cell.connections]
    for built in (functions, products, wires):
        assert len(set(built)) == len(built)


@pytest.mark.parametrize("name", SUITE)
def test_every_block_is_read(name):
    cell = small(name).cell
    read = {connection.source for connection in cell.connections}
    for block in cell.blocks:
        read |= {getattr(block, pin) for pin in ("a", "b", "x") if hasattr(block, pin)}
    assert {block.name for block in cell.blocks} <= read


def test_ends_of_the_row_are_data():
    network = small("car")
    n, stages = 4, network.stages
    assert network.size == 18 * stages - 3 * n  # q of cell 0, t of the last cell, beta of cell 0
    assert {(pin.neuron, pin.stage) for pin in network.fixed} == {
        *((f"q.{s}", 0) for s in ("x", "y", "phi", "varphi")),
        *((f"t.{s}", stages - 1) for s in ("x", "y", "phi", "varphi")),
    }
    closed = small("car", SWITCHES["S14"])
    assert closed.size == 18 * stages - n
    assert closed.left_boundary == {f"t.{s}": f"q_0.{s}" for s in ("x", "y", "phi", "varphi")}


def test_free_component_keeps_its_neuron():
    network = synthesize(decompose(tracking(q_d=(1.0, None))))
    assert not network.live[network.neuron_index["t.x"], -1]
    assert network.live[network.neuron_index["t.v"], -1]
    assert "q_d.v" not in network.cell.inputs


@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S14"]], ids=str)
def test_a_free_start_is_a_neuron_that_nothing_ties(form):
    network = synthesize(decompose(tracking(q_0=(0.3, None)), form))
    index, live = network.neuron_index, network.live
    assert live[index["q.v"], 0]
    assert not live[index["beta.v"], 0]
    assert "q_0.v" not in network.cell.inputs
    assert {pin.neuron for pin in network.fixed if pin.stage == 0} <= {"q.x"}
    (tie,) = (c for c in network.cell.connections if c.name == "q.v<-b.v")
    assert np.asarray(tie.weight).tolist() == [0.0, -1.0, -1.0, -1.0]


def test_start_arrives_in_network_units():
    problem = plants.car(N=4)
    line = interpolated_guess(problem)
    mu = np.arange(16.0).reshape(4, 4)
    network = synthesize(
        decompose(problem), initial_guess=InitialGuess(q=line.q, u=line.u, mu=mu, beta=-mu)
    )
    values = in_user_units(network, network.unpack(network.start_state))
    rows = network.neuron_index
    np.testing.assert_allclose(values[rows["q.x"]], line.q[0, :-1], atol=1e-15)
    np.testing.assert_allclose(values[rows["t.y"]], line.q[1, 1:], atol=1e-15)
    np.testing.assert_allclose(values[rows["u.nu"]], line.u[0], rtol=1e-14)
    np.testing.assert_allclose(values[rows["mu.phi"]], mu[2], rtol=1e-14)
    np.testing.assert_allclose(values[rows["beta.x"], 1:], -mu[0, 1:], rtol=1e-14)


def test_inputs_change_without_rewiring():
    problem = tracking(q_d=(1.0, None))
    network = synthesize(decompose(problem))
    other = problem.with_inputs(q_d=(2.0, None), wanted=np.ones(4), gust=0.1)
    rewired = synthesize(decompose(other), scales=scales_of(problem))
    changed = network.with_inputs({"q_d.x": 2.0, "wanted": np.ones(4), "gust": 0.1})
    x = near_start(network, 0)
    np.testing.assert_array_equal(evaluator(changed).rhs(x), evaluator(rewired).rhs(x))
