r"""What is said of the second order: a quick proof where there is one, else the count by stages.

Inequalities that are strongly active have to hold as equations. One that is only weakly active may
be left on one side: where the Hessian is positive without it, the point is a strict minimum; where
it is not even positive with it, none; in between the answer remains open. A soft row is no
equation: at its price it is a cost, P g, and below it, where it is compliant, a curvature G' G / d.
"""

from __future__ import annotations

import numpy as np

from ann_dc.optimality.augmented import is_clearly_strict
from ann_dc.optimality.by_stages import Minimum, counted
from ann_dc.optimality.expansion import Expansion


def minimum_of(expansion: Expansion) -> Minimum:
    """What the Hessian of the Lagrangian says on the tangent space of the constraints.

    Parameters
    ----------
    expansion : Expansion

    Returns
    -------
    Minimum
        `NOT_CHECKED` where it is not finite.
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
    """As `minimum_of`, without looking for a short cut first.

    Parameters
    ----------
    expansion : Expansion
        Finite.
    """
    held, touching = expansion.active_rows()
    found = counted(expansion, held)
    if found is Minimum.STRICT or np.array_equal(held, touching):
        return found
    found = counted(expansion, touching)
    return found if found is Minimum.NOT_A_MINIMUM else Minimum.NOT_SHOWN
