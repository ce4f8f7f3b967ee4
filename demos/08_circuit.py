"""The network as a circuit of op amps in ngspice.

Question: Does the circuit settle at the optimum, how fast, and with which error from finite op-amp
          gain?
Answer:   With ideal parts its controls are those of the ODE to 4e-7. With op amps of 10 MHz it
          settles in 36 us. A finite gain A0 makes the multiplier integrators leak, and the relative
          error of the controls is 27 / A0. If op amps are less than 6.2 times as fast as the
          network, the circuit oscillates, as the eigenvalues of the pole model predict before
          ngspice runs.
Figure:   out/demos/08_circuit.png: voltages; control error over gain; settling over bandwidth.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.backends.spice import CircuitRun
from ann_dc.fidelity import predict, smallest_margin
from ann_dc.hardware.parts import BEHAVIOURAL, macro
from ann_dc.plotting import style

GAINS = (1e3, 1e4, 1e5, 1e6)
MARGINS = (7.5, 8.5, 10.0, 15.0, 20.0)


@dataclass(frozen=True)
class Point:
    """Control error and settling time to 0.1 % (s) in ngspice; predicted time (s)."""

    error: float
    settling: float
    predicted: float


def network_of(problem) -> ann_dc.Network:
    """Return the network with diagonal preconditioner: neighbour connections only."""
    return ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network


def point(backend: ann_dc.SpiceBackend, run: CircuitRun) -> Point:
    """Return the control error and the settling times of a run."""
    settling = run.settling_time() if run.settled() else float("nan")
    predicted = predict(run.circuit, backend.level, run.probe).settling_time
    return Point(run.control_error, settling, predicted)


def against_margin(network, margins) -> dict[float, Point]:
    """Simulate op amps of several bandwidth margins, relative to the fastest rate."""
    points = {}
    for bandwidth_margin in margins:
        backend = ann_dc.SpiceBackend(level=macro(a0=1e5), bandwidth_margin=bandwidth_margin)
        points[bandwidth_margin] = point(backend, backend.run(network))
    return points


def threshold(network) -> float:
    """Return the bandwidth margin below which the pole model oscillates."""
    level = macro(a0=1e5)
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    return smallest_margin(circuit, level, probe)


def main(out: Path | None = None, gains=GAINS, margins=MARGINS) -> dict:
    """Simulate every circuit; return errors, settling times and the figure path."""
    network = network_of(ann_dc.plants.car())
    ideal = ann_dc.SpiceBackend(level=BEHAVIOURAL).run(network)
    print(f"ideal parts    control error {ideal.control_error:.1e}, normalised mean square error "
          f"of the trajectory {ideal.mean_square_error:.1e}")  # fmt: skip
    runs = {a0: ann_dc.SpiceBackend(level=macro(a0=a0)).run(network) for a0 in gains}
    for a0, run in runs.items():
        error = run.control_error
        print(f"A0 = {a0:7.0e}   control error {error:.2e} = {error * a0:.0f} / A0, "
              f"settled to 0.1 % after {run.settling_time() * 1e6:.1f} us")  # fmt: skip
    lowest, slower = threshold(network), against_margin(network, margins)
    print(f"bandwidth margin below {lowest:.2f}: the circuit oscillates")
    for bandwidth_margin, found in slower.items():
        print(f"bandwidth margin {bandwidth_margin:4.1f}: settled after {found.settling * 1e6:.1f} "
              f"us, predicted {found.predicted * 1e6:.1f} us")  # fmt: skip
    figures = []
    if out is not None:
        figure = picture(ideal, runs, slower, lowest)
        figures.append(plotting.save(figure, Path(out) / "08_circuit.png"))
    return {
        "ideal": ideal,
        "gain": {a0: run.control_error for a0, run in runs.items()},
        "margin": slower,
        "threshold": lowest,
        "figures": figures,
    }


def picture(
    ideal: CircuitRun, runs: dict[float, CircuitRun], slower: dict[float, Point], lowest: float
):
    """Draw voltages, the control error over gain and the settling time over bandwidth."""
    figure = plotting.new_figure(11.0, 4.0)
    voltages, errors, speed = figure.subplots(1, 3, width_ratios=(4, 3, 3))
    network, run = ideal.trajectory.network, runs[max(runs)]
    seconds = 1e6 * run.trajectory.time * run.scaling.time
    for name, colour in (("u.nu", style.VERMILION), ("q.y", style.BLUE)):
        rows = run.trajectory[name] / network.neuron(name).scale.factor
        live = [k for k in range(network.stages) if (name, k) in run.deck.signals]
        lines = voltages.plot(seconds, run.scaling.volts(name, rows[:, live]), color=colour, lw=1)
        lines[0].set_label(f"{name}, all cells")
    voltages.axvline(
        1e6 * run.settling_time(), color=style.INK, lw=1, ls="--", label="within 0.1 %"
    )
    voltages.set_xlim(0, 2e6 * run.settling_time())
    voltages.set(xlabel="time (µs)", ylabel="voltage (V)", title="op amps of 10 MHz, A0 = 1e6")
    gains = np.array(list(runs))
    error = np.array([run.control_error for run in runs.values()])
    errors.loglog(gains, error, "o", color=style.BLUE, label="ngspice")
    errors.loglog(gains, error[-1] * gains[-1] / gains, "--", color=style.INK, lw=1,
                  label=f"{error[-1] * gains[-1]:.0f} / A0")  # fmt: skip
    errors.axhline(1e-4, color=style.GREY, lw=1, ls=":")
    errors.set(xlabel="open-loop gain A0 (V/V)",
               ylabel="control error\n(relative to the largest control)",
               title="effect of finite gain")  # fmt: skip
    speed.plot(list(slower), [1e6 * p.predicted for p in slower.values()], "o", mfc="none",
               mec=style.INK, ms=9, label="predicted")  # fmt: skip
    speed.plot(list(slower), [1e6 * p.settling for p in slower.values()], "o",
               color=style.BLUE, ms=4, label="ngspice")  # fmt: skip
    speed.axvspan(0, lowest, color=style.VERMILION, alpha=0.15, lw=0, label="oscillates")
    speed.set(xlabel="bandwidth margin\n(relative to the fastest rate)",
              ylabel="settling time to 0.1 % (µs)", title="effect of op-amp bandwidth",
              xlim=(0, None), ylim=(0, None))  # fmt: skip
    for axes in (voltages, errors, speed):
        axes.title.set_fontsize(9)
        axes.legend(frameon=axes is voltages, fontsize=8)
        plotting.quiet(axes)
    figure.suptitle(
        "Circuit of the paper's car: 215 op amps and 90 multipliers in ngspice, N = 9, dt = 0.1 s",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
