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

from typing import NamedTuple

import torch

from ann_dc.backends.recurrent.cell.fixed_order import total
from ann_dc.backends.recurrent.layers.proposal import Proposal
from ann_dc.backends.recurrent.rules.acceleration import Anderson

AT_ONCE = 1 << 16
"""Numbers of the memory that are multiplied at once, about what a cache holds."""


class Memory(NamedTuple):
    """What the acceleration remembers: m differences of the (P, N) components of B samples.

    Moves are weighted by 1 / sqrt(rate), the metric in which time constants are one. All is in
    network units.
    """

    rule: Anderson
    """By which it is used."""
    states: torch.Tensor
    """dX (m, P, N, B); zero where nothing is remembered."""
    moves: torch.Tensor
    """dF (m, P, N, B), weighted."""
    gram: torch.Tensor
    """dF' dF (m, m, B)."""
    last_state: torch.Tensor
    """(P, N, B)."""
    last_move: torch.Tensor
    """(P, N, B), weighted."""
    known: torch.Tensor
    """(B,): whether there is a last state."""
    safe: torch.Tensor
    """(B,): energy of the last state if an accelerated step left it, infinite otherwise."""
    resume: torch.Tensor
    """(B,): energy below which acceleration goes on; infinite while it is on, zero for good."""
    weight: torch.Tensor
    """(P, N, 1), of the moves."""
    slot: int
    """Which of the m differences is the oldest."""

    @classmethod
    def of(cls, rule: Anderson, state: torch.Tensor, rates: torch.Tensor) -> Memory:
        """Nothing remembered yet.

        Parameters
        ----------
        rule : Anderson
        state : (P, N, B) tensor
        rates : (P, N, 1) tensor
            1 / tau, zero where a neuron never moves.
        """
        no_energy = torch.full_like(state[0, 0], torch.inf)
        return cls(
            rule=rule,
            states=state.new_zeros(rule.memory, *state.shape),
            moves=state.new_zeros(rule.memory, *state.shape),
            gram=state.new_zeros(rule.memory, rule.memory, len(no_energy)),
            last_state=torch.zeros_like(state),
            last_move=torch.zeros_like(state),
            known=torch.zeros_like(no_energy, dtype=torch.bool),
            safe=no_energy,
            resume=no_energy,
            weight=torch.where(rates > 0, rates, 1.0).rsqrt(),
            slot=0,
        )

    def select(self, samples: torch.Tensor) -> Memory:
        """What is remembered of these samples (b,)."""
        return self._replace(
            states=self.states[..., samples],
            moves=self.moves[..., samples],
            gram=self.gram[..., samples],
            last_state=self.last_state[..., samples],
            last_move=self.last_move[..., samples],
            known=self.known[..., samples],
            safe=self.safe[..., samples],
            resume=self.resume[..., samples],
        )

    def ended(self, samples: torch.Tensor) -> Memory:
        """Without acceleration from now on for ``samples``, (B,) booleans."""
        return self._replace(
            known=self.known & ~samples,
            safe=torch.where(samples, torch.inf, self.safe),
            resume=torch.where(samples, 0.0, self.resume),
        )

    def rejects(self, energy: torch.Tensor) -> torch.Tensor:
        """(B,) booleans: whether the last step has to be taken back.

        Parameters
        ----------
        energy : (B,) tensor
            Where the last step led; infinite outside a domain.
        """
        return self.safe.isfinite() & (energy > self.rule.rise * self.safe)

    def next(self, proposal: Proposal, cut: torch.Tensor) -> tuple[Memory, torch.Tensor]:
        """One accelerated step; works in place.

        Parameters
        ----------
        proposal : Proposal
            Of the state that the step starts from.
        cut : (B,) booleans
            Whose h was cut: they forget, as those do whose last step is rejected.

        Returns
        -------
        memory : Memory
            What is remembered then.
        state : (P, N, B) tensor
            After the step.
        """
        rejected, energy, h = proposal.rejected, proposal.energy, proposal.step
        x, m, w = proposal.state, proposal.move, self.weight
        known, weighted = self.known & ~rejected & ~cut, m * w
        wanted = _remember(self, x, weighted, known, forget=rejected | cut)
        ended = self.resume == 0
        resume = torch.where(cut & ~ended, self.rule.resume * energy, self.resume)
        resume = torch.where(energy < resume, torch.inf, resume)
        accelerated = known & ~resume.isfinite()
        gamma = _combination(self.rule, self.gram, wanted)
        ahead, following = weighted, x.clone()
        for share, moved, led in zip(gamma, self.moves, self.states):
            ahead.addcmul_(share, moved, value=-1)
            following.addcmul_(share, led, value=-1)
        following = following + h * (ahead / w)
        back = self.last_state + h * self.last_move / w
        plain = torch.where(rejected, back, x + h * m)
        return self._replace(
            last_state=x,
            last_move=m * w,
            known=~rejected,
            safe=torch.where(accelerated, energy, torch.inf),
            resume=resume,
            slot=(self.slot + 1) % self.rule.memory,
        ), torch.where(accelerated, following, plain)


def _combination(rule: Anderson, gram: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """gamma (m, B): the regularised least squares, from dF' dF and dF' m."""
    ridge = rule.regularisation * total(gram.diagonal().T)
    ridge = torch.where(ridge > 0, ridge, 1.0)
    eye = torch.eye(len(gram), dtype=gram.dtype, device=gram.device)
    gamma = solved(gram + ridge * eye[:, :, None], wanted)
    return torch.where(gamma.isfinite(), gamma, 0.0)


def solved(matrices: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """A^{-1} b (m, B) for symmetric positive definite A (m, m, B) and b (m, B), by elimination.

    A sample's bits do not depend on the batch, as LAPACK's may. Works in place on both.
    """
    order = range(len(right))
    for j in order:
        row, below = matrices[j, j + 1 :], matrices[j + 1 :, j]
        pivot = matrices[j, j]
        row.div_(pivot)
        right[j].div_(pivot)
        matrices[j + 1 :, j + 1 :].addcmul_(below[:, None], row[None], value=-1)
        right[j + 1 :].addcmul_(below, right[j], value=-1)
    for j in reversed(order):
        right[:j].addcmul_(matrices[:j, j], right[j], value=-1)
    return right


def _remember(
    memory: Memory,
    x: torch.Tensor,
    move: torch.Tensor,
    known: torch.Tensor,
    *,
    forget: torch.Tensor,
) -> torch.Tensor:
    """Put the newest difference in the place of the oldest, where there was a last state.

    Returns dF' m (m, B), which is found on the same way through the memory as dF' dF.
    """
    slot, gone = memory.slot, forget.nonzero()[:, 0]
    memory.states[slot] = torch.where(known, x - memory.last_state, 0.0)
    memory.moves[slot] = torch.where(known, move - memory.last_move, 0.0)
    if len(gone):
        for kept in (memory.states, memory.moves, memory.gram):
            kept.index_fill_(-1, gone, 0.0)
    newest = memory.moves[slot]
    products, wanted = _products(memory.moves, newest), _products(memory.moves, move)
    memory.gram[slot], memory.gram[:, slot] = products, products
    return wanted


def _products(differences: torch.Tensor, move: torch.Tensor) -> torch.Tensor:
    """dF' m (m, B), of differences (m, P, N, B) and a move (P, N, B)."""
    many = max(AT_ONCE // move.numel(), 1)
    return torch.cat(
        [total((part * move).flatten(1, 2).transpose(0, 1)) for part in differences.split(many)]
    )
