"""The ladder: one problem from ideal parts to silicon, prediction beside measurement.

Question: would the paper's problem run on real parts? How accurate, how fast, at what power, and is
          that worth it against a solver on this CPU?
Answer:   every level settles at the optimum. Real parts are wrong by 0.1 to 12 %, which resistors
          and multipliers decide, not gain or bandwidth; resistors from the E96 series alone cost
          5 %, because every cell repeats the same error. A network of matched transistors is 0.3 %
          off (7 % in the median with the mismatch of the smallest gates), within 0.1 % of its end
          after 15 us, at 42 uJ a solve; fatrop takes 0.7 ms on a CPU, to eight digits. The emulator
          predicts op amps to a few tenths of a per cent, transistors to a few per cent.
Figure:   out/demos/09_the_ladder.png
"""

from pathlib import Path

import ann_dc
from ann_dc import plotting
from ann_dc.fidelity import compare_levels, quick
from ann_dc.optimality import time_solvers


def main(out: Path | None = None, wanted=quick) -> dict:
    """Climb the ladder; return every rung by name, and the path of the picture."""
    problem = ann_dc.plants.car()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    done = []
    for found in compare_levels(network, wanted=wanted, timings=time_solvers(problem)):
        done.append(found)
        print(f"{found.name:34} error {found.error:.1e} (predicted "
              f"{found.predicted_error:.1e}), {1e6 * found.settling:6.1f} us")  # fmt: skip
    figures = []
    if out is not None:
        figure = plotting.comparison(done, problem)
        figures.append(plotting.save(figure, Path(out) / "09_the_ladder.png"))
    return {"rungs": {m.name: m for m in done}, "figures": figures}


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
