"""End-to-end solution of an optimal-control problem, and its single steps.

The steps are decomposition, synthesis, gain design, run and certificate. The packages below provide
one function per step and type: decompose(problem), synthesize(equations), design(network),
run(network). The functions here also accept a problem at each of these steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any, TypeVar, overload

from ann_dc.analysis.objectives import Objective
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.run import Backend, reporting, within
from ann_dc.conversion import declare_words
from ann_dc.decomposition.equations import StageEquations, decompose
from ann_dc.decomposition.form import CORRECTED, Form
from ann_dc.decomposition.idle import held
from ann_dc.errors import ArgumentTypeError, DesignError, FormError
from ann_dc.families.family import Over
from ann_dc.families.family_design import FamilyDesign, design_family
from ann_dc.gain_design import procedure
from ann_dc.gain_design.gain_rule import GainRule
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.knowledge import NOTHING
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.scheduled_run import LONGEST_RUN
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kinds
from ann_dc.optimality.existence import Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import Guess
from ann_dc.problem.scales import Scales
from ann_dc.progress import Deadline, Progress, silent
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.solution.running import solution_of
from ann_dc.solution.solution import Solution
from ann_dc.synthesis import synthesis
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain, continuous
from ann_dc.validation import Count, NotEmpty, NotNegative, Own, Positive, checked

Function = TypeVar("Function", bound=Callable[..., Any])


def _recurrent() -> Backend:
    from ann_dc.backends.recurrent.backend import RecurrentBackend

    return RecurrentBackend()


BACKENDS: dict[str, Callable[[], Backend]] = {"ode": OdeBackend, "recurrent": _recurrent}
"""Backends with their default settings, by name; loaded at the first use."""
declare_words(Backend, BACKENDS, lambda make: make())

OF_DESIGN = 0.7
"""Fraction of a time limit that the design may take; the rest is for the run of its network."""


def _renamed_keyword(old: str, new: str) -> Callable[[Function], Function]:
    """Return a decorator that also accepts the former name of a keyword, with a warning.

    A call with both names raises `ArgumentTypeError`.
    """

    def decorated(function: Callable[..., Any]) -> Any:
        @wraps(function)
        def with_former_name(*args: Any, **kwargs: Any) -> Any:
            if old in kwargs:
                if new in kwargs:
                    raise ArgumentTypeError(f"{old}: expected {new} alone, got both; omit {old}")
                warnings.warn(f"{old}: former name; use {new}", DeprecationWarning, stacklevel=2)
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return with_former_name

    return decorated


@_renamed_keyword("limit", "time_limit")
@checked
def solve(
    problem: OptimalControlProblem,
    *,
    form: Form | str = CORRECTED,
    initial_guess: Guess | None = None,
    gains: Gains | Design | None = None,
    preconditioner: Annotated[Kinds, NotEmpty()] | None = None,
    backend: Backend | str | None = None,
    time_limit: Positive | None = None,
    progress: Progress = silent,
) -> Solution:
    """Solve an optimal-control problem with an analog neural network and certify it.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.
    form : Form or str
        Form or its name ("printed", "S8"): `CORRECTED` (default), `PRINTED`, or a `switch`
        of the printed form. A printed form runs with the gains designed for the corrected form.
    initial_guess : InitialGuess, callable or str, optional
        Initial guess, a function of the problem such as `zero_guess`, or one of "line", "zero" and
        "random". Default: the straight line from q_0 to q_d.
    gains : Gains or Design, optional
        Manual gains (`manual_gains`), or a `design` with another gain rule or a refinement.
        Default: designed gains.
    preconditioner : PreconditionerKind, str, or iterable of these, optional
        Preconditioner kinds from which the design chooses, or their names ("multilevel").
        Default: those that suit the backend.
    backend : Backend or str, optional
        Default: `OdeBackend`; `RecurrentBackend`, or "recurrent", for recurrent steps.
    time_limit : float, optional
        Wall-clock limit in seconds. On expiry or at a first Ctrl-C the current state is returned
        with a corresponding status. Default: no limit.
    progress : Progress
        Receives one line per step; it may end the work by raising `Stopped`. Default: silent.

    Returns
    -------
    Solution
        Returned for every outcome; check ``solution.status``. An unreachable target or
        contradictory inequalities end as ``INFEASIBLE``, a cost without a minimum as
        ``UNBOUNDED``. A contradiction that the feasibility check does not find ends as
        ``STALLED`` or ``NOT_SETTLED``.

    Raises
    ------
    ProblemError
        If the dynamics, the cost or an inequality is not finite at the initial guess, or has no
        finite slope there.
    FormError
        If a switch of the form does not apply to this problem, or S16 is used with manual gains.
    UnknownNameError
        If a word for a form, kind, guess or backend is unknown; the message lists the known ones.
    SynthesisError
        If the problem has a function without a block.
    DesignError
        If numbers of the design overflow.

    References
    ----------
    Paper equations (11)-(17), corrected unless ``form`` selects another form.

    Examples
    --------
    >>> from ann_dc import plants
    >>> solution = solve(plants.double_integrator(N=5))
    >>> solution.status.settled, solution.kkt_residual < 1e-8
    (True, True)
    >>> solution["x"][2:].round(3).tolist()
    [0.2, 0.5, 0.8, 1.0]
    """
    assert isinstance(form, Form)
    assert not isinstance(backend, str)
    problem = held(problem)
    equations = decompose(problem, form)
    network = synthesize(equations, initial_guess=initial_guess)
    backend = reporting(backend or OdeBackend(), progress)
    ode = continuous(backend) if form.oracle_gain else None
    with Deadline(progress, float("inf") if time_limit is None else time_limit) as deadline:
        prospect = Prospect(problem=problem, progress=deadline)
        if gains is None:
            lender = form.designable
            lent = (
                network
                if form == lender
                else synthesize(decompose(problem, lender), initial_guess=initial_guess)
            )
            gains = procedure.design(
                lent,
                preconditioner=backend.kinds if preconditioner is None else preconditioner,
                progress=deadline.early(OF_DESIGN),
                knowledge=knowledge_of(prospect, lent),
            )
        designed = gains if isinstance(gains, Design) else None
        frozen = apply_gains(network, gains.gains if isinstance(gains, Design) else gains)
        if designed is not None and designed.start and form == form.designable:
            frozen = frozen.with_start(designed.network.start_state)
        if ode is not None:
            if designed is None:
                raise FormError(
                    "S16: the gain (33) needs the solution, which only a design provides; omit "
                    "gains="
                )
            backend = OracleBackend(ode=ode, gain=OracleGain(settled=designed.state, low=1e-3))
        return solution_of(
            problem, equations, frozen, designed, within(backend, deadline), prospect
        )


@checked
def synthesize(
    source: OptimalControlProblem | StageEquations,
    *,
    scales: Scales | None = None,
    initial_guess: Guess | None = None,
    rho: NotNegative = 1.0,
) -> Network:
    """Synthesize a network from a problem, or from its stage equations in any form.

    Parameters
    ----------
    source : OptimalControlProblem or StageEquations
        A problem is decomposed in the corrected form first.
    scales : Scales, optional
        Scales of states, controls and cost. Default: `scales_of` the problem.
    initial_guess : InitialGuess, callable or str, optional
        Initial guess in the user's units, a function of the problem, or its word. Default: the
        straight line.
    rho : float
        Proportional gain of every PI multiplier neuron; zero gives the plain Lagrangian. Default 1.

    Returns
    -------
    Network
        Network with unit time constants and a diagonal preconditioner.

    Raises
    ------
    SynthesisError
        If the problem has a function without a block.
    ProblemError
        If the dynamics, the cost or an inequality is not finite at the initial guess, or has no
        finite slope there.

    References
    ----------
    Paper equations (11)-(17).

    Examples
    --------
    >>> from ann_dc import plants
    >>> synthesize(plants.double_integrator(N=5)).size
    39
    """
    equations = source if isinstance(source, StageEquations) else decompose(source)
    return synthesis.synthesize(equations, scales=scales, initial_guess=initial_guess, rho=rho)


@overload
def design(
    source: OptimalControlProblem | Network,
    *,
    ranges: None = None,
    preconditioner: Kinds = ...,
    gain_rule: GainRule | None = ...,
    refine: Objective | None = ...,
    limit: int = ...,
    progress: Progress = ...,
) -> Design: ...


@overload
def design(
    source: OptimalControlProblem,
    *,
    ranges: Over,
    preconditioner: Kinds = ...,
    progress: Progress = ...,
) -> FamilyDesign: ...


@checked
def design(
    source: OptimalControlProblem | Network,
    *,
    ranges: Annotated[Over, Own()] | None = None,
    preconditioner: Kinds = ALL_KINDS,
    gain_rule: GainRule | None = None,
    refine: Objective | None = None,
    limit: Count = LONGEST_RUN,
    progress: Progress = silent,
) -> Design | FamilyDesign:
    """Design rho, time constants and preconditioner of a network.

    Parameters
    ----------
    source : OptimalControlProblem or Network
        A problem is synthesized first.
    ranges : mapping, sequence of mappings, or callable, optional
        Operating range of the network: ranges such as {"q_d.x": (3, 7)}, a list of samples, or a
        function that draws samples (`family_of`). It requires a problem and gain rules that the
        function compares itself.
    preconditioner : PreconditionerKind, str, or iterable of these
        Preconditioner kinds from which to choose, or their names. Default: all.
    gain_rule : GainRule, optional
        Gain rule that fixes the closed-form factors and the preconditioner kind. Default: the best
        of the known rules.
    refine : Objective, optional
        Refinement of all gains along the gradients of the eigenvalues; some 20 seconds.
        `SETTLING_TIME` is for continuous time, `STEPS` or `TWO_PHASE_STEPS` for recurrent steps.
        Default: none.
    limit : int
        Largest number of steps of the gain-scheduled run. Default: `LONGEST_RUN`.
    progress : Progress
        Receives one line per step. Default: silent.

    Returns
    -------
    Design or FamilyDesign
        `FamilyDesign` if ``ranges`` is given.

    Raises
    ------
    DesignError
        If the network has no PI multiplier neurons, or its numbers overflow. With ``ranges``, also
        if a recipe or refinement is given, or if no input leads to a settled point.
    ProblemError
        If a range of ``ranges`` is empty, or a sample has a value that is not a number.
    UnknownNameError
        If ``ranges`` names an input that the network does not have.

    Examples
    --------
    >>> from ann_dc import plants
    >>> design(plants.double_integrator(N=5)).settled
    True
    """
    if ranges is not None:
        if not (isinstance(source, OptimalControlProblem) and gain_rule is None and refine is None):
            raise DesignError(
                "ranges: a design over a range needs a problem, and neither gain_rule= nor refine="
            )
        source = held(source, any_start=True)
        return design_family(source, ranges, preconditioner=preconditioner, progress=progress)
    if isinstance(source, Network):
        network, knowledge = source, NOTHING
    else:
        problem = held(source)
        network = synthesize(problem)
        knowledge = knowledge_of(Prospect(problem=problem, progress=progress), network)
    return procedure.design(
        network,
        preconditioner=preconditioner,
        gain_rule=gain_rule,
        refine=refine,
        limit=limit,
        progress=progress,
        knowledge=knowledge,
    )
