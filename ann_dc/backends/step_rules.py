r"""Settings of a recurrent run: update order, step rule and acceleration.

Update orders are Jacobi, primal-then-dual and Gauss-Seidel. Each is a map x -> x + h m(x, h) and
differs in m alone, so that step rules and acceleration work with all of them. They are implemented
in generated code (`backends.batched.orders`) and on tensors (`backends.layers.loop`).

No step rule may use the solution, since a circuit does not have it. A circuit has the drives, and
with them the energy e = sqrt(sum \|d m\|) over net inputs d and moves m.

A rule takes one constant from the network and an estimate of its fastest rate at the start, which
it does not exceed. It defines the numbers by which every step is lengthened or cut. A constraint
pair of primal and dual satisfies s^2 + kappa s + eta kappa = 0 for any kappa <= 1. Here eta = 1 /
(rho tau) of the dual. Forward Euler is stable for h < 1 / eta = rho tau, so the longest step of
`AdaptiveStep` is a fraction of min rho tau. Strong curvature can require shorter steps, which the
energy shows. A step that doubles the energy, or a window without progress, cuts h. After that h
grows only with the progress made, h ~ e^{-earned}, so that the progress made before compensates
every excursion to the stability limit.

The energy of an underdamped mode oscillates while the mode decays: with a frequency omega it may be
omega times as high at one end of an oscillation as at the other. The peaks decrease, one every half
turn of the moves. A rise is therefore measured from the lowest peak of a turn. If a step is too
long for a real mode, moves alternate and a turn is two steps; for a complex pair it is half an
oscillation.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.batched.step_control import StepLengths as StepLengths
from ann_dc.conversion import declare_words
from ann_dc.errors import NetworkError, UnknownNameError, require_positive, such_as
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.validation import checked

NAMES = "simultaneous", "two-phase", "stage by stage"
"""Names of the orders, by their codes in `backends.batched.orders`."""


@such_as("ann_dc.TWO_PHASE")
@dataclass(frozen=True)
class Order:
    """Update order by its name: the move m(x, h) that leads from a state x to x + h m.

    Raises `UnknownNameError` if the name is not one of the three orders.

    Examples
    --------
    >>> import ann_dc
    >>> Order("two-phase") == ann_dc.TWO_PHASE
    True
    """

    name: str

    def __post_init__(self) -> None:
        if self.name not in NAMES:
            raise UnknownNameError.of("order", self.name, NAMES)

    def __repr__(self) -> str:
        return self.name


SIMULTANEOUS = Order("simultaneous")
"""Simultaneous order: all neurons move at once, (16), (17) and forward Euler."""

TWO_PHASE = Order("two-phase")
"""Two-phase order: primal neurons first, then dual neurons on the new residual.

Equal to the simultaneous recurrence with rho + h/tau_dual, on duals that are one step late.
"""

STAGE_BY_STAGE = Order("stage by stage")
"""Stage-by-stage order (Gauss-Seidel): one cell serves the stages in turn, reads the values written
before, and moves with its drive. The preconditioner is applied at the end to the drives of the
sweep.
"""

ORDERS = {
    order.name.replace(" ", "-"): order for order in (SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE)
}
"""Orders by the words of Python, the command line and study files."""
declare_words(Order, ORDERS)


def check_order(order: Order, network: Network) -> None:
    """Raise `NetworkError` for stage-by-stage order with a neuron common to cells."""
    if order == STAGE_BY_STAGE and len(network.shared):
        name = network.cell.neurons[network.shared[0]].name
        raise NetworkError(
            f"order: {name} is shared by all cells and needs the sums of all of them, which "
            "stage-by-stage updates do not have; use SIMULTANEOUS or TWO_PHASE"
        )


@such_as("ann_dc.FixedStep(step=0.1)")
class StepRule(ABC):
    """Rule for h: numbers of the first and all further steps, in code and layers.

    Examples
    --------
    Half as long as the adaptive steps, for any network:

    >>> import ann_dc
    >>> class Careful(StepRule):
    ...     def lengths(self, limit):
    ...         return AdaptiveStep().lengths(limit / 2)
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> ann_dc.RecurrentBackend(step=Careful()).run(network).status.settled
    True
    """

    @abstractmethod
    def lengths(self, limit: float) -> StepLengths:
        """Return the numbers for a network.

        ``limit`` is min rho tau over the network's PI duals, at most two time constants of its
        fastest mode, in units of network time.
        """


class StepLimits:
    """Limits on the step length of a network at its start, in units of network time."""

    def __init__(self, network: Network) -> None:
        self._network = network

    @cached_property
    def stable(self) -> float:
        """Stability limit of the simultaneous order."""
        return stability_limit(self._network, self._network.start_state)

    @cached_property
    def fastest_rate(self) -> float:
        """Estimate of the fastest rate by power iterations, in units of 1 / network time."""
        return fast_evaluator(self._network).fastest_rate(self._network.start_state)

    @cached_property
    def dual(self) -> float:
        """Smallest rho tau of a PI dual, at most two fastest time constants.

        Above h = rho tau a dual integrates faster in a step than its proportional path damps.
        """
        network, limits = self._network, [2.0 / self.fastest_rate]
        edges, tape = evaluator(network).edges, evaluator(network).tape
        for dual in network.cell.duals:
            row = network.neuron_index[dual.neuron]
            live = network.live[row]
            if dual.path in edges and live.any():
                rho, rate = tape.weights[edges[dual.path], live], tape.rates[row, live]
                limits.append(float((rho / rate)[rho > 0].min(initial=limits[0])))
        return min(limits)

    def warn_above(self, step: float) -> None:
        """Warn (`UserWarning`) if a step exceeds the stability limit."""
        if 0 < self.stable < step:
            warnings.warn(
                f"step {step:g} is above the stability limit {self.stable:.3g} of "
                f"{self._network.title} at its start: fast neurons diverge; use a shorter step",
                stacklevel=5,
            )


def lengths_of(rule: StepRule, limits: StepLimits) -> StepLengths:
    """Return the numbers of a step rule; see `StepLimits.warn_above` for a constant step."""
    lengths = rule.lengths(limits.dual)
    if lengths.is_fixed:
        limits.warn_above(lengths.longest)
    return lengths


@checked
@dataclass(frozen=True, kw_only=True)
class FixedStep(StepRule):
    """Constant step length h.

    A warning is issued if h exceeds the stability limit at the network's start (see
    `stability_limit`; the limit at the solution may differ).

    Attributes
    ----------
    step : float
        Step length h in units of network time.

    Raises
    ------
    NetworkError
        If ``step`` is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.analysis import stability_limit
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> h = 0.5 * stability_limit(network, network.start_state)
    >>> backend = ann_dc.RecurrentBackend(step=ann_dc.FixedStep(step=h), limit=100)
    >>> run = backend.run(network)
    >>> bool(abs(run.status.time - 100 * h) < 1e-9)  # network time is steps times h
    True

    References
    ----------
    Paper equations (16), (17): lambda = h / tau.
    """

    step: float

    def __post_init__(self) -> None:
        require_positive(step=self.step)

    def lengths(self, limit: float) -> StepLengths:
        """Return the constant step, whatever the limit."""
        return StepLengths.always(self.step)


@checked
@dataclass(frozen=True, kw_only=True)
class AdaptiveStep(StepRule):
    """Step rule that enlarges the step with progress; it does not need the solution.

    Attributes
    ----------
    share : float, default 0.6
        Longest step as a fraction of min rho tau over the duals, see `StepLimits.dual`.
    first : float, default 0.15
        First step as a fraction of the same limit.
    growth : float, default 1.03
        Factor per step until the first cut.
    cut : float, default 0.6
        Factor if the energy rises or a window brings no progress.
    rise : float, default 2.0
        Rise of the energy that causes a cut, relative to the lowest peak of a turn since the last
        cut.
    earned : float, default 0.05
        Power of the progress by which h grows after the first cut.
    window : int, default 200
        Number of steps after which progress is checked; an idle window lengthens the next ones.
    progress : float, default 0.9
        Fraction of the lowest energy at the start of a window; the window is idle if its lowest
        energy exceeds this fraction.
    least : float, default 1e-3
        Shortest step as a fraction of the longest; a flow that grows at this step diverges.
    turn : float, default 2.0
        Length of a turn: the sum of sin(angle / 2) between successive moves. It is pi/2 for half a
        turn in many steps, and 1 for a step that the next one takes back.

    Raises
    ------
    NetworkError
        If a field is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> wide, narrow = (
    ...     ann_dc.RecurrentBackend(step=ann_dc.AdaptiveStep(share=share), limit=100)
    ...     for share in (0.6, 0.2)
    ... )
    >>> narrow.run(network).status.time < wide.run(network).status.time  # of 100 steps each
    True
    """

    share: float = 0.6
    first: float = 0.15
    growth: float = 1.03
    cut: float = 0.6
    rise: float = 2.0
    earned: float = 0.05
    window: int = 200
    progress: float = 0.9
    least: float = 1e-3
    turn: float = 2.0

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def lengths(self, limit: float) -> StepLengths:
        """Return step lengths with a short first step, since the start may be rough."""
        return StepLengths(
            first=self.first * limit,
            longest=self.share * limit,
            window=self.window,
            growth=self.growth,
            cut=self.cut,
            rise=self.rise,
            earned=self.earned,
            progress=self.progress,
            least=self.least,
            turn=self.turn,
        )


@such_as("ann_dc.Anderson()")
@checked
@dataclass(frozen=True, kw_only=True)
class Anderson:
    """Safeguarded Anderson acceleration of any update order; it runs on torch.

    Attributes
    ----------
    memory : int, default 20
        Number m of stored differences.
    rise : float, default 1.2
        Factor on the energy above which a step is taken back.
    resume : float, default 0.5
        Fraction of the energy at which acceleration resumes after a cut of h.
    regularisation : float, default 1e-10
        Regularisation of the least-squares problem, relative to the trace of dF' dF.

    Raises
    ------
    NetworkError
        If a field is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> kind = ann_dc.PreconditionerKind.MULTILEVEL
    >>> network = ann_dc.design(problem, preconditioner=kind).network
    >>> for acceleration in (None, ann_dc.Anderson()):
    ...     backend = ann_dc.RecurrentBackend(acceleration=acceleration, limit=150)
    ...     print(backend.run(network).status.settled)
    False
    True

    References
    ----------
    Walker and Ni, SIAM J. Numer. Anal. 49 (2011); the safeguard after Zhang, O'Donoghue and Boyd,
    SIAM J. Optim. 30 (2020).
    """

    memory: int = 20
    rise: float = 1.2
    resume: float = 0.5
    regularisation: float = 1e-10

    def __post_init__(self) -> None:
        require_positive(**vars(self))
