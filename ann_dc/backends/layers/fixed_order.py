"""Sums with the same order of terms for every sample, whatever its batch.

A BLAS product or a torch reduction adds up in an order that depends on the batch. The last digit of
a sample then depends on it too, and a run that is sensitive to this digit (a step taken back or
not) settles elsewhere. The functions here are elementwise along the samples, which are the last
axis.
"""

from __future__ import annotations

from collections.abc import Callable

import torch


def total(values: torch.Tensor) -> torch.Tensor:
    """Return the sum over the first axis.

    The second half of the rows is added to the first until one row is left.
    """
    while len(values) > 1:
        half = len(values) // 2
        first, second, odd = values[:half], values[half : 2 * half], values[2 * half :]
        values = first + second
        if len(odd):
            values = torch.cat([values[:-1], values[-1:] + odd])
    return values[0]


def applied(matrices: torch.Tensor, vectors: torch.Tensor) -> torch.Tensor:
    """Return matrices (..., a, b) or (..., a, b, B) times vectors (..., b, B), column by column."""
    if matrices.dim() == vectors.dim():
        matrices = matrices.unsqueeze(-1)
    columns = matrices.unbind(-2)
    entries = vectors.unsqueeze(-3).unbind(-2)
    result = columns[0] * entries[0]
    for column, entry in zip(columns[1:], entries[1:]):
        result = torch.addcmul(result, column, entry)
    return result


def product(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Return matrices (..., a, b, B) times matrices (..., b, c, B), as (..., a, c, B)."""
    columns, rows = first.unsqueeze(-2).unbind(-3), second.unsqueeze(-4).unbind(-3)
    result = columns[0] * rows[0]
    for column, row in zip(columns[1:], rows[1:]):
        result = torch.addcmul(result, column, row)
    return result


def inverted(matrices: torch.Tensor) -> torch.Tensor:
    """Return inverses of symmetric positive definite matrices (..., b, b, B), swept row by row.

    References
    ----------
    .. [1] J. H. Goodnight, A tutorial on the SWEEP operator, The American Statistician 33, 1979,
       149-158.
    """
    minus = -torch.eye(matrices.shape[-2]).to(matrices)[..., None]
    others = 1.0 + minus
    kept = others[:, :, None] * others[:, None]
    for k in range(len(minus)):
        column = torch.addcmul(minus[k], matrices[..., k, :], others[k])
        along = column / matrices[..., k, k : k + 1, :]
        outer = column.unsqueeze(-2) * along.unsqueeze(-3)
        matrices = matrices * kept[k] - outer
    return -matrices


class _SameEverywhere:
    """Torch with hyperbolic functions that do not depend on the position in a vector.

    Torch computes sinh and cosh beyond the last full register by another formula.
    """

    def __getattr__(self, name: str):
        return getattr(torch, name)

    @staticmethod
    def sinh(x: torch.Tensor) -> torch.Tensor:
        return 0.5 * (torch.expm1(x) - torch.expm1(-x))

    @staticmethod
    def cosh(x: torch.Tensor) -> torch.Tensor:
        return 0.5 * (torch.exp(x) + torch.exp(-x))

    @staticmethod
    def rarely(
        mask: torch.Tensor, make: Callable[[], torch.Tensor], otherwise: float
    ) -> torch.Tensor:
        """Select made numbers in a mask; making them for all keeps a GPU from waiting."""
        return torch.where(mask, make(), otherwise)


LIBRARY = _SameEverywhere()
"""Array library of function blocks and step control: torch, with replacements of functions that
depend on the position.
"""
