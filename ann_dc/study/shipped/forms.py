"""Equilibria of networks with errata of the paper: one by one, and as printed.

The study separates forms that diverge, forms that still find the optimum, and forms that settle
elsewhere. The last are detected only by a certificate.
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
"""Names of all forms: corrected, printed, S1 to S17."""
MEASURED = ("normalised_settling_time", "objective", "control_error", "kkt_residual", "certified")
SAME = 1e-5
"""Tolerance for equal controls, relative to the largest control."""


class FormEnd(enum.Enum):
    """Classification of a form; the value is its description."""

    OPTIMUM = "settles to the optimum, certified"
    CONTROLS = "settles to the right controls alone"
    ELSEWHERE = "settles, and not to the optimum"
    NEVER = "does not settle"


def settling_of_forms(
    subject: str | OptimalControlProblem,
    *,
    forms: Sequence[str] = FORMS,
    kind: str = "multilevel",
) -> Study:
    """Declare a study of the forms corrected, printed and S1 to S17.

    All forms use the gains of the corrected form.

    Parameters
    ----------
    subject : str or OptimalControlProblem
        Plant name or problem.
    forms : sequence of str
        Values of 'design.form'. Default: all.
    kind : str
        Preconditioner kind, a value of 'design.kind'. Default "multilevel" (additive multilevel). A
        resistive grid is designed for the corrected equations, and some errata that settle
        otherwise diverge with it.

    Returns
    -------
    Study
        Metrics: settling, objective, error of the controls against the corrected network, KKT
        residual and certificate.

    Examples
    --------
    >>> len(settling_of_forms("car"))
    19
    """
    return Study(
        subject=subject,
        vary={"design.form": list(forms)},
        fixed={"design.kind": kind},
        metrics=MEASURED,
        title="What networks of printed equations settle to",
    )


def end_of(row: Row) -> FormEnd:
    """Classify the result of a form.

    Parameters
    ----------
    row : Row
        Record of `settling_of_forms`.

    Returns
    -------
    FormEnd

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
