"""Run of a designed network and its solution: settled, or known from the design."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends import status
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.run import Backend, Run
from ann_dc.backends.settling import Settling, settling_time
from ann_dc.backends.status import EXPLANATIONS, Outcome, Status
from ann_dc.decomposition.equations import StageEquations
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.gain_design.choice import DEARER
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import Design
from ann_dc.network.network import Network
from ann_dc.optimality.boundedness import Unbounded
from ann_dc.optimality.certificate import LARGEST_STEP, Certificate
from ann_dc.optimality.existence import Hopeless, Prospect
from ann_dc.optimality.feasibility import Infeasible
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Stopped
from ann_dc.solution.knowledge import path_of
from ann_dc.solution.solution import Solution, certificate_of
from ann_dc.timing import phase

CLOSER = 0.3
"""Fraction of the allowed Newton step at which a continued run is to end."""
STAY = 1.0
"""Smallest ratio of a stalled run's time within the tolerance to the time before."""


def solution_of(
    problem: OptimalControlProblem,
    equations: StageEquations,
    network: Network,
    designed: Design | None,
    backend: Backend,
    prospect: Prospect,
) -> Solution:
    """Run a network with the best gains of its design and certify the solution.

    If the run does not settle, or settles at an optimum that costs more than that of the design,
    networks with the next best gains and presets are run. The cheapest certified solution is
    returned. If none settles, the optimum known from the design is returned. `prospect` gives the
    reason of a failed run.
    """
    found = _solution(problem, equations, network, designed, backend)
    is_studied = equations.form != equations.form.designable  # its own start and run are the answer
    if designed is None or is_studied or _is_of_backend(found, designed):
        return _explained(found, prospect)
    dearest = _dearest(problem, designed)
    others = designed.alternatives() if designed.settled else iter(())
    answers = [found]
    while answers[-1].status.outcome is not Outcome.STOPPED:
        if answers[-1].certified and answers[-1].objective <= dearest:
            return answers[-1]
        if (other := next(others, None)) is None:
            break
        answers.append(_solution(problem, equations, other.network, other, backend))
    certified = [answer for answer in answers if answer.certified]
    if certified:
        return min(certified, key=lambda answer: answer.objective)
    return _known(found) or _explained(found, prospect)


def _dearest(problem: OptimalControlProblem, designed: Design) -> float:
    """Return the largest objective accepted as equal to or better than the design's."""
    if not designed.settled:
        return float("inf")
    aim = certificate_of(problem, designed.network, designed.state).objective
    return aim + DEARER * abs(aim)


def _is_of_backend(found: Solution, designed: Design) -> bool:
    """Return True if a run failed by the limit or the step of its backend.

    The trial run of the same gains settled, in more time or with shorter steps.
    """
    settled, outcome = designed.best.settling, found.status.outcome
    elapsed = found.status.time * designed.spectrum.radius
    was_short = outcome is Outcome.NOT_SETTLED and elapsed < settled
    return settled < np.inf and (was_short or outcome is Outcome.DIVERGED)


def _solution(
    problem: OptimalControlProblem,
    equations: StageEquations,
    network: Network,
    designed: Design | None,
    backend: Backend,
) -> Solution:
    run = _run(backend, network, designed)
    found = Solution(
        problem=problem,
        equations=equations,
        network=network,
        run=run,
        certificate=certificate_of(problem, network, run.trajectory.final),
        design=designed,
    )
    return _stayed(_closer(found, backend), backend)


def _stayed(found: Solution, backend: Backend) -> Solution:
    """Return a stalled run as settled if it stayed within the tolerance, certified.

    If penalties are large relative to the multipliers, rounding errors prevent the residual from
    falling to the fraction of the tolerance at which a run ends. The certificate is that of the
    equilibrium found by a Newton step.
    """
    settling, run = getattr(backend, "settling", None), found.run
    is_stalled = found.status.outcome is Outcome.STALLED
    if not (is_stalled and isinstance(settling, Settling)):
        return found
    time = settling_time(run.trajectory, settling)
    if not (1.0 + STAY) * time <= found.status.time:
        return found
    certificate = _proof_beside(found)
    if certificate is None:
        return found
    reported = status.settled(float(run.trajectory.kkt[-1]), found.status.time)
    why = "the residual stayed below the tolerance; rounding limits its further decrease"
    settled = replace(run, status=reported, settling_time=time, verified=why)
    return replace(found, run=settled, certificate=certificate)


def _proof_beside(found: Solution) -> Certificate | None:
    """Return the certificate of the minimum one Newton step from the end of a run."""
    network, final = found.network, found.trajectory.final
    if not found.certificate.newton_step < LARGEST_STEP:
        return None
    try:
        certificate = certificate_of(found.problem, network, equilibrium(network, final))
    except NetworkError:
        return None
    return certificate if certificate.certified else None


def _closer(found: Solution, backend: Backend) -> Solution:
    """Return the solution of a longer run if a run settled too far from its minimum.

    If the cost is flat, a small residual leaves a large Newton step. The settling time is
    unchanged, since it is the last exit from the tolerance.
    """
    certificate, settling = found.certificate, getattr(backend, "settling", None)
    is_far = (
        certificate.first_order
        and certificate.second_order
        and LARGEST_STEP <= certificate.newton_step < 1.0
    )
    if not (found.status.settled and is_far and isinstance(settling, Settling)):
        return found
    confirm = settling.confirm * LARGEST_STEP / certificate.newton_step * CLOSER
    record: Any = backend
    longer = replace(record, settling=replace(settling, confirm=confirm))
    run = _run(longer, found.network, found.design)
    certificate = certificate_of(found.problem, found.network, run.trajectory.final)
    return replace(found, run=run, certificate=certificate) if certificate.certified else found


@phase("run")
def _run(backend: Backend, network: Network, designed: Design | None) -> Run:
    """Run a network with fixed gains, or record the state at which its design ended."""
    try:
        if designed is not None and designed.first.ended is not None:
            raise designed.first.ended
        return backend.run(network)
    except Stopped as end:
        x = network.start_state if designed is None else designed.state
        if isinstance(end, Hopeless):
            return _recorded(network, x, _hopeless(end.found, 0.0))
        residuals = fast_evaluator(network).residuals(x)
        return _recorded(network, x, status.stopped(residuals, 0.0, str(end)))


def _recorded(network: Network, x: np.ndarray, reported: Status) -> Run:
    recorder = Recorder(network)
    recorder.record(0.0, x, fast_evaluator(network).residuals(x))
    return recorder.run(0.0, x, reported, Settling(), 0)


def _known(failed: Solution) -> Solution | None:
    """Return the optimum known from the design of a network that failed, or None."""
    design = failed.design
    if design is None or not design.settled:
        return None
    plain = apply_gains(failed.network, manual_gains(failed.network))
    for network in (failed.network, plain):  # large penalties leave rounding errors
        try:
            state = equilibrium(network, design.state)  # a first run leaves 1e-8 of a residual
        except NetworkError:
            state = design.state
        certificate = certificate_of(failed.problem, network, state)
        if certificate.certified:
            reported = found_without(
                design.first.found_by or "the gain-scheduled run", failed.status
            )
            run = _recorded(network, state, reported)
            return replace(failed, run=run, certificate=certificate)
    return None


def found_without(by: str, network: Status) -> Status:
    """Return the status of a known optimum at which no network settled.

    `by` names the method that found the optimum, and `network` is the final status of the run.
    """
    if network.outcome is Outcome.STOPPED:
        return replace(network, message=f"{network.message}; the optimum was found by {by}")
    why = f"no network with constant gains settled there ({network.message})"
    message = f"found by {by}; {why}; {EXPLANATIONS[Outcome.FOUND].next_step}"
    return Status(outcome=Outcome.FOUND, message=message, neuron=None, time=network.time)


def _hopeless(found: Infeasible | Unbounded, now: float) -> Status:
    tell = status.infeasible if isinstance(found, Infeasible) else status.unbounded
    return tell(found.message, now)


def _explained(solution: Solution, prospect: Prospect) -> Solution:
    """Return a failed solution with the reason, if the problem is the reason."""
    known = (Outcome.STOPPED, Outcome.INFEASIBLE, Outcome.UNBOUNDED)
    minimum = solution.status.settled and solution.certificate.second_order
    if solution.certified or minimum or solution.status.outcome in known:
        return solution
    try:
        found = prospect.look(*path_of(solution.network, solution.trajectory.final))
    except Stopped:
        return solution
    if found is None:
        return solution
    reported = _hopeless(found, solution.status.time)
    run = replace(solution.run, status=reported, settling_time=float("nan"))
    return replace(solution, run=run)
