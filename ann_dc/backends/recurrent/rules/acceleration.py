"""Parameters of Anderson acceleration; see `layers.memory` for the algorithm."""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import require_positive, such_as
from ann_dc.validation import checked


@such_as("ann_dc.Anderson()")
@checked
@dataclass(frozen=True, kw_only=True)
class Anderson:
    """Safeguarded Anderson acceleration of any update order; it runs on torch.

    Attributes
    ----------
    memory : int, default 20
        Number m of stored differences.
    rise : float, default 1.2
        Factor on the energy above which a step is taken back.
    resume : float, default 0.5
        Fraction of the energy at which acceleration resumes after a cut of h.
    regularisation : float, default 1e-10
        Regularisation of the least-squares problem, relative to the trace of dF' dF.

    Raises
    ------
    NetworkError
        If a field is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> kind = ann_dc.PreconditionerKind.MULTILEVEL
    >>> network = ann_dc.design(problem, preconditioner=kind).network
    >>> for acceleration in (None, ann_dc.Anderson()):
    ...     backend = ann_dc.RecurrentBackend(acceleration=acceleration, limit=150)
    ...     print(backend.run(network).status.settled)
    False
    True

    References
    ----------
    Walker and Ni, SIAM J. Numer. Anal. 49 (2011); the safeguard after Zhang, O'Donoghue and Boyd,
    SIAM J. Optim. 30 (2020).
    """

    memory: int = 20
    rise: float = 1.2
    resume: float = 0.5
    regularisation: float = 1e-10

    def __post_init__(self) -> None:
        require_positive(**vars(self))
