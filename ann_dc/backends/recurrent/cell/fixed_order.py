"""Sums with the same order of terms for every sample, whatever its batch.

A BLAS product or a torch reduction adds up in an order that depends on the number of columns, the
position of a sample among them, and the memory layout. The last digit of a sample then depends on
the batch composition, and a run that is sensitive to this digit (a step taken back or not) settles
elsewhere. The functions here use only elementwise operations along the samples, which are the last
axis. A sample therefore has the same bits alone and in any batch.
"""

from __future__ import annotations

import torch


def total(values: torch.Tensor) -> torch.Tensor:
    """Return the sum over the first axis, which must have at least one row.

    The second half of the rows is added to the first until one row is left.

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
    """Return matrices (..., a, b) times vectors (..., b, B), as (..., a, B).

    The product is computed column after column. The matrices have shape (..., a, b) if all samples
    use the same, or (..., a, b, B).

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
    """Return matrices (..., a, b, B) times matrices (..., b, c, B), as (..., a, c, B)."""
    columns, rows = first.unsqueeze(-2).unbind(-3), second.unsqueeze(-4).unbind(-3)
    result = columns[0] * rows[0]
    for column, row in zip(columns[1:], rows[1:]):
        result = torch.addcmul(result, column, row)
    return result


def inverted(matrices: torch.Tensor) -> torch.Tensor:
    """Return inverses of symmetric positive definite matrices (..., b, b, B).

    The matrices are swept row by row.

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
    """Torch with hyperbolic functions that do not depend on the position in a vector.

    If a length is not a multiple of a register's, torch computes sinh and cosh of the rest by
    another formula, whose last digit differs.
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
"""Array library of function blocks: torch, with position-independent replacements."""
