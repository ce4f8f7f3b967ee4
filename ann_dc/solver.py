"""The whole way on one page: problem, stage equations, network, gains, run, certificate."""

from __future__ import annotations

from dataclasses import replace

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.run import Backend
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, Form
from ann_dc.errors import FormError
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.recipe import Recipe
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import Start
from ann_dc.progress import Progress, silent
from ann_dc.solution import Solution, certificate_of
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.two_level.oracle_gain import OracleBackend, OracleGain, continuous


def solve(
    problem: OptimalControlProblem,
    *,
    form: Form = CORRECTED,
    start: Start | None = None,
    gains: Gains | None = None,
    recipe: Recipe | None = None,
    refine: bool = False,
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
        Given by hand (`hand_gains`); designed by default.
    recipe : Recipe, optional
        Fixes the factors of the closed form.
    refine : bool
        Refine the gains by Nelder-Mead.
    backend : Backend, optional
        `OdeBackend` by default; `RecurrentBackend` for recurrent layers.
    progress : Progress
        Told one line at a time what is going on.

    Returns
    -------
    Solution
        Whatever the outcome: a run that does not settle says so in ``solution.status``.

    Examples
    --------
    >>> from ann_dc import plants
    >>> solution = solve(plants.double_integrator(N=5))
    >>> solution.status.settled, solution.kkt_residual < 1e-8
    (True, True)
    """
    equations = decompose(problem, form)
    network = synthesize(equations, start=start)
    backend = backend or OdeBackend(progress=progress)
    ode = continuous(backend) if form.oracle_gain else None
    designed = None
    if gains is None:
        sound = _sound(form)
        designed = design(
            network if form == sound else synthesize(decompose(problem, sound), start=start),
            recipe=recipe,
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


def _sound(form: Form) -> Form:
    """The corrected form with the same closing of the chain: its gains are lent to ``form``."""
    return replace(
        CORRECTED, start_is_neuron=form.start_is_neuron, terminal_free=form.terminal_free
    )
