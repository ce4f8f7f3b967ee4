"""Proposal of a state: the next step as the network alone would take it.

The loop makes a proposal at every state. The step rule reads its energy, and the acceleration may
replace its step.
"""

from __future__ import annotations

from typing import NamedTuple

import torch

from ann_dc.backends.recurrent.cell.flow import Reading


class Proposal(NamedTuple):
    """Facts about B samples at a state before their next step."""

    state: torch.Tensor
    """Current state (P, N, B) in network units."""
    step: torch.Tensor
    """Step length h (B,) in units of network time."""
    reading: Reading
    """Block arguments and drives at the state."""
    move: torch.Tensor
    """Move m (P, N, B) of the update order."""
    energy: torch.Tensor
    """Energy (B,), sqrt(sum |d m|), infinite outside a domain."""
    rejected: torch.Tensor
    """Mask (B,) of samples whose last step is taken back by the acceleration."""

    @property
    def following(self) -> torch.Tensor:
        """State (P, N, B) after this step: x + h m."""
        return self.state + self.step * self.move
