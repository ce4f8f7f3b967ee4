"""Second-order test: a sufficient Cholesky test, then the test by stages.

Strongly active inequalities must hold as equations. A weakly active inequality may be left on one
side. If the Hessian is positive without it, the point is a strict minimum. If the Hessian is not
positive even with it, the point is not a minimum. Otherwise the result is open. A soft constraint
is not an equation: at its penalty weight it is a cost, P g, and below it, if compliant, a curvature
G' G / d.
"""

from __future__ import annotations

import numpy as np

from ann_dc.optimality.augmented import is_clearly_strict
from ann_dc.optimality.by_stages import Minimum, counted
from ann_dc.optimality.expansion import Expansion


def minimum_of(expansion: Expansion) -> Minimum:
    """Return the sign of the Hessian on the tangent space of the constraints.

    The Hessian is that of the Lagrangian; the result is `NOT_CHECKED` if it is not finite.
    """
    expansion = expansion.condensed()
    curvatures = expansion.jacobian, expansion.hessian, expansion.end_hessian
    if not all(np.isfinite(values).all() for values in curvatures):
        return Minimum.NOT_CHECKED
    held, touching = expansion.active_rows()
    if touching.size and not np.isfinite(touching).all():
        return Minimum.NOT_CHECKED
    if is_clearly_strict(expansion, held):
        return Minimum.STRICT
    return minimum_by_stages(expansion)


def minimum_by_stages(expansion: Expansion) -> Minimum:
    """Return the result of `minimum_of` without the sufficient Cholesky test.

    The expansion must be finite.
    """
    held, touching = expansion.active_rows()
    found = counted(expansion, held)
    if found is Minimum.STRICT or np.array_equal(held, touching):
        return found
    found = counted(expansion, touching)
    return found if found is Minimum.NOT_A_MINIMUM else Minimum.NOT_SHOWN
