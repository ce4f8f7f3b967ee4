"""The whole way on one page: problem, stage equations, network, gains, run, certificate.

The rooms below have one verb for one type each: decompose(problem), synthesize(equations),
design(network), run(network). Here the way may be entered with a problem at any of them.
"""

from __future__ import annotations

from collections.abc import Iterable

from ann_dc.analysis.objectives import Objective
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.run import Backend
from ann_dc.decomposition.equations import StageEquations, decompose
from ann_dc.decomposition.form import CORRECTED, Form
from ann_dc.errors import FormError
from ann_dc.gain_design import procedure
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.rules.gains import Gains, apply_gains
from ann_dc.gain_design.rules.recipe import Recipe
from ann_dc.gain_design.scheduled_run import LONGEST_RUN
from ann_dc.network.metrics.contract import ALL_KINDS, Kind
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import Start
from ann_dc.progress import Progress, silent
from ann_dc.solution import Solution, certificate_of
from ann_dc.synthesis import synthesis
from ann_dc.synthesis.normalisation import Normalisation
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain, continuous


def solve(
    problem: OptimalControlProblem,
    *,
    form: Form = CORRECTED,
    start: Start | None = None,
    gains: Gains | None = None,
    kinds: Iterable[Kind] | None = None,
    refine: Objective | None = None,
    backend: Backend | None = None,
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
    gains : Gains, optional
        Given by hand (`hand_gains`), or from a `design` with a recipe of its own; designed by
        default.
    kinds : iterable of Kind, optional
        The metrics among which the design chooses; those that suit the backend by default.
    refine : Objective, optional
        Refine all gains along the gradients of the eigenvalues: `SETTLING_TIME` for continuous
        time, `STEPS` or `TWO_PHASE_STEPS` for recurrent layers; some 20 seconds.
    backend : Backend, optional
        `OdeBackend` by default; `RecurrentBackend` for recurrent layers.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    Solution
        Whatever the outcome: a run that does not settle says so in ``solution.status``.

    Raises
    ------
    ProblemError
        If the map or the cost has no finite value or slope at the start.
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
    equations = decompose(problem, form)
    network = synthesize(equations, start=start)
    backend = backend or OdeBackend(progress=progress)
    ode = continuous(backend) if form.oracle_gain else None
    designed = None
    if gains is None:
        lender = form.designable
        designed = procedure.design(
            network if form == lender else synthesize(decompose(problem, lender), start=start),
            kinds=backend.kinds if kinds is None else kinds,
            refine=refine,
            progress=progress,
        )
        gains = designed.gains
    frozen = apply_gains(network, gains)
    if ode is not None:
        if designed is None:
            raise FormError(
                "S16: the gain (33) needs the solution, which only a design knows; leave gains= out"
            )
        backend = OracleBackend(ode=ode, gain=OracleGain(settled=designed.state, low=1e-3))
    run = backend.run(frozen)
    return Solution(
        problem=problem,
        equations=equations,
        network=frozen,
        run=run,
        certificate=certificate_of(problem, frozen, run.trajectory.final),
        design=designed,
    )


def synthesize(
    source: OptimalControlProblem | StageEquations,
    *,
    normalisation: Normalisation | None = None,
    start: Start | None = None,
    rho: float = 1.0,
) -> Network:
    """Wire a problem, or its stage equations in any form, as a network.

    Parameters
    ----------
    source : OptimalControlProblem or StageEquations
        A problem is decomposed in the corrected form first.
    normalisation : Normalisation, optional
        Units of controls and objective; chosen for the problem by default.
    start : Start, optional
        Initial values in the user's units; the straight line by default.
    rho : float
        Weight of every PI dual's proportional path, zero for the plain Lagrangian.

    Returns
    -------
    Network
        Unit time constants, and no other metric.

    Raises
    ------
    SynthesisError
        If the problem has a function that no block computes.
    ProblemError
        If the map or the cost has no finite value or slope at the start.

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
    return synthesis.synthesize(equations, normalisation=normalisation, start=start, rho=rho)


def design(
    source: OptimalControlProblem | Network,
    *,
    kinds: Iterable[Kind] = ALL_KINDS,
    recipe: Recipe | None = None,
    refine: Objective | None = None,
    limit: int = LONGEST_RUN,
    progress: Progress = silent,
) -> Design:
    """Choose rho, time constants and metric of a problem's network, or of a network.

    Parameters
    ----------
    source : OptimalControlProblem or Network
        A problem is synthesized first.
    kinds : iterable of Kind
        The metrics among which to choose; all by default.
    recipe : Recipe, optional
        Fixes the closed form's factors and the kind of metric; the best of those known by default.
    refine : Objective, optional
        Refine all gains afterwards, along the gradients of the eigenvalues: `SETTLING_TIME` for
        continuous time, `STEPS` or `TWO_PHASE_STEPS` for recurrent layers; some 20 seconds.
    limit : int
        Largest number of steps of the first run.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        If the network has no PI duals, or its numbers overflow.

    Examples
    --------
    >>> from ann_dc import plants
    >>> design(plants.double_integrator(N=5)).settled
    True
    """
    network = source if isinstance(source, Network) else synthesize(source)
    return procedure.design(
        network, kinds=kinds, recipe=recipe, refine=refine, limit=limit, progress=progress
    )
