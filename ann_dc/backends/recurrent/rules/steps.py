r"""Step rules: a fixed step length, or one that adapts to progress.

No rule may use the solution, since a circuit does not have it. A circuit has the drives, and with
them the energy e = sqrt(sum \|d m\|) over net inputs d and moves m.

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

from abc import ABC, abstractmethod
from dataclasses import dataclass

from ann_dc.backends.lanes.recurrence import StepLengths as StepLengths
from ann_dc.errors import require_positive, such_as
from ann_dc.network.network import Network
from ann_dc.validation import checked


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


def above_limit(step: float, limit: float, network: Network) -> str:
    """Return the warning about a step above the stability limit at a network's start."""
    return (
        f"step {step:g} is above the stability limit {limit:.3g} of {network.title} at its start: "
        "fast neurons grow from step to step; take a shorter one"
    )


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
        Longest step as a fraction of `dual_limit`: min rho tau over the duals.
    first : float, default 0.15
        First step as a fraction of `dual_limit`.
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
