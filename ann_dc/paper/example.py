"""Paper's car as a whole network: two valid runs and four failing ones.

The corrected equations with designed gains are valid for both wheel bases. Equations (16) and (17)
as printed have neither penalty nor time constants (rho = 0, tau = 1). A run of the printed
equations with the gains of the corrected network shows that rho does not make them valid. Without
dB/dq (S3) alone the plan is a straight line. The corrected equations on the plain network, started
near the optimum, show the need for gains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ann_dc.backends.ode import OdeBackend
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED, switch
from ann_dc.gain_design.gains import manual_gains
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.problem.plants import car
from ann_dc.progress import Progress, silent
from ann_dc.solution.solution import Solution
from ann_dc.solver import solve
from ann_dc.synthesis.synthesis import synthesize

OFF = 0.01
"""Initial deviation of the plain network, as a fraction of every neuron's optimal value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperRun:
    """Row of the table: a `label`, a solution, and the beginning of its remark."""

    label: str
    solution: Solution
    remark: str = ""


def corrected_runs(progress: Progress = silent) -> Iterator[PaperRun]:
    """Yield runs of the corrected equations with designed gains, for both wheel bases."""
    for label, problem in {"corrected D=1": car(), "corrected D=0.5": car(D=0.5)}.items():
        tell = lambda line, label=label: progress(f"{label}: {line}")  # noqa: E731
        yield PaperRun(label=label, solution=solve(problem, progress=tell))


def demonstrations(optimum: Solution, progress: Progress = silent) -> Iterator[PaperRun]:
    """Yield short runs of the failing variants, all with D = 1.

    `optimum` is the solution of the corrected equations.

    Examples
    --------
    >>> import ann_dc
    >>> letter = next(demonstrations(ann_dc.solve(ann_dc.plants.car())))
    >>> letter.label, letter.solution.status.settled
    ('printed D=1', False)
    """
    problem = optimum.problem
    brief = OdeBackend(verify=False, limit=2000, most_steps=3000)
    progress("printed D=1")
    letter = manual_gains(synthesize(decompose(problem, PRINTED)))
    printed = solve(problem, form=PRINTED, gains=letter, backend=brief)
    yield PaperRun(label="printed D=1", solution=printed)
    for label, form in {"printed, designed gains": PRINTED, "without dB/dq": switch("S3")}.items():
        progress(label)
        found = solve(
            problem, form=form, preconditioner=PreconditionerKind.MULTILEVEL, backend=brief
        )
        yield PaperRun(label=label, solution=found)
    progress("plain D=1")
    gains = manual_gains(synthesize(decompose(problem)))
    yield PaperRun(
        label="plain D=1",
        solution=solve(problem, gains=gains, initial_guess=_near(optimum), backend=brief),
        remark=f"started {OFF:.0%} from the optimum, diverged and ",
    )


def _near(optimum: Solution) -> InitialGuess:
    """Return an initial guess with every neuron slightly off its optimum."""
    values = {name: (1 + OFF) * rows.T for name, rows in optimum.populations.items()}
    return InitialGuess(q=values["q"], u=values["u"], mu=values["mu"], beta=values["beta"])
