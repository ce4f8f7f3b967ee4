r"""Anderson acceleration with a safeguard, using the last steps of the recurrence.

From the differences of its last states, dX, and of its last moves, dF, the recurrence takes the
combination that would have minimised the move m,

.. math::
    \gamma = \arg\min |m - dF\,\gamma|, \qquad
    x^{(j+1)} = x^{(j)} + h\,m - (dX + h\,dF)\,\gamma ,

which on a linear flow is GMRES. The result is a recurrent layer with more state. Outside the linear
regime acceleration can do harm, so a step that raises the energy is taken back. If the step rule
must cut h (its sign of missing progress), the memory is cleared and the recurrence continues
without acceleration until the energy is halved. Acceleration finds any equilibrium, including a
saddle, which the flow would leave. A sample that settles at a saddle restarts without acceleration
(`Loop.unsound`).

References
----------
Walker and Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49 (2011);
Zhang, O'Donoghue and Boyd, Globally convergent type-I Anderson acceleration, SIAM J. Optim. 30
(2020), for the idea of a safeguard.
"""

from __future__ import annotations

from typing import NamedTuple

import torch

from ann_dc.backends.layers.fixed_order import total
from ann_dc.backends.layers.flow import Reading
from ann_dc.backends.step_rules import Anderson


class Proposal(NamedTuple):
    """Next step of B samples as the network alone would take it.

    The step rule reads its energy, and the acceleration may replace its step.
    """

    state: torch.Tensor  # current state (P, N, B) in network units
    step: torch.Tensor  # step length h (B,) in units of network time
    reading: Reading  # block arguments and drives at the state
    derivative: torch.Tensor  # move m (P, N, B) of the update order
    energy: torch.Tensor  # energy (B,), sqrt(sum |d m|), infinite outside a domain
    rejected: torch.Tensor  # mask (B,) of samples whose last step is taken back by the acceleration


AT_ONCE = 1 << 16
"""Number of memory values multiplied at once, about the size of a cache."""


class Memory(NamedTuple):
    """Memory of the acceleration: m differences of the (P, N) components of B samples.

    Moves are weighted by 1 / sqrt(rate), the preconditioner in which time constants are one.
    """

    rule: Anderson  # parameters of the acceleration
    states: torch.Tensor  # differences dX (m, P, N, B); zero for an empty entry
    derivatives: torch.Tensor  # differences dF (m, P, N, B), weighted
    gram: torch.Tensor  # gram matrices dF' dF (m, m, B)
    last_state: torch.Tensor  # last state (P, N, B)
    last_derivative: torch.Tensor  # last move (P, N, B), weighted
    known: torch.Tensor  # mask (B,) of samples that have a last state
    safe: torch.Tensor  # energy (B,) of the last state before an accelerated step, else infinite
    resume: torch.Tensor  # energy (B,) to resume at; infinite while active, zero if ended
    weight: torch.Tensor  # weights (P, N, 1) of the moves
    slot: int  # index of the oldest of the m differences

    @classmethod
    def of(cls, rule: Anderson, state: torch.Tensor, rates: torch.Tensor) -> Memory:
        """Return an empty memory for a state (P, N, B) and rates (P, N, 1).

        The rates are 1 / tau, zero for a neuron that never moves.
        """
        no_energy = torch.full_like(state[0, 0], torch.inf)
        return cls(
            rule=rule,
            states=state.new_zeros(rule.memory, *state.shape),
            derivatives=state.new_zeros(rule.memory, *state.shape),
            gram=state.new_zeros(rule.memory, rule.memory, len(no_energy)),
            last_state=torch.zeros_like(state),
            last_derivative=torch.zeros_like(state),
            known=torch.zeros_like(no_energy, dtype=torch.bool),
            safe=no_energy,
            resume=no_energy,
            weight=torch.where(rates > 0, rates, 1.0).rsqrt(),
            slot=0,
        )

    def select(self, samples: torch.Tensor) -> Memory:
        """Return the memory of these samples (b,)."""
        names = (
            "states",
            "derivatives",
            "gram",
            "last_state",
            "last_derivative",
            "known",
            "safe",
            "resume",
        )
        return self._replace(**{name: getattr(self, name)[..., samples] for name in names})

    def ended(self, samples: torch.Tensor) -> Memory:
        """End the acceleration of ``samples``, a mask (B,), permanently."""
        return self._replace(
            known=self.known & ~samples,
            safe=torch.where(samples, torch.inf, self.safe),
            resume=torch.where(samples, 0.0, self.resume),
        )

    def rejects(self, energy: torch.Tensor) -> torch.Tensor:
        """Return a mask (B,) of steps to take back, by the energy (B,) after them."""
        return self.safe.isfinite() & (energy > self.rule.rise * self.safe)

    def next(self, proposal: Proposal, cut: torch.Tensor) -> tuple[Memory, torch.Tensor]:
        """Take one accelerated step in place; return the new memory and state (P, N, B).

        The mask ``cut`` (B,) marks samples whose h was cut. Their memory, and that of samples whose
        last step is rejected, is cleared.
        """
        rejected, energy, h = proposal.rejected, proposal.energy, proposal.step
        x, m, w = proposal.state, proposal.derivative, self.weight
        known, weighted = self.known & ~rejected & ~cut, m * w
        wanted = _remember(self, x, weighted, known, forget=rejected | cut)
        ended = self.resume == 0
        resume = torch.where(cut & ~ended, self.rule.resume * energy, self.resume)
        resume = torch.where(energy < resume, torch.inf, resume)
        accelerated = known & ~resume.isfinite()
        gamma = _combination(self.rule, self.gram, wanted)
        ahead, following = weighted, x.clone()
        for share, moved, led in zip(gamma, self.derivatives, self.states):
            ahead.addcmul_(share, moved, value=-1)
            following.addcmul_(share, led, value=-1)
        following = following + h * (ahead / w)
        back = self.last_state + h * self.last_derivative / w
        plain = torch.where(rejected, back, x + h * m)
        return self._replace(
            last_state=x,
            last_derivative=m * w,
            known=~rejected,
            safe=torch.where(accelerated, energy, torch.inf),
            resume=resume,
            slot=(self.slot + 1) % self.rule.memory,
        ), torch.where(accelerated, following, plain)


def _combination(rule: Anderson, gram: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Return gamma (m, B) of the regularised least squares, from dF' dF and dF' m."""
    ridge = rule.regularisation * total(gram.diagonal().T)
    ridge = torch.where(ridge > 0, ridge, 1.0)
    eye = torch.eye(len(gram), dtype=gram.dtype, device=gram.device)
    gamma = solved(gram + ridge * eye[:, :, None], wanted)
    return torch.where(gamma.isfinite(), gamma, 0.0)


def solved(matrices: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Return A^{-1} b (m, B) for symmetric positive definite A (m, m, B) and b (m, B), in place.

    A sample's bits do not depend on the batch, as those of LAPACK may.
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
    derivative: torch.Tensor,
    known: torch.Tensor,
    *,
    forget: torch.Tensor,
) -> torch.Tensor:
    """Replace the oldest difference by the newest if there was a last state.

    Returns dF' m (m, B), which is computed in the same pass through the memory as dF' dF.
    """
    slot, gone = memory.slot, forget.nonzero()[:, 0]
    memory.states[slot] = torch.where(known, x - memory.last_state, 0.0)
    memory.derivatives[slot] = torch.where(known, derivative - memory.last_derivative, 0.0)
    if len(gone):
        for kept in (memory.states, memory.derivatives, memory.gram):
            kept.index_fill_(-1, gone, 0.0)
    newest = memory.derivatives[slot]
    products, wanted = (
        _products(memory.derivatives, newest),
        _products(memory.derivatives, derivative),
    )
    memory.gram[slot], memory.gram[:, slot] = products, products
    return wanted


def _products(differences: torch.Tensor, derivative: torch.Tensor) -> torch.Tensor:
    """Return dF' m (m, B) of differences (m, P, N, B) and a move (P, N, B)."""
    many = max(AT_ONCE // derivative.numel(), 1)
    return torch.cat(
        [
            total((part * derivative).flatten(1, 2).transpose(0, 1))
            for part in differences.split(many)
        ]
    )
