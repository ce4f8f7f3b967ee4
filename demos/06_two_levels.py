"""The paper's two-level algorithm over its outer iterations.

Question: The paper states that lambda settles after the third iteration. Which iteration converges
          as fast?
Answer:   Not the two-level iteration. On the plain Lagrangian the oracle gain lambda = |B/A| finds
          no solution, because the hypothesis of Theorem IV.2 fails. With augmentation the oracle
          has not settled after 2000 outer iterations, two fixed gains take 308, and a Newton
          coordinator takes 6 from the straight line and 2 to 4 after the robot has moved. The
          Newton coordinator settles a linear network whose weights are the stage Jacobians each
          time; the 104 coarse coordinators of the multilevel network have fixed weights and need no
          outer loop. With (28)-(30) as printed, lambda is constant near 1 after five iterations
          while Theta grows ninefold in each. Theorem IV.1 holds, with a rate; A and B as printed in
          (21) do not determine Theta.
Figure:   out/demos/06_two_levels.png; 06_figure_6.png, 06_equation_21.png, 06_theorem_IV_1.png
"""

from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.evaluation import evaluator
from ann_dc.paper import iterations
from ann_dc.plotting import style
from ann_dc.plotting.paper import figure_6, figure_of_definitions, figure_of_following
from ann_dc.two_level import Gradient, NewtonCoordinator, OracleCoordinator, OracleGain, TwoLevelRun

DIVERGED = 1e6
"""Residual above which a run is not drawn."""
COLOURS = {
    "plain, oracle |B/A|/2": style.GREY,
    "augmented, oracle |B/A|/2": style.ORANGE,
    "augmented, two gains": style.BLUE,
    "Newton coordinator": style.VERMILION,
}


def runs_of(problem) -> tuple[dict[str, TwoLevelRun], dict]:
    """Run every coordinator from one initial guess; return runs and predictions."""
    equations = ann_dc.decompose(problem, ann_dc.switch("S14"))  # q_0 as a neuron: equal cells
    design = ann_dc.design(
        ann_dc.synthesize(equations), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    )
    network, settled = design.network, design.state
    plain = ann_dc.synthesize(equations, rho=0.0)
    gains = ann_dc.UpperMap(network=network, settled=settled).best()
    two_gains = Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)
    oracle = OracleCoordinator(gain=OracleGain(settled=settled, share=0.5))
    layers = {
        "plain, oracle |B/A|/2": (plain, oracle, 300),
        "augmented, oracle |B/A|/2": (network, oracle, 2_000),
        "augmented, two gains": (network, two_gains, 2_000),
        "Newton coordinator": (network, NewtonCoordinator(), 50),
    }
    runs = {
        name: ann_dc.TwoLevels(of, upper=upper).run(settled=settled, limit=limit)
        for name, (of, upper, limit) in layers.items()
    }
    newton = ann_dc.TwoLevels(network, upper=NewtonCoordinator())
    line = np.subtract(problem.q_d, problem.q_0)
    warm = {}
    for fraction in (0.01, 0.05, 0.2):
        moved = {f"q_0.{s}": a + fraction * d for s, a, d in zip(problem.states, problem.q_0, line)}
        warm[fraction] = int(newton.run(settled, moved).outer_iterations[0])
    whole = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL).network
    known = {
        "predicted": gains.predicted(),
        "hypothesis": ann_dc.theorem_IV_2(network, settled),
        "warm": warm,
        "jacobian_entries": len(evaluator(network).tape.entries),
        "coarse_neurons": whole.preconditioner.wires(whole.layout).nodes,
    }
    return runs, known


def main(out: Path | None = None) -> dict:
    """Run every coordinator; return outer iterations, runs and figure paths."""
    runs, known = runs_of(ann_dc.plants.car())
    print(known["hypothesis"])
    for name, run in runs.items():
        count = int(run.outer_iterations[0])
        outcome = f"{count} outer iterations" if count >= 0 else "not settled"
        if name == "augmented, two gains":
            outcome += f" (linearised prediction {known['predicted']:.0f})"
        print(f"{name:28} {outcome}")
    for fraction, count in known["warm"].items():
        print(f"Newton, q_0 moved by {fraction:4.0%} of q_d - q_0: {count} outer iterations")
    print(
        f"hardware: {known['jacobian_entries']} state-dependent weights (Newton coordinator); "
        f"{known['coarse_neurons']} coarse neurons with fixed weights (multilevel)"
    )
    figures = []
    if out is not None:
        figures.append(plotting.save(picture(runs), Path(out) / "06_two_levels.png"))
        figures += figures_of_the_paper(Path(out))
    iterations = {name: int(run.outer_iterations[0]) for name, run in runs.items()}
    return {"iterations": iterations, "runs": runs, "figures": figures, **known}


def figures_of_the_paper(out: Path) -> list[Path]:
    """Draw Figure 6 (both cases and as printed), equation (21) and Theorem IV.1."""
    found = iterations()
    print(found.following)
    drawn = {
        "06_figure_6": figure_6(found),
        "06_equation_21": figure_of_definitions(found),
        "06_theorem_IV_1": figure_of_following(found),
    }
    return [plotting.save(figure, out / f"{name}.png") for name, figure in drawn.items()]


def shown(run: TwoLevelRun) -> slice:
    """Return the outer iterations to draw; a diverged run ends at `DIVERGED`."""
    diverged = ~(run.residuals[:, 0] < DIVERGED)
    return slice(int(diverged.argmax()) if diverged.any() else None)


def picture(runs: dict[str, TwoLevelRun]):
    """Draw lambda, A, B, Theta and the residual over the outer iterations."""
    figure = plotting.new_figure(9.6, 6.4)
    panels = figure.subplots(2, 3, sharex=True).ravel()
    panels[5].axis("off")
    for name, colour in COLOURS.items():
        run = runs[name]
        near = shown(run)
        found, j = run.lyapunov, np.arange(1, len(run.residuals) + 1)[near]
        look = {"color": colour, "lw": 1.6, "marker": "." if len(j) < 20 else None}
        panels[0].loglog(j[:-1], run.gains[near][: len(j) - 1, 0, 0], **look)
        panels[1].loglog(j, found.A[near, 0], **look)
        B = found.B[near, 0]
        falls, rises = B < 0, B >= 0
        panels[2].loglog(j[falls], -B[falls], **{**look, "ls": "none", "marker": "."})
        panels[2].loglog(j[rises], B[rises], "+", color=colour, ms=5)
        panels[3].loglog(j, found.theta[near, 0], **look)
        panels[4].loglog(j, run.residuals[near, 0], **look)
        panels[5].plot([], [], color=colour, lw=2, label=name)
    panels[2].plot([], [], ".", color=style.INK, label="B < 0: some λ lowers Θ")
    panels[2].plot([], [], "+", color=style.INK, label="B ≥ 0: none")
    panels[2].set_ylim(bottom=1e-28)  # margin below the last point of Newton
    panels[2].legend(frameon=False, fontsize=7, loc="lower left")
    panels[4].axhline(1e-6, color=style.GREY, lw=1, ls=":")
    for axes, label in zip(
        panels,
        ("gain λ of t (network units)", "A = ½ Σ |d|², (21) (network units)",
         "|B|, B = Σ eᵀd, (21) (network units)", "Θ = ½ Σ |e|², (19) (network units)",
         "relative KKT residual"),
    ):  # fmt: skip
        axes.set_ylabel(label, fontsize=9)
        axes.axvline(3, color=style.GREY, lw=0.8, ls="--")
        plotting.quiet(axes)
    for axes in panels[2:5]:
        axes.set_xlabel("outer iteration j")
        axes.tick_params(labelbottom=True)
    panels[0].text(3.2, panels[0].get_ylim()[0] * 2, "third iteration", fontsize=8, color=style.INK)
    panels[5].legend(loc="center left", frameon=False, fontsize=9, title="coordinator")
    figure.suptitle(
        "Two-level algorithm of the paper with the paper's example, N = 9, dt = 0.1 s",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
