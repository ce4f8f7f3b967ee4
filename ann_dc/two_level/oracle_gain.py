r"""Adaptive gain (33) of the paper, an oracle that needs the unknown solution.

.. math:: \lambda = |B / A| ,

where A and B are those of `ann_dc.two_level.lyapunov`. `OracleBackend` applies the gain in
continuous time, as a factor on the rates of t and beta (switch S16), `OracleCoordinator` in outer
iterations.
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
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.two_level.lyapunov import Lyapunov, lyapunov_of
from ann_dc.validation import Shape, checked


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleGain:
    r"""Gain lambda = share ``|B/A|`` of (21), (33) from the solution; for studies only.

    A step of lambda decreases Theta for 0 < lambda < -B/A only, and B is often positive. The rule
    is applied as printed, with the absolute value. If B < 0, ``share`` = 1/2 decreases Theta most
    and ``share`` = 1 leaves Theta unchanged. If B >= 0, no lambda decreases Theta.

    Attributes
    ----------
    settled : (n,) or (B, n) array
        State vector of the solution, in network units; one per sample if inputs differ.
    share : float
        Fraction of \|B/A\|, the largest gain that does not increase Theta if B < 0.
    low, high : float
        Range to which lambda is clipped. \|B/A\| has no upper bound near the solution.

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
                f"settled: expected a state (n,) or one per sample (B, n), got {self.settled.shape}"
            )

    def of(self, found: Lyapunov) -> Any:
        """Return lambda (B,) for the Theta, A and B of every sample; undefined, ``low``."""
        with np.errstate(all="ignore"):  # 0/0 at the solution
            gain = (self.share * abs(found.bound)).clip(self.low, self.high)
        gain[gain != gain] = self.low
        return gain


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleBackend:
    """Backend in continuous time with the gain (33) on the rates of t and beta (S16).

    The gain uses the solution, which no circuit knows. The modified right-hand side therefore
    replaces that of the network and has no network representation.

    Attributes
    ----------
    gain : OracleGain
        Gain with ``low`` above zero, so that t and beta never stop.
    ode : OdeBackend
        Backend that integrates and detects settling.

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
    def kinds(self) -> tuple[PreconditionerKind, ...]:
        """Preconditioner kinds of the ODE backend."""
        return self.ode.kinds

    @checked
    def run(self, network: Network) -> Run:
        """Integrate from the initial guess until it settles, diverges or time expires."""
        return self.ode.follow(network, self.right_hand_side(network))

    def right_hand_side(self, network: Network) -> RightHandSide:
        """Return x (n,) -> dx/ds (n,) with the rates of t and beta multiplied by the gain."""
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
    """Return the backend if it runs in continuous time, as the gain (33) requires.

    Raises `FormError` for any other backend.
    """
    if not isinstance(backend, OdeBackend):
        raise FormError("S16: the gain (33) acts in continuous time; use the ODE backend")
    return backend
