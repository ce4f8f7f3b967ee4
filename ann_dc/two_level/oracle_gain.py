r"""The paper's adaptive gain (33): an oracle, because it needs the solution that is sought.

.. math:: \lambda = |B / A| ,

with A and B of `ann_dc.two_level.lyapunov` over the errors and drives of t and beta. One rule, and
two that obey it: `OracleBackend` in continuous time, where lambda is a factor on the rates of t and
beta (switch S16), and `ann_dc.two_level.upper_level.OracleCoordinator` in outer iterations.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ann_dc.backends.ode import OdeBackend, RightHandSide
from ann_dc.backends.run import Backend, Run
from ann_dc.errors import FormError, NetworkError, require_positive
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import COORDINATION, Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.two_level.lyapunov import Lyapunov, lyapunov_of
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Shape


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleGain:
    """lambda = share |B/A| of (21), (33), from the solution; for studies only.

    A step of lambda lowers Theta for 0 < lambda < -B/A only, and B is often positive; the rule is
    run as it is printed, with the absolute value. Where B < 0, a share of 1/2 lowers Theta most,
    and a share of 1 leaves it as it is. Where B >= 0 no lambda lowers it.

    Attributes
    ----------
    settled : (n,) or (B, n) array
        State vector of the solution, in the network's units; one a sample where inputs differ.
    share : float
        Of \\|B/A\\|, the largest gain that does not raise Theta where B < 0.
    low, high : float
        lambda is clipped to this range; \\|B/A\\| has no upper bound near the solution.

    Raises
    ------
    NetworkError
        If ``share`` or ``high`` is not a positive number, or ``settled`` has more than two axes.

    References
    ----------
    Paper equations (20), (21), (33), corrected; switch S16.
    """

    settled: Annotated[np.ndarray, Shape("...", "n")]
    share: float = 1.0
    low: float = 0.0
    high: float = 1e3

    def __post_init__(self) -> None:
        require_positive(share=self.share, high=self.high)
        if self.settled.ndim > 2:
            raise NetworkError(
                f"settled: expected a state (n,) or one a sample (B, n), got {self.settled.shape}"
            )

    def of(self, found: Lyapunov) -> Any:
        """lambda (B,), ``low`` where it is not defined.

        Parameters
        ----------
        found : Lyapunov
            Of every sample.

        Examples
        --------
        >>> found = Lyapunov(theta=np.ones(2), A=np.array([2.0, 0.0]), B=np.array([-3.0, 0.0]))
        >>> OracleGain(settled=np.zeros(4), low=0.1).of(found)
        array([1.5, 0.1])
        """
        with np.errstate(all="ignore"):  # 0/0 at the solution
            gain = (self.share * abs(found.bound)).clip(self.low, self.high)
        gain[gain != gain] = self.low
        return gain


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleBackend:
    """Continuous time with the gain (33) on the rates of t and beta: switch S16.

    It knows what no circuit knows, so it is no network: its right-hand side is followed in the
    network's place.

    Attributes
    ----------
    gain : OracleGain
        With ``low`` above zero, so that t and beta never stand still.
    ode : OdeBackend
        Integrates, and says when the run has settled.

    Examples
    --------
    >>> import ann_dc
    >>> designed = ann_dc.design(ann_dc.plants.double_integrator(N=5))
    >>> gain = OracleGain(settled=designed.state, low=0.1, high=10.0)
    >>> backend = OracleBackend(gain=gain, ode=ann_dc.OdeBackend(verify=False, most_steps=100))
    >>> backend.run(designed.network).steps
    100

    References
    ----------
    Paper equation (33); switch S16.
    """

    gain: OracleGain
    ode: OdeBackend = field(default_factory=OdeBackend)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Those of the ODE."""
        return self.ode.kinds

    @checked
    def run(self, network: Network) -> Run:
        """Integrate from the network's start until it settles, diverges, or time is up.

        Returns
        -------
        Run
        """
        return self.ode.follow(network, self.right_hand_side(network))

    @checked
    def right_hand_side(self, network: Network) -> RightHandSide:
        """dx/ds of a network whose rates of t and beta are multiplied by the gain.

        Returns
        -------
        callable
            dx/ds (n,) of a state vector (n,), both in network units.
        """
        compiled, slow = fast_evaluator(network), network.of_population(*COORDINATION)

        def factor(x: np.ndarray) -> np.ndarray:
            drive = network.pack(compiled.drives(x))[slow]
            found = lyapunov_of((x - self.gain.settled)[slow], drive)
            return self.gain.of(Lyapunov(*map(np.atleast_1d, found)))

        def rates(x: np.ndarray) -> np.ndarray:
            moves = compiled.rhs(x)
            moves[slow] *= factor(x)
            return moves

        return rates


def continuous(backend: Backend) -> OdeBackend:
    """The backend, which has to run in continuous time for the gain (33) to act.

    Raises
    ------
    FormError
        If it does not.
    """
    if not isinstance(backend, OdeBackend):
        raise FormError("S16: the gain (33) acts in continuous time; use the ODE backend")
    return backend
