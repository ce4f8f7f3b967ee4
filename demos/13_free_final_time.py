"""Free final time and infeasible targets.

Question: Can the network choose the time as well, and how does it report that no solution exists?
Answer:   A step length that is a decision is one more state, carried from stage to stage. The boat
          crosses the sooner, the higher the price of a second, and every result is certified. If
          the boat is too weak to moor upstream, `solve` reports the target as infeasible within a
          second, with the nearest reachable place.
Figure:   out/demos/13_free_final_time.png: crossing time over the price of a second;
          paths of two certified results and of the infeasible problem.
"""

from pathlib import Path

import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.optimality import feasible_path, out_of_reach
from ann_dc.plotting import style
from ann_dc.problem import StepLength, straight_line

WIDTH, CURRENT, STRONGEST = 4.0, 1.2, 1.0  # width (m); current in the middle, engine (m/s)
PRICES = (0.1, 0.3, 1.0, 3.0)  # cost per second; an effort of 1 costs 1/2


def boat(price: float) -> ann_dc.OptimalControlProblem:
    """Return the crossing of a brook with free final time and given cost per second."""
    x, y, theta, thrust, rudder, h = sp.symbols("x y theta thrust rudder h")
    flow = CURRENT * 4 * y * (WIDTH - y) / WIDTH**2
    return ann_dc.OptimalControlProblem(
        name="boat",
        states=(x, y, theta),
        controls=(thrust, rudder),
        dynamics=(thrust * sp.cos(theta) + flow, thrust * sp.sin(theta), rudder),
        cost=h * (price + thrust**2 / 2 + rudder**2 / 2),
        dt=StepLength(low=0.02, high=1.0, guess=0.15),
        horizon=24,
        q_0=(0, 0, sp.pi / 2),
        q_d=(2, WIDTH, sp.pi / 2),
        units={"x": "m", "y": "m", "theta": "rad", "thrust": "m/s", "rudder": "rad/s"},
    )


def weak_boat() -> ann_dc.OptimalControlProblem:
    """Return an infeasible crossing: 3.6 s, current 1.2 m/s, speed at most 1 m/s."""
    x, y, theta, pedal, rudder = sp.symbols("x y theta pedal rudder")
    thrust = STRONGEST * sp.tanh(pedal)
    return ann_dc.OptimalControlProblem(
        name="weak boat",
        states=(x, y, theta),
        controls=(pedal, rudder),
        dynamics=(thrust * sp.cos(theta) + CURRENT, thrust * sp.sin(theta), rudder),
        cost=pedal**2 / 2 + rudder**2 / 2,
        dt=0.15,
        horizon=24,
        q_0=(0, 0, sp.pi / 2),
        q_d=(-3, WIDTH, None),  # upstream
        units={"x": "m", "y": "m", "theta": "rad", "rudder": "rad/s"},
    )


def main(out: Path | None = None, prices: tuple[float, ...] = PRICES) -> dict:
    """Solve both problems; return final times, results and the paths of the figures."""
    solutions = {price: ann_dc.solve(boat(price)) for price in prices}
    for price, solution in solutions.items():
        print(
            f"price of a second {price:g}: crossing time {solution.total_time:.2f} s, "
            f"{solution.verdict}"
        )
    refused = ann_dc.solve(weak_boat())
    print(refused.status)
    pictures = []
    if out is not None:
        name = Path(out) / "13_free_final_time.png"
        pictures.append(plotting.save(picture(solutions, refused), name))
    return {
        "times": {price: solution.total_time for price, solution in solutions.items()},
        "certified": all(solution.certified for solution in solutions.values()),
        "refused": refused.as_dict(),
        "figures": pictures,
    }


def picture(solutions: dict, refused: ann_dc.Solution):
    """Draw the crossing time over the price of a second, and the brook in plan view."""
    figure = plotting.new_figure(9.6, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    times = [solution.total_time for solution in solutions.values()]
    left.semilogx(list(solutions), times, "o-", color=style.BLUE)
    left.set(
        xlabel="price of a second (cost per s)", ylabel="crossing time N h (s)", ylim=(0, None)
    )
    right.axhspan(0, WIDTH, color="#EAF3F9", zorder=0)
    paths = [(min(solutions), style.SKY), (max(solutions), style.BLUE)]
    for price, color in paths:
        solution = solutions[price]
        label = f"{solution.total_time:.1f} s, price of a second {price:g}"
        right.plot(solution["x"], solution["y"], "o-", ms=3, color=color, label=label)
    problem = refused.problem
    line = straight_line(problem)
    found = out_of_reach(problem, feasible_path(problem, line.q, line.u))
    rollout = problem.functions.rollout(problem.q_0, found.path.u)
    right.plot(*rollout[:2], "--", color=style.ORANGE, label="weak boat, nearest reachable path")
    right.plot(*problem.q_d[:2], "x", color=style.INK, ms=8, label="target (infeasible)")
    right.set(xlabel="downstream x (m)", ylabel="across y (m)", ylim=(-0.3, WIDTH + 0.3))
    right.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1.0), frameon=False, ncols=2)
    for axes in (left, right):
        plotting.quiet(axes)
    plotting.headline(
        figure, "A boat with free final time, and one with an infeasible target (N = 24)"
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
