r"""Anderson acceleration with a safeguard: the recurrence remembers its last steps.

From the differences of its last states, dX, and of its last moves, dF, the recurrence takes the
combination that would have made the move m smallest,

.. math::
    \gamma = \arg\min |m - dF\,\gamma|, \qquad
    x^{(j+1)} = x^{(j)} + h\,m - (dX + h\,dF)\,\gamma ,

which on a linear flow is GMRES. It is a recurrent layer with more state. Off the linear regime it
can do harm, so a step that raises the energy is taken back, and a step rule that has to cut h (its
sign that nothing moves on) makes the recurrence forget and go on alone until the energy is halved.
And it finds any equilibrium, a saddle too, at which the flow would not stay: whoever settles at one
starts again without acceleration (`Loop.unsound`).

References
----------
Walker and Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49 (2011);
Zhang, O'Donoghue and Boyd, Globally convergent type-I Anderson acceleration, SIAM J. Optim. 30
(2020), for the idea of a safeguard.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch

from ann_dc.errors import require_positive


class Memory(NamedTuple):
    """What the acceleration remembers: m differences of the K components of B samples."""

    states: torch.Tensor
    """dX (B, m, K); zero where nothing is remembered."""
    moves: torch.Tensor
    """dF (B, m, K), weighted."""
    gram: torch.Tensor
    """dF' dF (B, m, m)."""
    last_state: torch.Tensor
    """(B, K)."""
    last_move: torch.Tensor
    """(B, K), weighted."""
    known: torch.Tensor
    """(B,): whether there is a last state."""
    safe: torch.Tensor
    """(B,): energy of the last state if an accelerated step left it, infinite otherwise."""
    resume: torch.Tensor
    """(B,): energy below which acceleration goes on; infinite while it is on, zero for good."""


@dataclass(frozen=True, kw_only=True)
class Anderson:
    """Safeguarded Anderson acceleration of any update order.

    Attributes
    ----------
    memory : int
        m, how many differences are kept.
    rise : float
        A step that raises the energy by more than this factor is taken back.
    resume : float
        After a cut of h, the share of the energy at which acceleration starts again.
    regularisation : float
        Of the least-squares problem, relative to the trace of dF' dF.
    """

    memory: int = 20
    rise: float = 1.2
    resume: float = 0.5
    regularisation: float = 1e-10

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def begin(self, state: torch.Tensor) -> Memory:
        """Nothing remembered, for a state (P, N, B)."""
        components, samples = state.flatten(0, 1).shape
        no_energy = state.new_full((samples,), torch.inf)
        return Memory(
            states=state.new_zeros(samples, self.memory, components),
            moves=state.new_zeros(samples, self.memory, components),
            gram=state.new_zeros(samples, self.memory, self.memory),
            last_state=state.new_zeros(samples, components),
            last_move=state.new_zeros(samples, components),
            known=torch.zeros_like(no_energy, dtype=torch.bool),
            safe=no_energy,
            resume=no_energy,
        )

    def rejects(self, memory: Memory, energy: torch.Tensor) -> torch.Tensor:
        """(B,) booleans: whether the last step has to be taken back; ``energy`` may be infinite."""
        return memory.safe.isfinite() & (energy > self.rise * memory.safe)

    def next(
        self,
        memory: Memory,
        slot: int,
        state: torch.Tensor,
        move: torch.Tensor,
        step: torch.Tensor,
        weight: torch.Tensor,
        energy: torch.Tensor,
        rejected: torch.Tensor,
        cut: torch.Tensor,
    ) -> tuple[Memory, torch.Tensor]:
        """The next state (P, N, B), and what is remembered then; works in place on ``memory``.

        Parameters
        ----------
        memory : Memory
        slot : int
            Which of the m differences is replaced.
        state, move : (P, N, B) tensors
        step : (B,) tensor
        weight : (P, N, 1) tensor
            Components are weighed by 1 / sqrt(rate), the metric in which time constants are one.
        energy : (B,) tensor
        rejected, cut : (B,) boolean tensors
            Whose last step is taken back, and whose h was cut: they forget.
        """
        x, m, w = _rows(state), _rows(move), _rows(weight)
        new, h = memory.known & ~rejected & ~cut, step[:, None]
        memory.states[:, slot] = torch.where(new[:, None], x - memory.last_state, 0.0)
        memory.moves[:, slot] = torch.where(new[:, None], m * w - memory.last_move, 0.0)
        forget = (rejected | cut).nonzero()[:, 0]
        for kept in (memory.states, memory.moves, memory.gram):
            kept[forget] = 0.0
        products = _times(memory.moves, memory.moves[:, slot])
        memory.gram[:, slot], memory.gram[:, :, slot] = products, products
        ended = memory.resume == 0
        resume = torch.where(cut & ~ended, self.resume * energy, memory.resume)
        resume = torch.where(energy < resume, torch.inf, resume)
        accelerated = new & ~resume.isfinite()
        gamma = self._combination(memory, m * w)
        ahead = m - _times(memory.moves.mT, gamma) / w
        following = x - _times(memory.states.mT, gamma) + h * ahead
        back = rejected[:, None]
        plain = torch.where(back, memory.last_state + h * memory.last_move / w, x + h * m)
        following = torch.where(accelerated[:, None], following, plain)
        return memory._replace(
            last_state=x,
            last_move=m * w,
            known=~rejected,
            safe=torch.where(accelerated, energy, torch.inf),
            resume=resume,
        ), following.T.reshape(state.shape)

    def _combination(self, memory: Memory, move: torch.Tensor) -> torch.Tensor:
        """gamma (B, m): the regularised least squares of a weighted move (B, K)."""
        ridge = self.regularisation * memory.gram.diagonal(dim1=1, dim2=2).sum(1)
        ridge = torch.where(ridge > 0, ridge, 1.0)
        eye = torch.eye(self.memory, dtype=move.dtype, device=move.device)
        wanted = _times(memory.moves, move)
        gamma, _ = torch.linalg.solve_ex(memory.gram + ridge[:, None, None] * eye, wanted)
        return torch.where(gamma.isfinite(), gamma, 0.0)


def _rows(state: torch.Tensor) -> torch.Tensor:
    """(P, N, B) as (B, K)."""
    return state.flatten(0, 1).T.contiguous()


def _times(matrices: torch.Tensor, vectors: torch.Tensor) -> torch.Tensor:
    """Batched matrix-vector product."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
