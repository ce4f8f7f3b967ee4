"""Settling and stability against penalty, multiplier gains and stages.

Question: How fast does the network settle, when does it not settle, and is that known before a run?
Answer:   The spectrum at the solution predicts it: ln(1e6) radius / |abscissa| tau_min to 1e-6. The
          optimum is unstable if rho is too small, or if multipliers are too slow without coarse
          coordinators. With the diagonal preconditioner settling grows with N; with the multilevel
          preconditioner it does not.
Figure:   out/demos/04_settling_and_stability.png: measured points, predicted lines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.analysis import Linearisation, Spectrum
from ann_dc.gain_design import MULTILEVEL_RULE, Design, closed_form
from ann_dc.plotting import style

TOLERANCE = 1e-6
LIMIT = 4000.0
"""Time limit of a run (tau_min)."""
MOST_STEPS = 3000
"""Step limit of a run; a diverging network becomes stiffer and reaches it."""
HORIZON = 0.9
"""Duration of the motion (s), the same for every number of stages."""
COLOUR = {True: style.BLUE, False: style.VERMILION}
PRECONDITIONER = {True: "multilevel", False: "diagonal"}


@dataclass(frozen=True, kw_only=True)
class Point:
    """Settling time of one gain rule, predicted and measured (tau_min)."""

    value: float
    abscissa: float
    predicted: float
    measured: float = float("nan")


class Bench:
    """Car with N stages at its settled point, to test gain rules."""

    def __init__(self, N: int) -> None:
        self.N = N
        problem = ann_dc.plants.car(N=N, dt=HORIZON / N)
        self.network = ann_dc.synthesize(problem)
        self.design: Design = ann_dc.design(self.network, gain_rule=MULTILEVEL_RULE)

    @cached_property
    def linear(self) -> Linearisation:
        """Linearisation at the settled point, from which the closed form computes gains."""
        return Linearisation(self.network).at(self.design.state)

    def predict(self, gain_rule: ann_dc.GainRule, value: float) -> Point:
        """Predict the settling time of a gain rule from its spectrum."""
        found = self._spectrum(gain_rule)
        steps = np.log(1 / TOLERANCE) * found.stiffness_ratio
        return Point(value=value, abscissa=found.abscissa, predicted=float(steps))

    def measure(self, gain_rule: ann_dc.GainRule, value: float) -> Point:
        """Predict and measure settling from the straight line (nan if not settled)."""
        network = ann_dc.apply_gains(self.network, closed_form(self.linear, gain_rule))
        run = ann_dc.OdeBackend(verify=False, limit=LIMIT, most_steps=MOST_STEPS).run(network)
        radius = self._spectrum(gain_rule).radius
        return replace(self.predict(gain_rule, value), measured=run.settling_time * radius)

    def _spectrum(self, gain_rule: ann_dc.GainRule) -> Spectrum:
        gained = ann_dc.apply_gains(self.network, closed_form(self.linear, gain_rule))
        return ann_dc.spectrum(gained, self.design.state)


def main(out: Path | None = None, fast: bool = False) -> dict:
    """Sweep rho, multiplier rates and N; ``fast`` selects fewer points and stages."""
    print("designing the car with nine stages ...", flush=True)
    bench = Bench(9)
    few, many = (3, 9) if fast else (7, 31)
    sweeps = {}
    for name, of, low, high in (
        ("rho", with_rho, -1.0, 1.0),
        ("multiplier rate", with_multiplier_rate, -2.0, 1.5),
    ):
        sweeps[name] = {
            multilevel: sweep(
                bench, lambda v, c=multilevel, f=of: f(v, c),
                np.logspace(low, high, few), np.logspace(low, high, many), name,
            )
            for multilevel in (True, False)
        }  # fmt: skip
    stages = (6, 9) if fast else (9, 18, 36)
    sweeps["N"] = against_stages(stages)
    print(as_text(sweeps))
    pictures = []
    if out is not None:
        path = Path(out) / "04_settling_and_stability.png"
        pictures.append(plotting.save(picture(sweeps), path))
    return {"sweeps": as_data(sweeps), "figures": pictures}


def with_rho(value: float, multilevel: bool) -> ann_dc.GainRule:
    """Return the gain rule with rho = value * rho_0."""
    base = MULTILEVEL_RULE if multilevel else ann_dc.DIAGONAL_RULE
    return replace(base, penalty=value)


def with_multiplier_rate(value: float, multilevel: bool) -> ann_dc.GainRule:
    """Return the gain rule with rates of value * rho for mu and beta."""
    base = MULTILEVEL_RULE if multilevel else ann_dc.DIAGONAL_RULE
    return replace(base, dual=value, dual_coupling=value)


def sweep(
    bench: Bench,
    gain_rule: Callable[[float], ann_dc.GainRule],
    coarse: Iterable[float],
    fine: Iterable[float],
    name: str,
) -> dict:
    """Predict on a fine grid, run on a coarse grid and find the stability limit."""
    print(f"sweeping {name} ...", flush=True)
    line = [bench.predict(gain_rule(v), float(v)) for v in fine]
    return {
        "line": line,
        "dots": [bench.measure(gain_rule(v), float(v)) for v in coarse],
        "boundary": boundary(line),
    }


def boundary(line: list[Point]) -> float:
    """Interpolate the value below which the optimum is unstable; nan if none is."""
    for low, high in pairwise(line):
        if low.abscissa >= 0 > high.abscissa:
            fraction = low.abscissa / (low.abscissa - high.abscissa)
            return float(low.value * (high.value / low.value) ** fraction)
    return float("nan")


def against_stages(stages: tuple[int, ...]) -> dict:
    """Run both gain rules for several numbers of stages, with the same duration."""
    found: dict[bool, list[Point]] = {True: [], False: []}
    for N in stages:
        print(f"designing and running N = {N} ...", flush=True)
        bench = Bench(N)
        found[True].append(bench.measure(MULTILEVEL_RULE, N))
        found[False].append(bench.measure(ann_dc.DIAGONAL_RULE, N))
    return {
        multilevel: {"line": dots, "dots": dots, "boundary": float("nan")}
        for multilevel, dots in found.items()
    }


def as_data(sweeps: dict) -> dict:
    """Return the numbers of every sweep."""
    return {
        sweep: {
            PRECONDITIONER[c]: {
                "boundary": one["boundary"],
                "dots": [asdict(point) for point in one["dots"]],
            }
            for c, one in both.items()
        }
        for sweep, both in sweeps.items()
    }


def as_text(sweeps: dict) -> str:
    """Return the table of predicted and measured settling times."""
    head = f"{'settling time (tau_min)':30}{'value':>9}{'abscissa':>11}"
    lines = [f"{head}{'predicted':>11}{'measured':>10}"]
    for name, both in sweeps.items():
        for multilevel, one in both.items():
            case = f"{name}, {PRECONDITIONER[multilevel]}"
            for p in one["dots"]:
                lines.append(
                    f"{case:30}{p.value:9.3g}{p.abscissa:11.2e}{p.predicted:11.0f}{p.measured:10.0f}"
                )
            if np.isfinite(one["boundary"]):
                lines.append(f"{'':30}the optimum is unstable below {one['boundary']:.3g}")
    return "\n".join(lines)


def picture(sweeps: dict):
    """Draw a panel per sweep: predicted lines, measured points, stability limits."""
    figure = plotting.new_figure(11.0, 4.2)
    labels = {
        "rho": "penalty rho (relative to rho_0)",
        "multiplier rate": "rate of mu and beta (relative to rho)",
        "N": "number of stages N (N dt = 0.9 s)",
    }
    panels = figure.subplots(1, 3, sharey=True)
    for axes, (name, both) in zip(panels, sweeps.items()):
        for multilevel, one in both.items():
            panel(axes, one, COLOUR[multilevel], multilevel)
        axes.set(xscale="log", yscale="log", xlabel=labels[name])
        plotting.quiet(axes)
    panels[0].set_ylim(80, 3e4)
    panels[0].set_ylabel("settling time to 1e-6 (tau_min)")
    ticks = [int(p.value) for p in sweeps["N"][True]["dots"]]
    panels[2].set_xticks(ticks, [str(N) for N in ticks])
    panels[2].minorticks_off()
    handles = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=4,
        frameon=False, fontsize=8,
    )  # fmt: skip
    figure.suptitle(
        "Settling time predicted by the spectrum and measured: network of the car, "
        "N = 9, dt = 0.1 s unless swept",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def panel(axes, one: dict, colour: str, multilevel: bool) -> None:
    """Draw one sweep with one preconditioner."""
    kind = PRECONDITIONER[multilevel]
    line = [p for p in one["line"] if np.isfinite(p.predicted)]
    axes.plot(
        [p.value for p in line], [p.predicted for p in line],
        color=colour, lw=1.4, label=f"predicted, {kind}",
    )  # fmt: skip
    settled = [p for p in one["dots"] if np.isfinite(p.measured)]
    axes.plot(
        [p.value for p in settled], [p.measured for p in settled], "o",
        color=colour, ms=6, mec="white", label=f"measured, {kind}",
    )  # fmt: skip
    unsettled = [p.value for p in one["dots"] if not np.isfinite(p.measured)]
    axes.plot(
        unsettled, [LIMIT] * len(unsettled), "+" if multilevel else "x",
        color=colour, ms=8, mew=1.6, label=f"not settled in {LIMIT:g} tau_min, {kind}",
    )  # fmt: skip
    if np.isfinite(one["boundary"]):
        axes.axvline(one["boundary"], color=colour, ls=":", label=f"unstable to the left, {kind}")


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
