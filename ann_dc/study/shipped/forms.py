"""What networks of printed equations settle to: each slip by itself, and all to the letter.

The question: which forms run away, which find the optimum all the same, and which come to rest at
something else, so that only a certificate tells?
"""

from __future__ import annotations

import enum
from collections.abc import Sequence

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import OUTCOME, Row
from ann_dc.study.settings import WORDS
from ann_dc.study.study import Study
from ann_dc.study.yield_metrics import SETTLED

FORMS = tuple(WORDS["design.form"])
"""All: corrected, printed, S1 to S17."""
MEASURED = ("settling_in_fastest", "objective", "control_error", "kkt_residual", "certified")
SAME = 1e-5
"""Share of the largest control by which controls that count as the same may differ."""


class FormEnd(enum.Enum):
    """What became of a form; the value says it in words."""

    OPTIMUM = "settles to the optimum, certified"
    CONTROLS = "settles to the right controls alone"
    ELSEWHERE = "settles, and not to the optimum"
    NEVER = "does not settle"


def settling_of_forms(
    subject: str | OptimalControlProblem,
    *,
    forms: Sequence[str] = FORMS,
    kind: str = "pyramid",
) -> Study:
    """A study of printed forms: corrected, printed, S1 to S17, with the gains of the corrected one.

    Parameters
    ----------
    subject : str or OptimalControlProblem
    forms : sequence of str
        Words of 'design.form'.
    kind : str
        Metric of the design, a word of 'design.kind'. A neighbour grid is built for the corrected
        equations, and some slips that rest otherwise run away with it.

    Returns
    -------
    Study
        Measured: settling, objective, error of the controls against the corrected network's, KKT
        residual and certificate.

    Examples
    --------
    >>> len(settling_of_forms("car"))
    19
    """
    return Study(
        subject=subject,
        over={"design.form": list(forms)},
        fixed={"design.kind": kind},
        metrics=MEASURED,
        title="What networks of printed equations settle to",
    )


def end_of(row: Row) -> FormEnd:
    """What became of a form.

    Parameters
    ----------
    row : Row
        Of `settling_of_forms`.

    Examples
    --------
    >>> print(end_of({"outcome": "settled", "certified": False, "control_error": 0.3}).value)
    settles, and not to the optimum
    """
    if row[OUTCOME] != SETTLED:
        return FormEnd.NEVER
    if row["certified"] == 1:
        return FormEnd.OPTIMUM
    error = row["control_error"]
    is_same = isinstance(error, (int, float)) and error < SAME
    return FormEnd.CONTROLS if is_same else FormEnd.ELSEWHERE
