"""Free final time and infeasible targets.

Question: Can the network choose the time as well, and how does it report that no solution exists?
Answer:   A step length that is a decision is one more state, carried from stage to stage. The boat
          crosses the sooner, the higher the price of a second, and every result is certified. If
          the boat is too weak to moor upstream, `solve` reports the target as infeasible within a
          second, with the nearest reachable place.
Figure:   out/demos/13_how_long_and_whether_at_all.png, crossing time over the price of a second,
          and the paths: two that are certified and one that cannot be.
"""

from pathlib import Path

import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.optimality import feasible_path, out_of_reach
from ann_dc.plotting import style
from ann_dc.problem import StepLength, straight_line

WIDTH, CURRENT, STRONGEST = 4.0, 1.2, 1.0  # metres; metres a second in the middle, of the engine
PRICES = (0.1, 0.3, 1.0, 3.0)  # of a second, where an effort of one costs 1/2


def boat(price: float) -> ann_dc.OptimalControlProblem:
    """Across a brook, in a time that is chosen: every second costs as much as the effort in it."""
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
    """3.6 s in a canal that flows at 1.2 m/s, with 1 m/s at most: upstream is out of reach."""
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
        q_d=(-3, WIDTH, None),
        units={"x": "m", "y": "m", "theta": "rad", "rudder": "rad/s"},
    )


def main(out: Path | None = None, prices: tuple[float, ...] = PRICES) -> dict:
    """Solve both; return total times, verdicts and the paths of the pictures."""
    solutions = {price: ann_dc.solve(boat(price)) for price in prices}
    for price, solution in solutions.items():
        print(f"a second costs {price:g}: {solution.total_time:.2f} s, {solution.verdict}")
    refused = ann_dc.solve(weak_boat())
    print(refused.status)
    pictures = []
    if out is not None:
        name = Path(out) / "13_how_long_and_whether_at_all.png"
        pictures.append(plotting.save(picture(solutions, refused), name))
    return {
        "times": {price: solution.total_time for price, solution in solutions.items()},
        "certified": all(solution.certified for solution in solutions.values()),
        "refused": refused.as_dict(),
        "figures": pictures,
    }


def picture(solutions: dict, refused: ann_dc.Solution):
    """Total time over its price, and the brook from above."""
    figure = plotting.new_figure(9.6, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    times = [solution.total_time for solution in solutions.values()]
    left.semilogx(list(solutions), times, "o-", color=style.BLUE)
    left.set(xlabel="price of a second", ylabel="crossing time N h (s)", ylim=(0, None))
    right.axhspan(0, WIDTH, color="#EAF3F9", zorder=0)
    paths = [(min(solutions), style.SKY), (max(solutions), style.BLUE)]
    for price, color in paths:
        solution = solutions[price]
        label = f"{solution.total_time:.1f} s, a second costs {price:g}"
        right.plot(solution["x"], solution["y"], "o-", ms=3, color=color, label=label)
    problem = refused.problem
    line = straight_line(problem)
    found = out_of_reach(problem, feasible_path(problem, line.q, line.u))
    rollout = problem.functions.rollout(problem.q_0, found.path.u)
    right.plot(*rollout[:2], "--", color=style.ORANGE, label="weak boat, as near as it comes")
    right.plot(*problem.q_d[:2], "x", color=style.INK, ms=8, label="its target: out of reach")
    right.set(xlabel="downstream x (m)", ylabel="across y (m)", ylim=(-0.3, WIDTH + 0.3))
    right.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1.0), frameon=False, ncols=2)
    for axes in (left, right):
        plotting.quiet(axes)
    plotting.headline(figure, "A boat that chooses its time, and one that cannot do it (N = 24)")
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
