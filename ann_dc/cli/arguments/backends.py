"""Words become objects: what a user types, looked up in a table or read as numbers.

Nothing that is typed is ever evaluated.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ann_dc.cli.arguments.lookup import named
from ann_dc.errors import ProblemError

if TYPE_CHECKING:
    from ann_dc.backends.ode import OdeBackend
    from ann_dc.backends.recurrent.backend import RecurrentBackend
    from ann_dc.decomposition.form import Form
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.problem.start import Start
    from ann_dc.two_level.lower_level import LowerLevel


BACKENDS = {"ode": ("method", "verify"), "recurrent": ("order", "step", "accelerate")}
"""Backends, each with the options that mean something with this one only."""


FormOption = Annotated[
    str,
    typer.Option(
        metavar="FORM",
        help="Equations: corrected, printed (as in the paper), or one slip of it, S1 to S16.",
    ),
]


def form_of(word: str) -> Form:
    """The form of the equations that --form names."""
    from ann_dc.decomposition.form import CORRECTED, PRINTED, SWITCHES

    return named("--form", word, {"corrected": CORRECTED, "printed": PRINTED, **SWITCHES})


def start_of(word: str, seed: int, problem: OptimalControlProblem) -> Start:
    """The start that --start and --seed name."""
    from ann_dc.problem.start import line_start, random_start, zero_start

    kinds: dict[str, Callable[[OptimalControlProblem], Start]] = {
        "line": line_start,
        "zero": zero_start,
        "random": partial(random_start, rng=seed),
    }
    return named("--start", word, kinds)(problem)


def backend_of(
    word: str,
    *,
    limit: float | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> OdeBackend | RecurrentBackend:
    """The backend that --backend and its options describe; None is an option not given."""
    build = named("--backend", word, {"ode": _ode, "recurrent": _recurrent})
    backend = named("--backend", word, {name: name for name in BACKENDS})
    given = {name: value for name, value in options.items() if value is not None}
    for name, value in given.items():
        if name not in BACKENDS[backend]:
            option = f"--no-{name}" if value is False else f"--{name}"
            home = next(other for other, names in BACKENDS.items() if name in names)
            raise ProblemError(
                f"{option}: belongs to --backend {home}, and --backend {backend} runs; leave it "
                f"out, or say --backend {home}"
            )
    if limit is not None:
        if not 0 < limit < math.inf:
            raise ProblemError(f"--limit: expected a positive number, got {limit!r}")
        given["limit"] = limit
    return build(progress=progress, **given)


def _ode(*, method: str | None = None, **settings: Any) -> OdeBackend:
    from ann_dc.backends.ode import METHODS, OdeBackend

    if method is not None:
        settings["method"] = named("--method", method, METHODS)
    return OdeBackend(**settings)


def _recurrent(
    *, order: str | None = None, step: str | None = None, accelerate: bool = False, **settings: Any
) -> RecurrentBackend:
    length = _step_length(step or "adaptive")
    if "limit" in settings:
        settings["limit"] = _whole(settings["limit"])
    with needing_torch("--backend recurrent"):
        from ann_dc.backends.recurrent.acceleration import Anderson
        from ann_dc.backends.recurrent.backend import RecurrentBackend
        from ann_dc.backends.recurrent.orders import ORDERS
        from ann_dc.backends.recurrent.steps import FixedStep

    known = {name.replace(" ", "-"): thing for name, thing in ORDERS.items()}
    if order is not None:
        settings["order"] = named("--order", order.replace(" ", "-"), known)
    if length is not None:
        settings["step"] = FixedStep(step=length)
    if accelerate:
        settings["acceleration"] = Anderson()
    return RecurrentBackend(**settings)


def _step_length(word: str) -> float | None:
    """Network time of a fixed step; None for steps that adapt."""
    if word.lower() == "adaptive":
        return None
    with contextlib.suppress(ValueError):
        if 0 < float(word) < math.inf:
            return float(word)
    raise ProblemError(
        f"--step: expected a positive number (of network time) or adaptive, got {word!r}"
    )


def _whole(limit: float) -> int:
    if not limit.is_integer():
        raise ProblemError(f"--limit: expected a whole number of steps, got {limit!r}")
    return int(limit)


def lower_of(word: str | None, tolerance: float) -> LowerLevel | None:
    """The lower level that --lower names, a little more exact than the upper one has to be.

    None is the one that suits the coordinator.
    """
    from ann_dc.two_level.lower_level import Closed, Iterated

    if word is None:
        return None
    kind = named("--lower", word, {"closed": Closed, "iterated": Iterated})
    return kind(tolerance=min(kind().tolerance, 0.2 * tolerance))


@contextlib.contextmanager
def needing_torch(word: str) -> Iterator[None]:
    """Where torch is not installed, a sentence says what would need it."""
    try:
        yield
    except ImportError as error:
        raise ProblemError(f"{word}: {error}") from error
