"""Many initial guesses and targets in one batch, and derivatives of the settled point.

Question: The gains are designed for one target. For which others does the network settle, how fast,
          and how does the optimum move with the initial state?
Answer:   On a grid of 441 targets the network with multilevel gains settles everywhere, slower if
          turns are sharp; with a resistive grid 435 of 441 settle within 5000 simultaneous steps.
          The derivative of the settled point, by the implicit function theorem without unrolled
          steps, is the optimal feedback gain du_0/dq_0.
Figure:   out/demos/07_batch.png: settled paths; number of steps by target.
"""

from pathlib import Path

import numpy as np
import torch

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style

SIDE = 21


def grid(side: int) -> dict[str, np.ndarray]:
    """Return targets x, y between 3 and 7 m; other inputs remain those of the network."""
    x, y = np.meshgrid(np.linspace(3, 7, side), np.linspace(3, 7, side))
    return {"q_d.x": x.ravel(), "q_d.y": y.ravel()}


def feedback(network: ann_dc.Network) -> np.ndarray:
    """Compute du_0/dq_0 (m, n) at the settled point, in the units of the problem."""
    layer = ann_dc.RecurrentLayer(network)
    states = [name for name in network.cell.inputs if name.startswith("q_0.")]
    values = [float(network.inputs[name][0]) for name in states]
    q_0 = torch.tensor(values, dtype=torch.float64, requires_grad=True)
    settled = layer.equilibrium({name: q_0[i : i + 1] for i, name in enumerate(states)})[0]
    rows = []
    for neuron in network.cell.neurons:
        if neuron.population == "u":
            component = network.state_index[network.neuron_index[neuron.name], 0]
            (row,) = torch.autograd.grad(settled[component], q_0, retain_graph=True)
            rows.append(neuron.scale.factor * row.numpy())
    return np.array(rows)


def main(out: Path | None = None, side: int = SIDE) -> dict:
    """Run the grid of targets; return batch, feedback gain and figure path."""
    problem = ann_dc.plants.car()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL).network
    run = ann_dc.RecurrentBackend(limit=5_000).run_batch(network, grid(side))
    print(run)
    gain = feedback(network)
    print("optimal feedback gain du_0/dq_0 at the initial state of the paper:")
    for control, row in zip(problem.controls, gain):
        terms = "  ".join(f"{s}: {g:8.3f}" for s, g in zip(problem.states, row))
        print(f"  {control!s:4} {terms}")
    figures = []
    if out is not None:
        figure = picture(problem, network, run, side)
        figures.append(plotting.save(figure, Path(out) / "07_batch.png"))
    return {"run": run, "feedback": gain, "figures": figures}


def picture(problem, network, run, side: int):
    """Draw paths to some targets, and the number of steps for every target."""
    figure = plotting.new_figure(9.6, 4.4)
    left, right = figure.subplots(1, 2)
    values = network.unpack(run.states)
    x, y = (network.neuron_index[name] for name in ("t.x", "t.y"))
    targets = {name: run.inputs[f"q_d.{name}"][:, 0] for name in ("x", "y")}
    every = max(1, side // 5)
    rows, columns = np.divmod(np.arange(len(run)), side)
    for k in np.flatnonzero((rows % every == 0) & (columns % every == 0) & run.settled):
        ends = [targets["x"][k]], [targets["y"][k]]
        path_x, path_y = (
            [0.0, *network.cell.neurons[row].scale.user(values[k, row, :-1]), *end]
            for row, end in zip((x, y), ends)
        )
        left.plot(path_x, path_y, "-", color=style.BLUE, lw=0.8, alpha=0.7)
        left.plot(*ends, "o", color=style.ORANGE, ms=3)
    left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    left.set_title("settled paths to some targets", fontsize=9)
    steps = np.where(run.settled, run.settling_steps, np.nan).reshape(side, side)
    image = right.pcolormesh(
        targets["x"].reshape(side, side), targets["y"].reshape(side, side), steps, cmap="viridis"
    )
    right.plot(5, 5, "o", color=style.VERMILION, ms=6, label="design target")
    right.set(xlabel="target x (m)", ylabel="target y (m)", aspect="equal")
    right.set_title("recurrent steps to a relative KKT residual of 1e-6", fontsize=9)
    right.legend(frameon=True, fontsize=8)
    figure.colorbar(image, ax=right, label="number of steps")
    plotting.quiet(left)
    settled = int(run.settled.sum())
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}\n"
        f"One network with fixed gains, {len(run)} targets in one batch: {settled} settled",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
