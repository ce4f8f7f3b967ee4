"""Waveforms, inputs over time and convergence of runs.

Question: Are waveforms right, not only settled values: an oscillator, chaos, a run on its way?
Answer:   Van der Pol's oscillator has its period and amplitude in ngspice to 0.002 %, with op amps
          of 10 MHz at a bandwidth margin of 100,000; a margin ten times smaller costs ten to twenty
          times the accuracy. Chua's double scroll follows SciPy's trajectory to 0.02 % for two
          Lyapunov times; after that no two runs of a chaotic network agree. All integration methods
          see the car's network settle at the same time, in 36 to 280 steps; two levels need 6 outer
          iterations.
Figure:   out/demos/28_waveforms_and_convergence.png; 28_convergence_*.png and .pdf
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.hardware.parts import macro
from ann_dc.network import Cell, Connection, Network, Neuron, Product
from ann_dc.optimality import solver_iterates
from ann_dc.plotting import style
from ann_dc.two_level import NewtonCoordinator

DURATIONS = {"van der Pol": 40.0, "Chua": 60.0}
"""Network time of the oscillators in unit time constants."""
MARGINS = (1e3, 1e4, 1e5)
"""Bandwidth margins, relative to the fastest rate of the network."""


def oscillator(title: str, neurons: str, blocks, weights, start) -> Network:
    """Build a network of one cell from neurons, products and weights (target, source)."""
    wires = (Connection(source=s, target=t, weight=w) for (t, s), w in weights.items())
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in neurons),
        blocks=tuple(Product(name=a + b, a=a, b=b) for a, b in blocks),
        connections=tuple(wires),
    )
    return Network(cell=cell, stages=1, start=dict(zip(neurons, start)), title=title)


def van_der_pol(mu: float = 1.5) -> Network:
    """Return the oscillator x' = y, y' = mu (1 - x^2) y - x."""
    weights = {("x", "y"): 1, ("y", "x"): -1, ("y", "y"): mu, ("y", "xxy"): -mu}
    return oscillator("van der Pol", "xy", (("x", "x"), ("xx", "y")), weights, (0.1, 0.0))


def chua() -> Network:
    """Return Chua's circuit x' = 10 (y + x/6 - x^3/16), y' = x - y + z, z' = -16 y."""
    weights = {
        ("x", "y"): 10, ("x", "x"): 10 / 6, ("x", "xxx"): -10 / 16,
        ("y", "x"): 1, ("y", "y"): -1, ("y", "z"): 1, ("z", "y"): -16,
    }  # fmt: skip
    return oscillator("Chua", "xyz", (("x", "x"), ("xx", "x")), weights, (0.5, 0.1, 0.0))


def waveforms(durations: Mapping[str, float]) -> dict[str, tuple[Any, Any]]:
    """Run both oscillators as ODE and as circuit."""
    found = {}
    for network in (van_der_pol(), chua()):
        duration = durations[network.title]
        circuit = ann_dc.SpiceBackend(level=macro(), duration=duration)
        found[network.title] = (
            ann_dc.OdeBackend(duration=duration).run(network), circuit.run(network)
        )  # fmt: skip
    return found


def accuracy(margins, duration: float) -> dict[float, float]:
    """Return the relative rms error of van der Pol's waveform by bandwidth margin."""
    errors = {}
    for margin in margins:
        backend = ann_dc.SpiceBackend(level=macro(), duration=duration, bandwidth_margin=margin)
        run = backend.run(van_der_pol())
        errors[margin] = float(np.sqrt(run.mean_square_error))
    return errors


def converging(problem) -> tuple[dict[str, Any], dict[str, Any], ann_dc.Solution]:
    """Return runs over network time, runs over steps, and the optimum of the car."""
    solution = ann_dc.solve(problem)
    network = solution.network
    methods = ("compiled", "RK45", "LSODA", "Radau", "BDF")
    runs: dict[str, Any] = {
        name: ann_dc.OdeBackend(method=ann_dc.ode.METHODS[name], verify=False).run(network)
        for name in methods
    }
    runs["two-phase steps"] = ann_dc.RecurrentBackend(order=ann_dc.TWO_PHASE).run(network)
    built = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    timed = runs | {
        "diagonal": ann_dc.OdeBackend(verify=False).run(built),
        "circuit, ideal": ann_dc.SpiceBackend().run(built),
        "circuit, macro": ann_dc.SpiceBackend(level=macro()).run(built),
    }
    levels = ann_dc.TwoLevels(network, upper=NewtonCoordinator()).run()
    return timed, runs | {"two levels": levels, "IPOPT": solver_iterates(problem)}, solution


def main(out=Path("out/demos"), problem=None, durations=None, margins=MARGINS) -> dict[str, Any]:
    """Run both oscillators and the car, and draw waveforms and convergence."""
    found = waveforms(durations or DURATIONS)
    errors = accuracy(margins, 20.0)
    timed, counted, solution = converging(problem or ann_dc.plants.car())
    for margin, error in errors.items():
        print(f"bandwidth margin {margin:g}: relative rms error of the waveform {error:.1e}")
    for name, (_, circuit) in found.items():
        print(f"{name}: {circuit}")
    times = {name: run.settling_time for name, run in timed.items() if hasattr(run, "status")}
    listed = ", ".join(f"{name} {time:.4g}" for name, time in times.items())
    print("settling times (unit time constants):", listed)

    figure = style.new_figure(11.0, 4.2)
    left, right = figure.subplots(1, 2)
    _over_time(left, *found["van der Pol"])
    _scrolls(right, *found["Chua"])
    files = [plotting.save(figure, out / "28_waveforms_and_convergence.png")]
    pictures = {
        "time": plotting.convergence(timed, optimum=solution),
        "steps": plotting.convergence(counted, against="steps"),
        "controls": plotting.convergence(timed, error="controls", optimum=solution),
    }
    for name, picture in pictures.items():
        for suffix in ("png", "pdf"):
            files.append(plotting.save(picture, out / f"28_convergence_{name}.{suffix}"))
    return {"runs": found, "errors": errors, "times": times, "counted": counted, "figures": files}


def _over_time(axes, run, circuit) -> None:
    """Draw both waveforms over network time."""
    axes.plot(circuit.trajectory.time, circuit.trajectory["x"][:, 0], color=style.ORANGE, lw=3.0,
              label="ngspice, op amps of 10 MHz")  # fmt: skip
    time = np.linspace(0, run.trajectory.time[-1], 2000)
    states = run.trajectory.at(time)[:, 0]
    axes.plot(time, states, "--", color=style.INK, lw=1.0, label="ODE")
    axes.set(title="van der Pol", xlabel=style.UNSCALED, ylabel="x", ylim=(-2.5, 3.4))
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=2)
    style.quiet(axes)


def _scrolls(axes, run, circuit) -> None:
    """Draw the double scroll in the plane of x and z."""
    axes.plot(
        circuit.trajectory["x"][:, 0], circuit.trajectory["z"][:, 0], color=style.BLUE, lw=0.6
    )
    axes.set(title="Chua, ngspice", xlabel="x", ylabel="z")
    style.quiet(axes)


if __name__ == "__main__":
    main()
