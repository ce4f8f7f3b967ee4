"""The whole way on one page: problem, stage equations, network, gains, run, certificate.

The rooms below have one verb for one type each: decompose(problem), synthesize(equations),
design(network), run(network). Here the way may be entered with a problem at any of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, overload

from ann_dc.analysis.objectives import Objective
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.run import Backend, within
from ann_dc.decomposition.equations import StageEquations, decompose
from ann_dc.decomposition.form import CORRECTED, Form
from ann_dc.decomposition.idle import held
from ann_dc.errors import DesignError, FormError
from ann_dc.families.family import Over
from ann_dc.families.family_design import FamilyDesign, design_family
from ann_dc.gain_design import procedure
from ann_dc.gain_design.gain_rule import Recipe
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.knowledge import NOTHING
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.scheduled_run import LONGEST_RUN
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kind
from ann_dc.optimality.existence import Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import Start
from ann_dc.problem.scales import Scales
from ann_dc.progress import Deadline, Progress, silent
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.solution.running import solution_of
from ann_dc.solution.solution import Solution
from ann_dc.synthesis import synthesis
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain, continuous
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, NotEmpty, NotNegative, Own, Positive

OF_DESIGN = 0.7
"""Share of the seconds of a limit that a design may take; the run of its network has the rest."""


@checked
def solve(
    problem: OptimalControlProblem,
    *,
    form: Form = CORRECTED,
    start: Start | None = None,
    gains: Gains | Design | None = None,
    kinds: Annotated[Iterable[Kind], NotEmpty()] | None = None,
    backend: Backend | None = None,
    limit: Positive | None = None,
    progress: Progress = silent,
) -> Solution:
    """Let an analog neural network solve an optimal-control problem, and certify what it says.

    Parameters
    ----------
    problem : OptimalControlProblem
    form : Form
        `CORRECTED`, `PRINTED`, or a `switch` of the printed form. A printed form runs with the
        gains that are designed for the corrected one.
    start : Start, optional
        Where the network starts; the straight line from q_0 to q_d by default.
    gains : Gains or Design, optional
        Given by hand (`hand_gains`), or a `design` with a recipe of its own or a refinement;
        designed by default.
    kinds : iterable of Kind, optional
        The metrics among which the design chooses; those that suit the backend by default.
    backend : Backend, optional
        `OdeBackend` by default; `RecurrentBackend` for recurrent steps.
    limit : float, optional
        Seconds after which what is there is returned, with a status that says so; so it is at a
        first Ctrl-C.
    progress : Progress
        Takes one line at a time on what is going on; it may end the work by raising `Stopped`.

    Returns
    -------
    Solution
        Whatever the outcome: a run that does not settle says so in ``solution.status``, and so do
        a target that no controls reach and a cost without a minimum. Inequalities that contradict
        each other are no outcome of their own: the run stalls.

    Raises
    ------
    ProblemError
        If the map, the cost or an inequality has no finite value or slope at the start.
    FormError
        If a switch of the form has no meaning for this problem, or S16 comes with gains by hand.
    SynthesisError
        If the problem has a function that no block computes.
    DesignError
        If the design's numbers overflow.

    References
    ----------
    Paper equations (11)-(17), corrected unless ``form`` says otherwise.

    Examples
    --------
    >>> from ann_dc import plants
    >>> solution = solve(plants.double_integrator(N=5))
    >>> solution.status.settled, solution.kkt_residual < 1e-8
    (True, True)
    >>> solution["x"][2:].round(3).tolist()
    [0.2, 0.5, 0.8, 1.0]
    """
    problem = held(problem)
    equations = decompose(problem, form)
    network = synthesize(equations, start=start)
    backend = backend or OdeBackend(progress=progress)
    ode = continuous(backend) if form.oracle_gain else None
    with Deadline(progress, float("inf") if limit is None else limit) as deadline:
        prospect = Prospect(problem=problem, progress=deadline)
        if gains is None:
            lender = form.designable
            lent = (
                network if form == lender else synthesize(decompose(problem, lender), start=start)
            )
            gains = procedure.design(
                lent,
                kinds=backend.kinds if kinds is None else kinds,
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
                    "S16: the gain (33) needs the solution, which only a design knows; leave "
                    "gains= out"
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
    start: Start | None = None,
    rho: NotNegative = 1.0,
) -> Network:
    """Wire a problem, or its stage equations in any form, as a network.

    Parameters
    ----------
    source : OptimalControlProblem or StageEquations
        A problem is decomposed in the corrected form first.
    scales : Scales, optional
        Of states, controls and cost; `scales_of` the problem by default.
    start : Start, optional
        Initial values in the user's units; the straight line by default.
    rho : float
        Of every PI dual's proportional path, zero for the plain Lagrangian.

    Returns
    -------
    Network
        Unit time constants, and no other metric.

    Raises
    ------
    SynthesisError
        If the problem has a function that no block computes.
    ProblemError
        If the map, the cost or an inequality has no finite value or slope at the start.

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
    return synthesis.synthesize(equations, scales=scales, start=start, rho=rho)


@overload
def design(
    source: OptimalControlProblem | Network,
    *,
    over: None = None,
    kinds: Iterable[Kind] = ...,
    recipe: Recipe | None = ...,
    refine: Objective | None = ...,
    limit: int = ...,
    progress: Progress = ...,
) -> Design: ...


@overload
def design(
    source: OptimalControlProblem,
    *,
    over: Over,
    kinds: Iterable[Kind] = ...,
    progress: Progress = ...,
) -> FamilyDesign: ...


@checked
def design(
    source: OptimalControlProblem | Network,
    *,
    over: Annotated[Over, Own()] | None = None,
    kinds: Iterable[Kind] = ALL_KINDS,
    recipe: Recipe | None = None,
    refine: Objective | None = None,
    limit: Count = LONGEST_RUN,
    progress: Progress = silent,
) -> Design | FamilyDesign:
    """Choose rho, time constants and metric of a problem's network, or of a network.

    Parameters
    ----------
    source : OptimalControlProblem or Network
        A problem is synthesized first.
    over : mapping, sequence of mappings, or callable, optional
        A family of inputs for which the network is to work: ranges such as {"q_d.x": (3, 7)}, a
        list of samples, or a function that draws them (`family_of`). Needs a problem, and the
        recipes that it compares itself.
    kinds : iterable of Kind
        The metrics among which to choose; all by default.
    recipe : Recipe, optional
        Fixes the closed form's factors and the kind of metric; the best of those known by default.
    refine : Objective, optional
        Refine all gains afterwards, along the gradients of the eigenvalues: `SETTLING_TIME` for
        continuous time, `STEPS` or `TWO_PHASE_STEPS` for recurrent steps; some 20 seconds.
    limit : int
        Largest number of steps of the first run.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    Design, or FamilyDesign with ``over``

    Raises
    ------
    DesignError
        If the network has no PI duals, or its numbers overflow; with ``over``, if it comes with a
        recipe or a refinement, or no input leads to a settled point.
    ProblemError
        If a range of ``over`` is empty, or a sample holds a value that is no number.
    UnknownNameError
        If ``over`` names an input that the network does not have.

    Examples
    --------
    >>> from ann_dc import plants
    >>> design(plants.double_integrator(N=5)).settled
    True
    """
    if over is not None:
        if not (isinstance(source, OptimalControlProblem) and recipe is None and refine is None):
            raise DesignError(
                "over: a family needs the problem itself, whose optima it certifies, and neither "
                "recipe= nor refine="
            )
        source = held(source, any_start=True)
        return design_family(source, over, kinds=kinds, progress=progress)
    if isinstance(source, Network):
        network, knowledge = source, NOTHING
    else:
        problem = held(source)
        network = synthesize(problem)
        knowledge = knowledge_of(Prospect(problem=problem, progress=progress), network)
    return procedure.design(
        network,
        kinds=kinds,
        recipe=recipe,
        refine=refine,
        limit=limit,
        progress=progress,
        knowledge=knowledge,
    )
