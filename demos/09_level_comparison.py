"""Level comparison: from ideal parts to transistors.

Question: Would the paper's problem run on real parts, how accurately, how fast, at what power, and
          compared with a solver on this CPU?
Answer:   Every level settles at the optimum. Boards of real parts have control errors of 0.1 to 12
          %, decided by resistors and multipliers, not by gain or bandwidth; resistors of series E96
          alone cost 5 %, because every cell repeats the same error. Matched transistors are 0.3 %
          off, within 0.1 % of their end after 15 us at 42 uJ per solve; with the mismatch of the
          smallest gates the median is 7 %. Fatrop takes 0.7 ms on a CPU, to eight digits. The
          emulation predicts op-amp circuits to a few tenths of a per cent and transistor circuits
          to a few per cent.
Figure:   out/demos/09_level_comparison.png: control error and settling time of every model level.
"""

from pathlib import Path

import ann_dc
from ann_dc import plotting
from ann_dc.fidelity import compare_levels, quick
from ann_dc.optimality import time_solvers


def main(out: Path | None = None, wanted=quick) -> dict:
    """Compare the model levels; return the results by name and the path of the figure."""
    problem = ann_dc.plants.car()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    done = []
    for found in compare_levels(network, wanted=wanted, timings=time_solvers(problem)):
        done.append(found)
        print(f"{found.name:34} control error {found.error:.1e} (predicted "
              f"{found.predicted_error:.1e}), settled: {1e6 * found.settling:6.1f} us")  # fmt: skip
    figures = []
    if out is not None:
        figure = plotting.comparison(done, problem)
        figures.append(plotting.save(figure, Path(out) / "09_level_comparison.png"))
    return {"rungs": {m.name: m for m in done}, "figures": figures}


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
