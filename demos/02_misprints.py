"""Misprints of the paper, one at a time.

Question: Which misprints matter, and how does a network with each of them behave?
Answer:   Each switch S1 to S17 runs with the multilevel gains that are designed for the corrected
          network; the printed form (16), (17) runs with rho = 0 and unit time constants. Wrong
          signs (S1, S2, S8, S10, S17), a wrong neighbour (S9) and the printed form diverge. S4, S7
          and S11 settle at the optimum of another problem, S6 approaches one slowly, S5 settles at
          a feasible path that is not optimal. Without dB/dq (S3) the states settle on an evenly
          spaced straight line that the car cannot drive, while a multiplier grows linearly: the
          straight path of the paper's Figure 4, except for its last segment. S13 and S15 settle
          without any effort. S12, S14 and S16 find the optimal controls. If all multipliers vanish
          (S5, S13, S15), a relative residual has no scale and need not fall, although the values
          are constant. A resistive grid is built for the corrected equations, and some forms that
          settle with multilevel gains diverge with it.
Figure:   out/demos/02_without_dB_dq.png: paths and largest multiplier, S3 and corrected.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.backends import DOP853, Run
from ann_dc.evaluation import neuron_values
from ann_dc.optimality import Certificate, certify
from ann_dc.plotting import style
from ann_dc.two_level import OracleBackend, OracleGain

LIMIT = 4000.0
"""Time limit of a run (tau_min); the corrected network needs 166."""
MOST_STEPS = 5000
"""Step limit of a run; a diverging network becomes stiffer and reaches it."""

MEANING = {
    "corrected": "Reference: the corrected equations.",
    "S1": "q and u follow the positive gradient of the Lagrangian; diverges at once.",
    "S2": "beta drives q away from its target and diverges; the network becomes stiffer.",
    "S3": "No term changes phi and varphi: q stays on a straight line, mu_y grows without bound.",
    "S4": "Settles for a plant with ten times the damping; the controls miss q_d by metres.",
    "S5": "Effort has no cost: multipliers decay; settles at a feasible path, not the optimal one.",
    "S6": "Controls act ten times as strongly: slow convergence to the optimum of another plant.",
    "S7": "Every coupling loses 1 %: settles at a plan of lower cost that misses q_d by 0.4 m.",
    "S8": "Drives q to minus its target, contrary to the boundary conditions; diverges.",
    "S9": "Ties q to the target two stages ahead, which the chain cannot satisfy; diverges.",
    "S10": "mu drives t with the wrong sign; diverges.",
    "S11": "The ends of the array are not connected: settles, but the ends are inconsistent.",
    "S12": "Scales E and the multipliers by 1/N: settles at the same path nine times as slowly.",
    "S13": "The terminal condition is missing: controls decay to zero, the car does not move.",
    "S14": "Not an erratum: with q_0 as a neuron the optimum is the same.",
    "S15": "Both levels have the same equation: q stays at the initial guess, u decays to zero.",
    "S16": "The oracle gain |B/A| shortens settling by an eighth, but needs the solution.",
    "S17": "(30) as printed: t and beta drive each other, independent of the dynamics, and grow.",
    "printed": "(16), (17) as printed, rho = 0: several of the above at once; diverges.",
}
"""Behaviour of every form; the figures of the table are measured in every run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """Run and certificate of one form of the equations."""

    name: str
    run: Run
    certificate: Certificate
    values: dict[str, np.ndarray]

    @property
    def largest(self) -> tuple[str, float]:
        """Name and last value (network units) of the neuron that is farthest from zero."""
        trajectory = self.run.trajectory
        farthest = int(np.nanargmax(np.abs(trajectory.final)))
        return trajectory.network.label(farthest), float(trajectory.final[farthest])

    def as_dict(self) -> dict:
        """Return the row of the table."""
        return {
            "switch": self.name,
            "outcome": self.run.status.outcome.name.lower(),
            "neuron": self.run.status.neuron or self.largest[0],
            "largest": self.largest[1],
            "own_residual": float(self.run.trajectory.kkt[-1]),
            "kkt_residual": self.certificate.kkt_residual,
            "objective": self.certificate.objective,
            "rollout_error": self.certificate.rollout_error,
            "settling_time": self.run.settling_time,
            "meaning": MEANING[self.name],
        }


def main(out: Path | None = None, names: tuple[str, ...] = tuple(MEANING)) -> dict:
    """Run the chosen forms; return the table, the line of S3 and the figure paths."""
    problem = ann_dc.plants.car()
    print("designing the corrected network ...", flush=True)
    designed = ann_dc.design(
        ann_dc.synthesize(problem), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    )
    reference = measure("corrected", problem, designed.network)
    optimum = reference.run.trajectory.final
    rows = {"corrected": reference}
    for name in (n for n in names if n != "corrected"):
        network = with_misprint(problem, name, designed.gains)
        gain = OracleGain(settled=optimum, low=1e-3) if name == "S16" else None
        rows[name] = measure(name, problem, network, gain)
    print(as_text(rows))
    pictures = []
    if out is not None and "S3" in rows:
        figure = without_control_jacobian(problem, rows["S3"], reference)
        pictures.append(plotting.save(figure, Path(out) / "02_without_dB_dq.png"))
    table = {name: row.as_dict() for name, row in rows.items()}
    line = straight_line(rows["S3"]) if "S3" in rows else {}
    return {"table": table, "straight_line": line, "figures": pictures}


def with_misprint(problem: ann_dc.OptimalControlProblem, name: str, gains) -> ann_dc.Network:
    """Return the network with a misprint and the given gains (rho = 0 for "printed")."""
    form = ann_dc.PRINTED if name == "printed" else ann_dc.switch(name)
    network = ann_dc.synthesize(ann_dc.decompose(problem, form))
    return ann_dc.apply_gains(network, ann_dc.manual_gains(network) if name == "printed" else gains)


def measure(
    name: str,
    problem: ann_dc.OptimalControlProblem,
    network: ann_dc.Network,
    gain: OracleGain | None = None,
) -> Row:
    """Run a network and certify its final state for problem (22)-(24)."""
    print(f"running {name} ...", flush=True)
    ode = ann_dc.OdeBackend(
        method=DOP853.tighter(), limit=LIMIT, most_steps=MOST_STEPS, verify=False
    )
    run = (ode if gain is None else OracleBackend(gain=gain, ode=ode)).run(network)
    values = {key: rows.T for key, rows in neuron_values(network, run.trajectory.final).items()}
    certificate = certify(problem, *(values[p] for p in ("q", "u", "t", "mu", "beta")))
    return Row(name=name, run=run, certificate=certificate, values=values)


def as_text(rows: dict[str, Row]) -> str:
    """Return the table, and a sentence for every form."""
    head = f"{'':10}{'outcome':13}{'largest neuron':>21}{'residual':>10}{'KKT res.':>10}"
    lines = [head + f"{'objective':>12}{'sim. error':>12}{'settling':>10}"]
    for name, row in rows.items():
        r = row.as_dict()
        lines.append(
            f"{name:10}{r['outcome']:13}{r['neuron']:>11}{r['largest']:10.3g}{r['own_residual']:10.1e}"
            f"{r['kkt_residual']:10.1e}{r['objective']:12.6g}{r['rollout_error']:12.2g}"
            f"{r['settling_time']:10.4g}"
        )
    lines += ["(residual: form; KKT res.: problem; settling: unit time constants)", ""]
    return "\n".join([*lines, *(f"{name:10}{MEANING[name]}" for name in rows)])


def straight_line(row: Row) -> dict:
    """Return spacing and bend of the path of q, and the growth rate of a multiplier."""
    path = np.column_stack([row.values["q"], row.values["t"][:, -1]])[:2]
    steps = np.diff(path, axis=1)
    time, mu_y = row.run.trajectory.time, row.run.trajectory["mu.y"][:, -1]
    late = time > time[-1] / 2
    slope = np.polyfit(time[late], mu_y[late], 1)[0]
    return {
        "step": np.hypot(*steps).tolist(),
        "unevenness": float(np.ptp(np.hypot(*steps)[:-1]) / np.hypot(*steps).mean()),
        "bend": float(np.ptp(np.arctan2(steps[1], steps[0])[:-1])),
        "constraint_residual": row.certificate.constraint_residual,
        "mu_y": float(mu_y[-1]),
        "growth_of_mu_y": float(slope),
    }


def without_control_jacobian(problem, misprint: Row, reference: Row):
    """Draw S3 and the optimum: paths, and largest multiplier over network time."""
    figure = plotting.new_figure(9.6, 4.4)
    plane, growth = figure.subplots(1, 2)
    ink, blue, red = style.INK, style.BLUE, style.VERMILION
    sides = ((misprint, red, "without dB/dq (S3)"), (reference, blue, "corrected"))
    for row, colour, name in sides:
        path = np.column_stack([row.values["q"], row.values["t"][:, -1]])[:2]
        plane.plot(*path, "o-", color=colour, ms=4.5, lw=1.6, label=f"q neurons, {name}")
        time = row.run.trajectory.time
        largest = np.abs(row.run.trajectory["mu.y"]).max(axis=1)
        reported = time >= 1  # the earlier curves coincide and would take decades of the axis
        growth.plot(
            time[reported], largest[reported], color=colour, lw=1.8, label=f"largest |mu.y|, {name}"
        )
    plane.plot(
        *misprint.certificate.rollout[:2],
        "--",
        color=ink,
        lw=1.4,
        label="simulation with the controls of S3",
    )
    plane.plot(*problem.q_d[:2], "*", color=style.GREEN, ms=13, label="target q_d", zorder=5)
    plane.set(xlabel="x (m)", ylabel="y (m)")
    plane.set_aspect("equal", adjustable="datalim")
    growth.set(xlabel=style.UNSCALED, ylabel=f"mu.y ({problem.unit('mu.y')})")
    growth.set(xscale="log", yscale="log", xlim=(1, None))
    for axes in (plane, growth):
        plotting.quiet(axes)
        axes.legend(
            frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(0, -0.16), borderaxespad=0
        )
    figure.suptitle(
        f"{plotting.caption(problem)}\n"
        "Without dB/dq the planned path is a straight line that the car cannot drive",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
