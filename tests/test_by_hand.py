"""Networks wired by hand: the same records and the same evaluator, without any problem."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import (
    ONE,
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
    Template,
)
from ann_dc.network.network import Network


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def integrated(network: Network, end: float, x=None, **options):
    """SciPy on the network's right-hand side."""
    start = network.start_state if x is None else x
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12} | options
    return solve_ivp(lambda _, x: evaluator(network).rhs(x), (0, end), start, **options)


# ---- linear ------------------------------------------------------------------------------------


def test_a_chain_of_integrators_is_a_polynomial():
    """x_0' = 1, x_k' = x_{k-1}: x_k = s^(k+1) / (k+1)!."""
    chain = Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            inputs=("drive",),
            connections=(wire("x", "x", template=Template.PREVIOUS),),
        ),
        stages=5,
        inputs={"drive": 1.0},
        left_boundary={"x": "drive"},
    )
    s = 1.7
    factorials = np.cumprod(np.arange(1.0, 6.0))
    np.testing.assert_allclose(
        integrated(chain, s).y[:, -1], s ** np.arange(1, 6) / factorials, rtol=1e-10
    )


def rc_line(stages: int, tau: float = 1.0, leak: float = 0.1) -> Network:
    """Nodes that leak to ground and to their neighbours; both ends of the line are grounded."""
    return Network(
        cell=Cell(
            neurons=(Neuron(name="v", tau=tau),),
            inputs=("current",),
            connections=(
                wire("v", "v", -(2.0 + leak)),
                wire("v", "v", template=Template.PREVIOUS),
                wire("v", "v", template=Template.NEXT),
                wire("current", "v"),
            ),
        ),
        stages=stages,
        inputs={"current": 1.0},
    )


def rc_eigenvalues(stages: int, leak: float) -> np.ndarray:
    modes = np.arange(1, stages + 1)
    return -(leak + 4 * np.sin(modes * np.pi / (2 * (stages + 1))) ** 2)


@pytest.mark.parametrize("tau", [0.5, 3.0])
def test_a_leaky_line_has_the_eigenvalues_of_the_laplacian(tau):
    values = np.sort(spectrum(rc_line(8, tau), np.zeros(8)).eigenvalues.real)
    np.testing.assert_allclose(values, np.sort(rc_eigenvalues(8, 0.1)) / tau, rtol=1e-12)


@pytest.mark.parametrize("tau", [1.0, 5.0])
def test_a_leaky_line_settles_as_its_slowest_mode(tau):
    stages, leak = 6, 0.05
    line = rc_line(stages, tau, leak)
    run = OdeBackend(settling=Settling(tolerance=1e-8)).run(line)
    assert run.status.settled
    # e(s) = a sin(..) exp(lambda s / tau): only the slowest mode is left at 1e-8
    matrix = evaluator(line).jacobian(np.zeros(stages)) * tau
    end = np.linalg.solve(-matrix, np.ones(stages))
    np.testing.assert_allclose(run.trajectory.final, end, rtol=1e-6)
    values, modes = np.linalg.eigh(matrix)
    slowest = modes[:, -1] * (modes[:, -1] @ -end) * values[-1]
    scale = max(np.abs(end).max(), 1.0)
    expected = tau * np.log(np.abs(slowest).max() / (1e-8 * scale)) / -values[-1]
    np.testing.assert_allclose(run.settling_time, expected, rtol=1e-2)


def test_time_constants_by_stage():
    taus = np.array([0.5, 1.0, 4.0])
    decay = Network(
        cell=Cell(neurons=(Neuron(name="x", tau=taus),), connections=(wire("x", "x", -1.0),)),
        stages=3,
        start={"x": 2.0},
    )
    np.testing.assert_allclose(integrated(decay, 1.0).y[:, -1], 2 * np.exp(-1 / taus), rtol=1e-10)


# ---- nonlinear ---------------------------------------------------------------------------------


def lorenz(sigma=10.0, r=28.0, b=8 / 3) -> Network:
    return Network(
        cell=Cell(
            neurons=(Neuron(name="x"), Neuron(name="y"), Neuron(name="z")),
            blocks=(Product(name="xz", a="x", b="z"), Product(name="xy", a="x", b="y")),
            connections=(
                wire("y", "x", sigma), wire("x", "x", -sigma),
                wire("x", "y", r), wire("y", "y", -1.0), wire("xz", "y", -1.0),
                wire("xy", "z"), wire("z", "z", -b),
            ),
        ),
        stages=1,
        start={"x": 1.0, "y": 2.0, "z": 20.0},
    )  # fmt: skip


def test_lorenz():
    def textbook(_, state):
        x, y, z = state
        return [10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z]

    network = lorenz()
    options = {"rtol": 1e-12, "atol": 1e-12, "method": "DOP853"}
    expected = solve_ivp(textbook, (0, 3), [1.0, 2.0, 20.0], **options)
    np.testing.assert_allclose(integrated(network, 3).y[:, -1], expected.y[:, -1], rtol=1e-6)


def test_lorenz_never_settles():
    run = OdeBackend(limit=500.0).run(lorenz())
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert np.isnan(run.settling_time)


def test_lorenz_settles_below_its_first_bifurcation():
    run = OdeBackend().run(lorenz(r=10.0))
    end = np.sqrt(8 / 3 * 9)
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory.final, [end, end, 9.0], rtol=1e-5)


def double_pendulum(g: float = 9.81) -> Network:
    """Two unit masses on unit rods; d = a - b, all angles from the vertical.

    a'' = (-3g sin a - g sin(a-2b) - 2 sin d (v_b^2 + v_a^2 cos d)) / (3 - cos 2d)
    b'' = 2 sin d (2 v_a^2 + 2 g cos a + v_b^2 cos d) / (3 - cos 2d)
    """
    function = lambda name, kind, x: Function(name=name, function=kind, x=x)  # noqa: E731
    return Network(
        cell=Cell(
            neurons=tuple(Neuron(name=n) for n in ("a", "b", "v_a", "v_b")),
            blocks=(
                Sum(name="d"), Sum(name="two_d"), Sum(name="a_2b"),
                function("sin_a", "sin", "a"), function("cos_a", "cos", "a"),
                function("sin_d", "sin", "d"), function("cos_d", "cos", "d"),
                function("cos_2d", "cos", "two_d"), function("sin_a_2b", "sin", "a_2b"),
                Sum(name="inertia"), function("share", "reciprocal", "inertia"),
                Product(name="va2", a="v_a", b="v_a"), Product(name="vb2", a="v_b", b="v_b"),
                Product(name="va2_cos", a="va2", b="cos_d"),
                Product(name="vb2_cos", a="vb2", b="cos_d"),
                Sum(name="pull_a"), Sum(name="pull_b"),
                Product(name="turn_a", a="sin_d", b="pull_a"),
                Product(name="turn_b", a="sin_d", b="pull_b"),
                Sum(name="torque_a"),
                Product(name="acc_a", a="torque_a", b="share"),
                Product(name="acc_b", a="turn_b", b="share"),
            ),
            connections=(
                wire("v_a", "a"), wire("v_b", "b"),
                wire("a", "d"), wire("b", "d", -1.0),
                wire("a", "two_d", 2.0), wire("b", "two_d", -2.0),
                wire("a", "a_2b"), wire("b", "a_2b", -2.0),
                wire(ONE, "inertia", 3.0), wire("cos_2d", "inertia", -1.0),
                wire("vb2", "pull_a"), wire("va2_cos", "pull_a"),
                wire("va2", "pull_b", 2.0), wire("cos_a", "pull_b", 2 * g),
                wire("vb2_cos", "pull_b"),
                wire("sin_a", "torque_a", -3 * g), wire("sin_a_2b", "torque_a", -g),
                wire("turn_a", "torque_a", -2.0),
                wire("acc_a", "v_a"), wire("acc_b", "v_b", 2.0),
            ),
        ),
        stages=2,  # two pendulums side by side: the cells of a network need not talk
        start={"a": [1.5, 0.3], "b": [2.5, -0.2]},
        title="double pendulum",
    )  # fmt: skip


@pytest.mark.slow
def test_a_double_pendulum_keeps_its_energy():
    g, network = 9.81, double_pendulum()
    states = network.unpack(integrated(network, 5.0).y.T)
    a, b, v_a, v_b = np.moveaxis(states, 1, 0)
    kinetic = v_a**2 + v_b**2 / 2 + v_a * v_b * np.cos(a - b)
    energy = kinetic - g * (2 * np.cos(a) + np.cos(b))
    assert np.ptp(kinetic, axis=0).min() > 0.5
    np.testing.assert_allclose(energy, np.broadcast_to(energy[0], energy.shape), atol=1e-8)


def test_small_swings_of_a_double_pendulum():
    """omega^2 = g (2 +- sqrt 2), the textbook's two modes."""
    network = double_pendulum()
    values = spectrum(network, np.zeros(network.size)).eigenvalues
    expected = np.sqrt(9.81 * (2 + np.array([-1.0, 1.0]) * np.sqrt(2)))
    np.testing.assert_allclose(
        np.unique(np.abs(values.imag).round(8)), expected.round(8), rtol=1e-7
    )


# ---- limiters ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_rails_end_a_ramp():
    ramp = Network(
        cell=Cell(
            neurons=(Neuron(name="x", limiter=Limiter(low=-1.0, high=2.0)),),
            inputs=("slope",),
            connections=(wire("slope", "x"),),
        ),
        stages=2,
        inputs={"slope": [1.0, -1.0]},
    )
    swing = integrated(ramp, 10.0, max_step=0.01, rtol=1e-6)
    np.testing.assert_allclose(swing.y[:, -1], [2.0, -1.0], atol=0.02)
    halfway = np.searchsorted(swing.t, 0.5)
    np.testing.assert_allclose(swing.y[:, halfway], swing.t[halfway] * np.array([1, -1]), rtol=1e-9)


def test_a_one_sided_diode():
    """z' = g - leak: pushed below zero it stays there, and comes back as soon as g turns."""
    diode = Network(
        cell=Cell(
            neurons=(Neuron(name="z", limiter=Limiter(low=0.0)),),
            inputs=("g",),
            connections=(wire("g", "z"), wire("z", "z", -1.0)),
        ),
        stages=3,
        inputs={"g": [-2.0, 0.5, 3.0]},
    )
    run = OdeBackend(verify=False).run(diode)
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory["z"][-1], [0.0, 0.5, 3.0], atol=1e-6)
