"""Options of a run: --backend with its options, --form, --initial-guess and --lower.

An option of one backend is rejected with another, because it would have no effect.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.options import completing, option
from ann_dc.cli.arguments.words import named
from ann_dc.errors import ProblemError, require_positive
from ann_dc.progress import Progress, silent

_ode_option = partial(option, rich_help_panel="With --backend ode")
_recurrent_option = partial(option, rich_help_panel="With --backend recurrent")

FormOption = Annotated[
    str,
    typer.Option(
        metavar="FORM",
        help="Equations: corrected, printed (as in the paper), or one erratum, S1 to S17.",
        autocompletion=completing(lambda: _forms()),
    ),
]


@dataclass(frozen=True, kw_only=True)
class StartOptions:
    """Initial guess of the neurons."""

    initial_guess: str = option(
        "Initial neurons: line (from q_0 to q_d), zero or random.",
        default="line",
        metavar="WORD",
        autocompletion=completing(lambda: ("line", "zero", "random")),
    )
    seed: int = option("Seed of random initial guesses and of --range.", default=0, min=0)
    starts: int | None = option(
        "Solve from COUNT random initial guesses in one recurrent batch and list the optima; "
        "files contain the best one.",
        min=1,
        metavar="COUNT",
    )


def method_option(**look: Any) -> Any:
    """Return the option --method, for `RunOptions` and for runs of the ODE alone."""
    text = "Integrator: compiled, or RK23, RK45, DOP853, Radau, BDF or LSODA of SciPy."
    return option(text, metavar="METHOD", show_default="compiled", **look)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a single backend; None for an option that was not given."""

    method: str | None = method_option(rich_help_panel="With --backend ode")
    verify: bool | None = _ode_option(
        "Repeat the run with 100 times smaller tolerances and compare.",
        "--verify/--no-verify",
        show_default="verify",
    )
    max_settling: float | None = _ode_option(
        "Maximum network time of the run (tau_min, the fastest time constant).",
        metavar="T",
        show_default="20000",
    )
    order: str | None = _recurrent_option(
        "Update order of the neurons: simultaneous, two-phase (duals after primals) or "
        "stage-by-stage.",
        metavar="ORDER",
        autocompletion=completing(lambda: ("simultaneous", "two-phase", "stage-by-stage")),
        show_default="simultaneous",
    )
    step: str | None = _recurrent_option(
        "Step size (unit time constants), or adaptive.",
        metavar="H",
        show_default="adaptive",
    )
    accelerate: bool = _recurrent_option(
        "Use Anderson acceleration with a memory of 20 steps; needs torch.",
        "--accelerate",
        default=False,
    )
    max_steps: int | None = _recurrent_option(
        "Maximum number of steps.", metavar="COUNT", show_default="50000", min=1
    )

    def given(self) -> dict[str, Any]:
        """Return the options that were given."""
        return {
            name: value
            for name, value in asdict(self).items()
            if value is not None and (name, value) != ("accelerate", False)
        }


BACKENDS = {
    "ode": ("method", "verify", "max_settling"),
    "recurrent": ("order", "step", "accelerate", "max_steps"),
}
"""Backends with the options that are specific to each."""


def _forms() -> list[str]:
    from ann_dc.decomposition.form import FORMS

    return [*FORMS]


def form_of(word: str):
    """Return the form of the equations that --form names."""
    from ann_dc.decomposition.form import FORMS

    return named("--form", word, FORMS)


def start_of(options: StartOptions):
    """Return the function for the initial guess that --initial-guess and --seed describe."""
    from ann_dc.problem.initial_guess import interpolated_guess, random_guess, zero_guess

    kinds = {
        "line": interpolated_guess,
        "zero": zero_guess,
        "random": partial(random_guess, rng=options.seed),
    }
    return named("--initial-guess", options.initial_guess, kinds)


def backend_of(word: str, options: RunOptions, *, progress: Progress = silent):
    """Return the backend that --backend and its options describe.

    The result is an `OdeBackend` or a `RecurrentBackend`. Raises `ProblemError` for an option of
    another backend and for a maximum that is not a positive number.
    """
    backend = named("--backend", word, {name: name for name in BACKENDS})
    given = options.given()
    for name, value in given.items():
        if name not in BACKENDS[backend]:
            option = f"--no-{name}" if value is False else f"--{name.replace('_', '-')}"
            home = next(other for other, names in BACKENDS.items() if name in names)
            raise ProblemError(
                f"{option}: belongs to --backend {home}, got --backend {backend}; omit it, or "
                f"add --backend {home}"
            )
    build = {"ode": _ode, "recurrent": _recurrent}[backend]
    return build(progress=progress, **given)


def objective_of(word: str, options: RunOptions):
    """Return the objective of a refinement: settling time, or steps of the order."""
    from ann_dc.analysis.objectives import SETTLING_TIME, STEPS, TWO_PHASE_STEPS

    if word.lower() != "recurrent":
        return SETTLING_TIME
    return TWO_PHASE_STEPS if (options.order or "").lower() == "two-phase" else STEPS


def _ode(*, method: str | None = None, max_settling: float | None = None, **settings: Any):
    from ann_dc.backends.ode import METHODS, OdeBackend

    if max_settling is not None:
        require_positive(ProblemError, **{"--max-settling": max_settling})
        settings["limit"] = max_settling
    if method is not None:
        settings["method"] = named("--method", method, METHODS)
    return OdeBackend(**settings)


def _recurrent(
    *,
    order: str | None = None,
    step: str | None = None,
    accelerate: bool = False,
    max_steps: int | None = None,
    **settings: Any,
):
    length = _step_length(step or "adaptive")
    if max_steps is not None:
        settings["limit"] = max_steps
    from ann_dc.backends.recurrent.backend import RecurrentBackend
    from ann_dc.backends.step_rules import ORDERS, Anderson, FixedStep

    if order is not None:
        settings["order"] = named("--order", order.replace(" ", "-"), ORDERS)
    if length is not None:
        settings["step"] = FixedStep(step=length)
    if accelerate:
        settings["acceleration"] = Anderson()
    with needing_torch("--accelerate"):
        return RecurrentBackend(**settings)


def _step_length(word: str) -> float | None:
    """Return the network time of a fixed step; None for adaptive steps.

    Raises `ProblemError` for other text.
    """
    if word.lower() == "adaptive":
        return None
    with contextlib.suppress(ValueError):
        if 0 < float(word) < math.inf:
            return float(word)
    raise ProblemError(
        f"--step: expected a positive number (of unit time constants) or adaptive, got {word!r}"
    )


SHARPER = 0.01
"""Tolerance of the lower level's net input, as a fraction of the larger relative residual
tolerance.
"""


def lower_of(word: str | None, tolerance: float):
    """Return the lower level that --lower names, more accurate than the upper level.

    None selects the lower level that suits the coordinator.
    """
    from ann_dc.two_level.lower_level import Closed, Iterated

    if word is None:
        return None
    kind = named("--lower", word, {"closed": Closed, "iterated": Iterated})
    return kind(tolerance=min(kind().tolerance, SHARPER * tolerance))


@contextlib.contextmanager
def needing_torch(word: str) -> Iterator[None]:
    """Raise a `ProblemError` that names the option if torch is not installed."""
    try:
        yield
    except ImportError as error:
        raise ProblemError(f"{word}: {error}") from error
