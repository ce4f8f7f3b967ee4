"""The paper's example: a car from (0, 0) to (5, 5) in nine stages.

Question: Does the network settle at the optimum of problem (22)-(24) after the equations are
          corrected?
Answer:   Yes. It settles at E = 398.6315 for D = 1 m and at 368.1893 for D = 0.5 m, the optima that
          IPOPT finds, in about 50 tau_min, at the rate that the spectrum predicts. An open-loop
          simulation with its controls reaches q_d. The printed equations give a straight line
          without steering, or do not settle.
Figure:   out/demos/01_D1.0/ and 01_D0.5/, four figures each: plan, controls, settling, spectrum;
          01_overview.png: problem, network and result;
          01_paths.png and 01_controls.png: corrected and printed equations, no obstacles.
"""

from pathlib import Path

import ann_dc
from ann_dc.paper import demonstrations
from ann_dc.plotting.paper import free_controls, free_paths, overview

WHEEL_BASES = (1.0, 0.5)


def main(out: Path | None = None) -> dict:
    """Solve both cars; return the results by wheel base and the paths of the figures."""
    explain(ann_dc.plants.car())
    table, pictures, solutions = {}, [], {}
    for D in WHEEL_BASES:
        print(f"\n6. Design, run and certificate: D = {D} m ...", flush=True)
        solution = ann_dc.solve(ann_dc.plants.car(D=D))
        print(solution.design, solution, sep="\n")
        table[D], solutions[D] = solution.as_dict(), solution
        if out is not None:
            pictures += ann_dc.plotting.save_all(solution, Path(out) / f"01_D{D}")
    if out is not None:
        pictures += as_printed(solutions[1.0], Path(out))
    return {"table": table, "figures": pictures}


def as_printed(optimum: ann_dc.Solution, out: Path) -> list[Path]:
    """Draw paths and controls of the corrected and printed equations, no obstacles."""
    print("\n7. Printed equations, no obstacles ...", flush=True)
    runs = {run.label: run.solution for run in demonstrations(optimum)}
    drawn = optimum, runs["without dB/dq"], runs["printed D=1"]
    for label, solution in runs.items():
        print(f"{label}: {solution.status.message}")
    return [
        ann_dc.plotting.save(overview(optimum), out / "01_overview.png"),
        ann_dc.plotting.save(free_paths(*drawn), out / "01_paths.png"),
        ann_dc.plotting.save(free_controls(*drawn), out / "01_controls.png"),
    ]


def explain(problem: ann_dc.OptimalControlProblem) -> None:
    """Print the problem, its stage equations and its network."""
    print("1. Problem (22)-(24):", problem, sep="\n")
    print("\n2. Stage equations as printed:")
    print(ann_dc.decompose(problem, ann_dc.PRINTED))
    print("\n3. Stage equations (11)-(15), corrected:")
    print(ann_dc.decompose(problem))
    network = ann_dc.synthesize(problem)
    print("\n4. Network, an array of nine equal cells:", network, sep="\n")
    print("\n5. Gains: `solve` designs rho and the time constants.")


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
