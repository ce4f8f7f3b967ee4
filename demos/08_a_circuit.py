"""The network as a circuit: op amps, multipliers, resistors and capacitors in ngspice.

Question: the paper says that its method suits an analog neural network. Does the circuit find the
          optimum, how fast, and what does the gain of its op amps cost?
Answer:   with ideal parts it is the ODE, to 1e-7. With op amps of 10 MHz it settles in 28 us; a
          finite gain A0 makes the dual integrators leak, and the error of the controls is 26 / A0.
          Op amps less than some seven times as fast as the network make it oscillate.
Figure:   out/demos/08_a_circuit.png
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.backends.spice.backend import CircuitRun, SpiceBackend
from ann_dc.backends.spice.levels import BEHAVIOURAL, macro
from ann_dc.backends.spice.runner import Ngspice
from ann_dc.errors import SpiceError
from ann_dc.network.gains import WITHOUT_COORDINATORS

GAINS = (1e3, 1e4, 1e5, 1e6)
PATIENCE = Ngspice(timeout=15.0)  # a stable circuit of this size takes one second
MARGINS = (4.0, 6.0, 8.0, 10.0, 15.0, 20.0)


@dataclass(frozen=True)
class Point:
    """What a circuit did: error of its controls, and when it was within 0.1 % (s)."""

    error: float
    settling: float


def network_of(problem) -> ann_dc.Network:
    """The network that is built: neighbours only, without coarse coordinators."""
    return ann_dc.design(problem, recipe=WITHOUT_COORDINATORS).network


def point(run: CircuitRun) -> Point:
    """The two figures of a run."""
    settled = run.settled() and run.control_error < 0.5
    return Point(run.control_error, run.settling_time() if settled else float("nan"))


def against_margin(network, margins) -> dict[float, Point]:
    """Faster and slower op amps, relative to the network's fastest mode."""
    points = {}
    for margin in margins:
        try:
            backend = SpiceBackend(level=macro(a0=1e5), margin=margin, simulator=PATIENCE)
            points[margin] = point(backend.run(network))
        except SpiceError:  # it rings, which takes ngspice for ever
            points[margin] = Point(float("nan"), float("nan"))
    return points


def main(out: Path | None = None, gains=GAINS, margins=MARGINS) -> dict:
    """Simulate every circuit; return errors and settling times, and the path of the picture."""
    network = network_of(ann_dc.plants.car())
    ideal = SpiceBackend(level=BEHAVIOURAL).run(network)
    print(f"ideal parts    error {ideal.control_error:.1e}, normalised mean square error of the "
          f"whole trajectory {ideal.mean_square_error:.1e}")  # fmt: skip
    runs = {a0: SpiceBackend(level=macro(a0=a0)).run(network) for a0 in gains}
    for a0, run in runs.items():
        error = run.control_error
        print(f"A0 = {a0:7.0e}   error {error:.2e} = {error * a0:.0f} / A0, "
              f"within 0.1 % after {run.settling_time() * 1e6:.1f} us")  # fmt: skip
    slower = against_margin(network, margins)
    for margin, found in slower.items():
        told = f"{found.settling * 1e6:.1f} us" if np.isfinite(found.settling) else "never settles"
        print(f"op amps {margin:4.0f} times as fast as the fastest mode: {told}")
    figures = []
    if out is not None:
        figure = picture(ideal, runs, slower)
        figures.append(plotting.save(figure, Path(out) / "08_a_circuit.png"))
    return {
        "ideal": ideal,
        "gain": {a0: point(run) for a0, run in runs.items()},
        "margin": slower,
        "figures": figures,
    }


def picture(ideal: CircuitRun, runs: dict[float, CircuitRun], slower: dict[float, Point]):
    """Voltages on the way, the error against the gain, settling against the speed."""
    figure = plotting.new_figure(11.0, 4.0)
    voltages, errors, speed = figure.subplots(1, 3, width_ratios=(4, 3, 3))
    network, run = ideal.trajectory.network, runs[max(runs)]
    seconds = 1e6 * run.trajectory.time * run.scaling.time
    for name, colour in (("u.nu", plotting.VERMILION), ("q.y", plotting.BLUE)):
        rows = run.trajectory[name] / network.neuron(name).unit
        live = [k for k in range(network.stages) if (name, k) in run.deck.signals]
        lines = voltages.plot(seconds, run.scaling.volts(name, rows[:, live]), color=colour, lw=1)
        lines[0].set_label(f"{name}, all cells")
    voltages.axvline(
        1e6 * run.settling_time(), color=plotting.INK, lw=1, ls="--", label="within 0.1 %"
    )
    voltages.set_xlim(0, 2e6 * run.settling_time())
    voltages.set(xlabel="time (µs)", ylabel="voltage (V)", title="op amps of 10 MHz, A0 = 1e6")
    gains = np.array(list(runs))
    error = np.array([run.control_error for run in runs.values()])
    errors.loglog(gains, error, "o", color=plotting.BLUE, label="ngspice")
    errors.loglog(gains, error[-1] * gains[-1] / gains, "--", color=plotting.INK, lw=1,
                  label=f"{error[-1] * gains[-1]:.0f} / A0")  # fmt: skip
    errors.axhline(1e-4, color=plotting.GREY, lw=1, ls=":")
    errors.set(xlabel="open-loop gain A0", ylabel="error of controls (of the largest)",
               title="what finite gain costs")  # fmt: skip
    settled = {m: p.settling for m, p in slower.items() if np.isfinite(p.settling)}
    lost = [m for m in slower if m not in settled]
    top = 1e6 * max(settled.values())
    speed.plot(list(settled), [1e6 * s for s in settled.values()], "o-", color=plotting.BLUE,
               ms=4, label="within 0.1 %")  # fmt: skip
    speed.plot(lost, [top] * len(lost), "x", color=plotting.VERMILION, label="never settles")
    speed.set(xlabel="op-amp bandwidth over fastest mode, k", ylabel="settling time (µs)",
              title="how fast the op amps must be", ylim=(0, 1.2 * top))  # fmt: skip
    for axes in (voltages, errors, speed):
        axes.title.set_fontsize(9)
        axes.legend(frameon=axes is voltages, fontsize=8)
        plotting.quiet(axes)
    figure.suptitle(
        "The paper's car as 215 op amps and 90 multipliers in ngspice, N = 9",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
