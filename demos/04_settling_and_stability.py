"""Settling and stability against penalty, multiplier gains and stages.

Question: How fast does the network settle, when does it not settle, and is that known before a run?
Answer:   The spectrum at the solution predicts it: ln(1e6) radius / |abscissa| tau_min to 1e-6. The
          optimum is unstable if rho is too small, or if multipliers are too slow without coarse
          coordinators. With the diagonal preconditioner settling grows with N; with the multilevel
          preconditioner it does not.
Figure:   out/demos/04_settling_and_stability.png: measured dots on predicted lines.
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
"""Longest run, in fastest time constants."""
MOST_STEPS = 3000
"""A network that runs away gets ever stiffer; after so many steps it has run away."""
HORIZON = 0.9
"""Seconds that the car has, whatever the number of stages."""
COLOUR = {True: style.BLUE, False: style.VERMILION}


@dataclass(frozen=True, kw_only=True)
class Point:
    """One design: settling in fastest time constants, predicted and measured."""

    value: float
    abscissa: float
    predicted: float
    measured: float = float("nan")


class Bench:
    """A car with N stages at its settled point, where designs are tried."""

    def __init__(self, N: int) -> None:
        self.N = N
        problem = ann_dc.plants.car(N=N, dt=HORIZON / N)
        self.network = ann_dc.synthesize(problem)
        self.design: Design = ann_dc.design(self.network, gain_rule=MULTILEVEL_RULE)

    @cached_property
    def linear(self) -> Linearisation:
        """What the closed form reads at the settled point."""
        return Linearisation(self.network).at(self.design.state)

    def predict(self, gain_rule: ann_dc.GainRule, value: float) -> Point:
        """The spectrum's word on a recipe."""
        found = self._spectrum(gain_rule)
        steps = np.log(1 / TOLERANCE) * found.stiffness_ratio
        return Point(value=value, abscissa=found.abscissa, predicted=float(steps))

    def measure(self, gain_rule: ann_dc.GainRule, value: float) -> Point:
        """The same, and a run from the straight line until it settles (nan where it does not)."""
        frozen = ann_dc.apply_gains(self.network, closed_form(self.linear, gain_rule))
        run = ann_dc.OdeBackend(verify=False, limit=LIMIT, most_steps=MOST_STEPS).run(frozen)
        radius = self._spectrum(gain_rule).radius
        return replace(self.predict(gain_rule, value), measured=run.settling_time * radius)

    def _spectrum(self, gain_rule: ann_dc.GainRule) -> Spectrum:
        gained = ann_dc.apply_gains(self.network, closed_form(self.linear, gain_rule))
        return ann_dc.spectrum(gained, self.design.state)


def main(out: Path | None = None, fast: bool = False) -> dict:
    """Sweep rho, dual gains and N; ``fast`` takes three points of each and short rows."""
    print("designing the car with nine stages ...", flush=True)
    bench = Bench(9)
    few, many = (3, 9) if fast else (7, 31)
    equilibration_sweeps = {}
    for name, of, low, high in (
        ("rho", with_rho, -1.0, 1.0),
        ("dual gain", with_dual_gain, -2.0, 1.5),
    ):
        equilibration_sweeps[name] = {
            coordinated: sweep(
                bench, lambda v, c=coordinated, f=of: f(v, c),
                np.logspace(low, high, few), np.logspace(low, high, many), name,
            )
            for coordinated in (True, False)
        }  # fmt: skip
    stages = (6, 9) if fast else (9, 18, 36)
    equilibration_sweeps["N"] = against_stages(stages)
    print(as_text(equilibration_sweeps))
    pictures = []
    if out is not None:
        path = Path(out) / "04_settling_and_stability.png"
        pictures.append(plotting.save(picture(equilibration_sweeps), path))
    return {"sweeps": as_data(equilibration_sweeps), "figures": pictures}


def with_rho(value: float, coordinated: bool) -> ann_dc.GainRule:
    """The recipe with rho = value * rho_0."""
    base = MULTILEVEL_RULE if coordinated else ann_dc.DIAGONAL_RULE
    return replace(base, penalty=value)


def with_dual_gain(value: float, coordinated: bool) -> ann_dc.GainRule:
    """The recipe with dual rates of value * rho, mu and beta alike."""
    base = MULTILEVEL_RULE if coordinated else ann_dc.DIAGONAL_RULE
    return replace(base, dual=value, dual_coupling=value)


def sweep(
    bench: Bench,
    gain_rule: Callable[[float], ann_dc.GainRule],
    coarse: Iterable[float],
    fine: Iterable[float],
    name: str,
) -> dict:
    """Predictions on a fine grid, runs on a coarse one, and where the abscissa changes sign."""
    print(f"sweeping {name} ...", flush=True)
    line = [bench.predict(gain_rule(v), float(v)) for v in fine]
    return {
        "line": line,
        "dots": [bench.measure(gain_rule(v), float(v)) for v in coarse],
        "boundary": boundary(line),
    }


def boundary(line: list[Point]) -> float:
    """The value below which the optimum repels, interpolated; nan where it attracts throughout."""
    for low, high in pairwise(line):
        if low.abscissa >= 0 > high.abscissa:
            share = low.abscissa / (low.abscissa - high.abscissa)
            return float(low.value * (high.value / low.value) ** share)
    return float("nan")


def against_stages(stages: tuple[int, ...]) -> dict:
    """Both recipes over the number of stages, same horizon in seconds."""
    found: dict[bool, list[Point]] = {True: [], False: []}
    for N in stages:
        print(f"designing and running N = {N} ...", flush=True)
        bench = Bench(N)
        found[True].append(bench.measure(MULTILEVEL_RULE, N))
        found[False].append(bench.measure(ann_dc.DIAGONAL_RULE, N))
    return {
        coordinated: {"line": dots, "dots": dots, "boundary": float("nan")}
        for coordinated, dots in found.items()
    }


def as_data(equilibration_sweeps: dict) -> dict:
    """Plain numbers of every sweep."""
    name = {True: "with coordinators", False: "without"}
    return {
        sweep: {
            name[c]: {
                "boundary": one["boundary"],
                "dots": [asdict(point) for point in one["dots"]],
            }
            for c, one in both.items()
        }
        for sweep, both in equilibration_sweeps.items()
    }


def as_text(equilibration_sweeps: dict) -> str:
    """The measured points beside what the spectrum said."""
    lines = [f"{'':30}{'value':>9}{'abscissa':>11}{'predicted':>11}{'measured':>10}"]
    for name, both in as_data(equilibration_sweeps).items():
        for kind, one in both.items():
            for p in one["dots"]:
                lines.append(
                    f"{name + ', ' + kind:30}{p['value']:9.3g}{p['abscissa']:11.2e}"
                    f"{p['predicted']:11.0f}{p['measured']:10.0f}"
                )
            if np.isfinite(one["boundary"]):
                lines.append(f"{'':30}the optimum repels below {one['boundary']:.3g}")
    return "\n".join(lines)


def picture(equilibration_sweeps: dict):
    """Three panels, one a sweep: lines predicted, dots measured, dotted where stability begins."""
    figure = plotting.new_figure(11.0, 4.2)
    labels = {
        "rho": "penalty rho / rho_0 (1)",
        "dual gain": "dual gain, rate of mu and beta / rho (1)",
        "N": "stages N (1), same 0.9 s",
    }
    panels = figure.subplots(1, 3, sharey=True)
    for axes, (name, both) in zip(panels, equilibration_sweeps.items()):
        for coordinated, one in both.items():
            panel(axes, one, COLOUR[coordinated], coordinated)
        axes.set(xscale="log", yscale="log", xlabel=labels[name])
        plotting.quiet(axes)
    panels[0].set_ylim(80, 3e4)
    panels[0].set_ylabel("settling to 1e-6 (fastest time constants)")
    ticks = [int(p.value) for p in equilibration_sweeps["N"][True]["dots"]]
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
        "The spectrum knows before the run: settling of the car's network, "
        "N = 9, dt = 0.1 s unless swept",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def panel(axes, one: dict, colour: str, coordinated: bool) -> None:
    """One sweep of one wiring."""
    kind = "with coordinators" if coordinated else "without"
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
    lost = [p.value for p in one["dots"] if not np.isfinite(p.measured)]
    axes.plot(
        lost, [LIMIT] * len(lost), "+" if coordinated else "x",
        color=colour, ms=8, mew=1.6, label=f"did not settle in {LIMIT:g}, {kind}",
    )  # fmt: skip
    if np.isfinite(one["boundary"]):
        axes.axvline(one["boundary"], color=colour, ls=":", label=f"repels left of it, {kind}")


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
