"""Sums whose order is the same for every sample, whatever batch it is in.

A BLAS product or a torch reduction adds up in an order that depends on how many columns there are,
on where among them a sample stands, and on how it lies in memory: the last digit of a sample then
depends on its company, and a run that is sensitive to it (a step taken back or not) settles
elsewhere. Here only elementwise operations work along the samples, which are the last axis, so that
a sample has the same bits alone and in any batch.
"""

from __future__ import annotations

import torch


def total(values: torch.Tensor) -> torch.Tensor:
    """Sum over the first axis: the second half is added to the first until one row is left.

    Parameters
    ----------
    values : (rows, ...) tensor
        At least one row.

    Returns
    -------
    (...) tensor

    Examples
    --------
    >>> total(torch.arange(10.0).reshape(5, 2))
    tensor([20., 25.])
    """
    while len(values) > 1:
        half = len(values) // 2
        first, second, odd = values[:half], values[half : 2 * half], values[2 * half :]
        values = first + second
        if len(odd):
            values = torch.cat([values[:-1], values[-1:] + odd])
    return values[0]


def applied(matrices: torch.Tensor, vectors: torch.Tensor) -> torch.Tensor:
    """Matrices (..., a, b) times vectors (..., b, B), as (..., a, B): column after column.

    Parameters
    ----------
    matrices : (..., a, b) or (..., a, b, B) tensor
        The same for all samples, or one a sample.
    vectors : (..., b, B) tensor

    Examples
    --------
    >>> applied(torch.tensor([[1.0, 2.0], [3.0, 4.0]]), torch.tensor([[1.0], [10.0]]))
    tensor([[21.],
            [43.]])
    """
    if matrices.dim() == vectors.dim():
        matrices = matrices.unsqueeze(-1)
    columns = matrices.unbind(-2)
    entries = vectors.unsqueeze(-3).unbind(-2)
    result = columns[0] * entries[0]
    for column, entry in zip(columns[1:], entries[1:]):
        result = torch.addcmul(result, column, entry)
    return result


def product(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Matrices (..., a, b, B) times matrices (..., b, c, B), as (..., a, c, B).

    Parameters
    ----------
    first : (..., a, b, B) tensor
    second : (..., b, c, B) tensor
    """
    columns, rows = first.unsqueeze(-2).unbind(-3), second.unsqueeze(-4).unbind(-3)
    result = columns[0] * rows[0]
    for column, row in zip(columns[1:], rows[1:]):
        result = torch.addcmul(result, column, row)
    return result


def inverted(matrices: torch.Tensor) -> torch.Tensor:
    """Inverses of symmetric positive definite matrices (..., b, b, B), swept row by row.

    Parameters
    ----------
    matrices : (..., b, b, B) tensor

    Examples
    --------
    >>> inverted(torch.tensor([[4.0, 2.0], [2.0, 2.0]])[..., None])[..., 0]
    tensor([[ 0.5000, -0.5000],
            [-0.5000,  1.0000]])

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
    """Torch, with hyperbolic functions whose last digit does not depend on a place in a vector.

    Where a length is no multiple of a register's, torch computes its own sinh and cosh of the rest
    by another formula.
    """

    def __getattr__(self, name: str):
        return getattr(torch, name)

    @staticmethod
    def sinh(x: torch.Tensor) -> torch.Tensor:
        return 0.5 * (torch.expm1(x) - torch.expm1(-x))

    @staticmethod
    def cosh(x: torch.Tensor) -> torch.Tensor:
        return 0.5 * (torch.exp(x) + torch.exp(-x))


LIBRARY = _SameEverywhere()
"""The array library of function blocks: torch, but for what is not the same everywhere."""
