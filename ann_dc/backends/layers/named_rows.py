"""Tensors whose rows have the network's names in a ``state_dict``.

Torch allows no dot in the name of a parameter, and no attribute called ``forward`` or ``train``.
The rows are therefore one tensor, the form that a step needs, and are named when saved.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import torch
from torch import nn


class NamedRows(nn.Module):
    """One tensor, saved and loaded piece by piece under names that may contain dots.

    The pieces follow each other along the first axis of ``rows`` (R, ...), with the given ``sizes``
    or one row each. They are a parameter if ``trainable``, else a buffer.

    Examples
    --------
    >>> tau = NamedRows(["q.x", "mu.x"], torch.tensor([[1.0], [2.0]]))
    >>> list(tau.state_dict())
    ['q.x', 'mu.x']
    """

    rows: torch.Tensor

    def __init__(
        self,
        names: Sequence[str],
        rows: torch.Tensor,
        *,
        sizes: Sequence[int] | None = None,
        trainable: bool = False,
    ) -> None:
        super().__init__()
        if trainable:
            self.rows = nn.Parameter(rows)
        else:
            self.register_buffer("rows", rows)
        ends = list(accumulate(sizes if sizes is not None else [1] * len(names), initial=0))
        self._pieces = {name: slice(*ends) for name, ends in zip(names, pairwise(ends))}
        self._single = sizes is None

    @property
    def names(self) -> list[str]:
        """Names of the pieces, in order."""
        return list(self._pieces)

    def __getitem__(self, name: str) -> torch.Tensor:
        """Return the piece of that name."""
        piece = self.rows[self._pieces[name]]
        return piece[0] if self._single else piece

    def _save_to_state_dict(self, destination, prefix, keep_vars):
        for name in self._pieces:
            piece = self[name]
            destination[prefix + name] = piece if keep_vars else piece.detach().clone()

    def _load_from_state_dict(
        self, state_dict, prefix, local_metadata, strict, missing_keys, unexpected_keys, error_msgs
    ):
        for name, place in self._pieces.items():
            if prefix + name not in state_dict:
                missing_keys.append(prefix + name)
                continue
            given, held = state_dict[prefix + name], self[name]
            if given.shape != held.shape:
                error_msgs.append(
                    f"{prefix}{name}: expected the shape {tuple(held.shape)}, "
                    f"got {tuple(given.shape)}"
                )
                continue
            with torch.no_grad():
                self.rows[place] = given[None] if self._single else given
        known = {prefix + name for name in self._pieces}
        unexpected_keys += [
            key for key in state_dict if key.startswith(prefix) and key not in known
        ]
