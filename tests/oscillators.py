"""Networks wired by hand that never settle, with their equations for SciPy."""

import numpy as np
from scipy.integrate import solve_ivp

from ann_dc.network import ONE, Cell, Connection, Network, Neuron, Product, Sum


def wire(source, target, weight=1.0):
    return Connection(source=source, target=target, weight=weight)


def wired(title, names, blocks, wires, start):
    neurons = tuple(Neuron(name=name) for name in names)
    cell = Cell(neurons=neurons, blocks=tuple(blocks), connections=tuple(wires))
    return Network(cell=cell, stages=1, start=dict(zip(names, start)), title=title)


def van_der_pol(mu=1.5, start=(0.1, 0.0)):
    """x' = y, y' = mu (1 - x^2) y - x."""
    blocks = Product(name="xx", a="x", b="x"), Product(name="xxy", a="xx", b="y")
    wires = wire("y", "x"), wire("x", "y", -1.0), wire("y", "y", mu), wire("xxy", "y", -mu)
    return wired("van der Pol", "xy", blocks, wires, start)


def chua(start=(0.5, 0.1, 0.0)):
    """Chua's circuit with a cubic: x' = 10 (y + x / 6 - x^3 / 16), y' = x - y + z, z' = -16 y."""
    blocks = Product(name="xx", a="x", b="x"), Product(name="xxx", a="xx", b="x")
    wires = (
        wire("y", "x", 10.0), wire("x", "x", 10 / 6), wire("xxx", "x", -10 / 16),
        wire("x", "y"), wire("y", "y", -1.0), wire("z", "y"), wire("y", "z", -16.0),
    )  # fmt: skip
    return wired("Chua", "xyz", blocks, wires, start)


def lorenz(start=(1.0, 1.0, 1.0)):
    """x' = 10 (y - x), y' = x (28 - z) - y, z' = x y - 8 z / 3."""
    blocks = Product(name="xz", a="x", b="z"), Product(name="xy", a="x", b="y")
    wires = (
        wire("y", "x", 10.0), wire("x", "x", -10.0), wire("x", "y", 28.0), wire("y", "y", -1.0),
        wire("xz", "y", -1.0), wire("xy", "z"), wire("z", "z", -8 / 3),
    )  # fmt: skip
    return wired("Lorenz", "xyz", blocks, wires, start)


def lorenz_96(count=5, force=8.0):
    """x_i' = (x_{i+1} - x_{i-2}) x_{i-1} - x_i + F on a ring."""
    names, blocks, wires = [f"x{i}" for i in range(count)], [], []
    for i, name in enumerate(names):
        last, ahead, behind = (names[(i + k) % count] for k in (-1, 1, -2))
        blocks += [Sum(name=f"d{i}"), Product(name=f"p{i}", a=last, b=f"d{i}")]
        wires += [wire(ahead, f"d{i}"), wire(behind, f"d{i}", -1.0), wire(f"p{i}", name)]
        wires += [wire(name, name, -1.0), wire(ONE, name, force)]
    return wired("Lorenz-96", names, blocks, wires, force + 0.1 * np.arange(count))


EQUATIONS = {
    "van der Pol": lambda t, x: [x[1], 1.5 * (1 - x[0] ** 2) * x[1] - x[0]],
    "Chua": lambda t, x: [
        10 * (x[1] + x[0] / 6 - x[0] ** 3 / 16), x[0] - x[1] + x[2], -16 * x[1]
    ],
    "Lorenz": lambda t, x: [
        10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]
    ],
    "Lorenz-96": lambda t, x: (np.roll(x, -1) - np.roll(x, 2)) * np.roll(x, 1) - x + 8.0,
}  # fmt: skip


def reference(network, duration, start=None):
    """States over time by SciPy at rtol 1e-11, as a function of times."""
    start = network.start_state if start is None else start
    tolerances = {"rtol": 1e-11, "atol": 1e-13}
    found = solve_ivp(
        EQUATIONS[network.title], (0, duration), start, "DOP853", dense_output=True, **tolerances
    )
    return found.sol


def cycle(time, x, after):
    """Mean period and amplitude of a limit cycle, of values after a time."""
    time, x = time[time > after], x[time > after]
    rise = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    zeros = time[rise] - x[rise] * (time[rise + 1] - time[rise]) / (x[rise + 1] - x[rise])
    return np.diff(zeros).mean(), np.abs(x).max()
