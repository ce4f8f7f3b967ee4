r"""How long a step is: fixed, or as long as progress earns it.

No rule may look at the solution: a circuit does not have it. What a circuit has are the drives, and
with them the energy e = sqrt(sum \|d m\|) over what arrives, d, and what moves, m.

A rule takes one constant from the network (and an estimate of its fastest rate at the start, which
it does not exceed), and becomes the numbers by which every step is lengthened or cut. A constraint
pair of primal and dual obeys s^2 + kappa s + eta kappa = 0 with eta = 1 / (rho tau) of its dual,
whatever its kappa <= 1, and forward Euler keeps it stable for h < 1 / eta = rho tau: so the longest
step of `AdaptiveStep` is a share of min rho tau. Strong curvature can ask for less. That is told by
the energy: a step that doubles it, or a window without progress, cuts h; after that h grows only
with the progress made, h ~ e^{-earned}, so that every excursion to the stability limit is paid for
beforehand.

The energy of an underdamped mode swings while the mode decays: with a frequency omega it may be
omega times as high at one end of a swing as at the other. What falls from swing to swing are its
peaks, one every half turn of the moves. So a rise is measured from the lowest peak of a turn. Where
a step is too long for a real mode, moves alternate and a turn is two steps; for a complex pair it
is half a swing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from ann_dc.backends.lanes.recurrence import StepLengths as StepLengths
from ann_dc.errors import require_positive
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as


@such_as("ann_dc.FixedStep(step=0.1)")
class StepRule(ABC):
    """A rule for h: the numbers that make the first step and every other, in code and in layers.

    Examples
    --------
    Half as long as the adaptive steps, whatever the network:

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
        """The numbers for a network.

        Parameters
        ----------
        limit : float
            min rho tau over the network's PI duals, and not more than two time constants of its
            fastest mode, in units of network time.
        """


def above_limit(step: float, limit: float, network: Network) -> str:
    """What is said of a step above the stability limit at a network's start."""
    return (
        f"step {step:g} is above the stability limit {limit:.3g} of {network.title} at its start: "
        "fast neurons grow from step to step; take a shorter one"
    )


@checked
@dataclass(frozen=True, kw_only=True)
class FixedStep(StepRule):
    """The same h at every step.

    A warning tells when h is above the stability limit at the network's start (see
    `stability_limit`; at the solution it may be another).

    Attributes
    ----------
    step : float
        h, in units of network time.

    Raises
    ------
    NetworkError
        If it is not a positive number.

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
        """The same ones, whatever the limit."""
        return StepLengths.always(self.step)


@checked
@dataclass(frozen=True, kw_only=True)
class AdaptiveStep(StepRule):
    """As long as progress earns it; needs no solution.

    Attributes
    ----------
    share : float
        Longest step as a share of `dual_limit`: min rho tau over the duals.
    first : float
        First step, likewise.
    growth : float
        Factor a step until the first cut.
    cut : float
        Factor when the energy rises or a window brings nothing.
    rise : float
        Rise of the energy, over the lowest peak of a turn since the last cut, that causes a cut.
    earned : float
        After the first cut, h grows by this power of the progress made.
    window : int
        Steps after which progress is looked for; an idle window makes the next ones longer.
    progress : float
        A window is idle when its lowest energy is above this share of the one before.
    least : float
        Shortest step as a share of the longest: a flow that grows at this step diverges.
    turn : float
        Length of a turn: the sum of sin(angle / 2) between successive moves, pi/2 for half a turn
        in many steps, 1 for a step that the next one takes back.

    Raises
    ------
    NetworkError
        If one of them is not a positive number.

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
        """With a short step first, so that the start may be rough."""
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
