"""Settled points of the misprinted networks.

Question: Which of the misprinted networks diverge, which find the optimum, and which settle at
          another point?
Answer: Of nineteen forms (corrected, S1 to S17, as printed) ten settle, three at the certified
          optimum: the corrected form, S14, which is not a misprint, and S16, which needs the
          solution. S12 finds the controls to 1e-8, nine times as slowly, with multipliers that are
          a ninth of the right ones. Six settle at another point: S4, S5 and S7 on paths of other
          cost, S11 with inconsistent boundary conditions, S13 and S15 without effort. S7 is
          closest: its controls are 2.6 % off, and it settles in the same 153 tau_min. Nine do not
          settle. Only a certificate separates these cases.
Figure:   out/demos/20_equilibria_of_misprints.png
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Row

STUDY = Path(__file__).with_name("forms.toml")
SAME = 1e-5
"""Tolerance for equal controls, relative to the largest control."""


class FormEnd(enum.Enum):
    """Classification of a form; the value is its description."""

    OPTIMUM = "certified optimum"
    CONTROLS = "optimal controls only"
    ELSEWHERE = "settled at another point"
    NEVER = "not settled"


COLOURS = {
    FormEnd.OPTIMUM: style.GREEN,
    FormEnd.CONTROLS: style.SKY,
    FormEnd.ELSEWHERE: style.ORANGE,
    FormEnd.NEVER: style.GREY,
}
"""Colours of the results."""
DESCRIPTIONS = {
    "corrected": "corrected equations",
    "printed": "(16), (17) as printed",
    "S1": "q and u ascend the Lagrangian",
    "S2": "multiplier beta descends",
    "S3": "without dB/dq",
    "S4": "damping without dt",
    "S5": "dE/dq instead of dE/du for u",
    "S6": "B without dt in (12), (13)",
    "S7": "0.99 before q in the coupling",
    "S8": "q + t in the coupling, (15)",
    "S9": "t of stage k+1 in coupling, (17)",
    "S10": "-mu + beta for t, (14)",
    "S11": "index ranges as printed",
    "S12": "cost divided by N, (10)",
    "S13": "no terminal condition",
    "S14": "q_0 is a neuron; no erratum",
    "S15": "both levels solve (30)",
    "S16": "rate |B/A| of (33), an oracle",
    "S17": "(30) as printed",
}
"""Short descriptions of the forms; demo 02 explains their effects."""
COLUMNS = (
    ("form", 0.01, "left"),
    ("", 0.085, "left"),
    ("outcome", 0.315, "left"),
    ("settling\ntime\n(tau_min)", 0.50, "right"),
    ("objective E\n(user's units)", 0.605, "right"),
    ("control error\n(relative to\nlargest)", 0.695, "right"),
    ("relative\nKKT residual", 0.785, "right"),
    ("result", 0.805, "left"),
)
"""Column heads, positions as fractions of the width, and alignments."""


def main(
    out: Path | None = None,
    subject: str = "car",
    forms: Sequence[str] | None = None,
    workers: int | None = None,
) -> dict:
    """Run the study; return its rows and results by form, and the figure path."""
    study = replace(ann_dc.load_study(STUDY), subject=subject)
    if forms is not None:
        study = replace(study, vary={"design.form": [*forms]})
    table = study.run(workers=workers)
    rows = {str(row["design.form"]): row for row in table.rows()}
    ends = {form: end_of(row) for form, row in rows.items()}
    for form, row in rows.items():
        print(f"{form:10}", "  ".join(f"{word:>12}" for word in cells_of(row)), ends[form].value)
    figures = []
    if out is not None:
        figure = picture(subject, rows, ends)
        figures.append(plotting.save(figure, Path(out) / "20_equilibria_of_misprints.png"))
    return {"rows": rows, "ends": ends, "figures": figures}


def end_of(row: Row) -> FormEnd:
    """Classify the result of a form."""
    if row["outcome"] != "settled":
        return FormEnd.NEVER
    if row["certified"] == 1:
        return FormEnd.OPTIMUM
    return FormEnd.CONTROLS if row["control_error"] < SAME else FormEnd.ELSEWHERE  # type: ignore


def cells_of(row: Row) -> tuple[str, ...]:
    """Return outcome, settling time, objective, control error and KKT residual as text."""
    names = ("normalised_settling_time", "objective", "control_error", "kkt_residual")
    settling, objective, error, residual = (float(row[name]) for name in names)  # type: ignore
    objective = round(objective, 9)
    return (
        str(row["outcome"]),
        f"{settling:.0f}" if np.isfinite(settling) else "-",
        f"{objective:.6g}" if abs(objective) < 1e6 else f"{objective:.0e}",
        f"{error:.0e}" if np.isfinite(error) else "-",
        f"{residual:.0e}",
    )


def picture(subject: str, rows: dict[str, Row], ends: dict[str, FormEnd]):
    """Draw a table with a line per form, grouped and coloured by result."""
    order = [form for end in FormEnd for form in rows if ends[form] is end]
    figure = plotting.new_figure(11.0, 1.2 + 0.24 * len(order))
    axes = figure.subplots()
    axes.set(xlim=(0, 1), ylim=(len(order), -1.8))
    axes.axis("off")
    for head, x, side in COLUMNS:
        axes.text(x, -0.58, head, ha=side, va="bottom", fontsize=8, color=style.GREY)
    for line, form in enumerate(order):
        end = ends[form]
        axes.axhspan(line - 0.42, line + 0.42, color=COLOURS[end], alpha=0.18, lw=0)
        axes.axvspan(0, 0.004, 1 - (line + 2.22) / (len(order) + 1.8),
                     1 - (line + 1.38) / (len(order) + 1.8), color=COLOURS[end], lw=0)  # fmt: skip
        cells = (form, DESCRIPTIONS.get(form, ""), *cells_of(rows[form]), end.value)
        for cell, (_, x, side) in zip(cells, COLUMNS):
            weight = "bold" if x == COLUMNS[0][1] else "normal"
            axes.text(x, line, cell, ha=side, va="center", fontsize=8, weight=weight)
    count = sum(end is not FormEnd.NEVER for end in ends.values())
    right = sum(end is FormEnd.OPTIMUM for end in ends.values())
    plotting.headline(
        figure,
        f"{subject}: {count} of {len(rows)} forms settle, {right} of them at the certified optimum"
        "; gains of the corrected network",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
