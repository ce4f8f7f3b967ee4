"""What a state proposes: the next step as the network alone would take it, before it is taken.

The loop makes one at every state, the step rule looks at its energy, and the acceleration may put
another step in its place.
"""

from __future__ import annotations

from typing import NamedTuple

import torch

from ann_dc.backends.recurrent.cell.flow import Reading


class Proposal(NamedTuple):
    """What is known of B samples at a state before their next step."""

    state: torch.Tensor
    """(P, N, B): where the samples are, in network units."""
    step: torch.Tensor
    """h (B,), in units of network time."""
    reading: Reading
    """What the blocks say at the state."""
    move: torch.Tensor
    """m (P, N, B), as the update order has it."""
    energy: torch.Tensor
    """(B,): sqrt(sum |d m|), infinite outside a domain."""
    rejected: torch.Tensor
    """(B,): whether the acceleration takes back the step that led here."""

    @property
    def following(self) -> torch.Tensor:
        """The state (P, N, B) after this step: x + h m."""
        return self.state + self.step * self.move
