"""Multiplier neurons of equalities, inequalities and objectives, and their nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ONE = "one"
"""Source of every bias: a node whose value is 1."""


def wire_name(source: str, target: str, where: str = "") -> str:
    """Return the connection name of two nodes; ``where`` is the source's cell suffix."""
    return f"{target}<-{source}{where}"


@dataclass(frozen=True, kw_only=True, eq=False)
class PIDual:
    """Nodes of a PI multiplier neuron, m = mu + rho c.

    The augmentation rho/2 |c|^2 of the Lagrangian needs no additional wire: every reader of the
    multiplier reads ``multiplier``, and rho is the weight of its connection from ``residual``.

    Attributes
    ----------
    neuron : str
        Integrator mu of the residual.
    residual : str
        Sum c, which the constraint makes zero.
    multiplier : str
        Sum m, which all other nodes read.

    References
    ----------
    .. [1] J. C. Platt, A. H. Barr, Constrained differential optimization, Neural Information
       Processing Systems, 1987.
    """

    neuron: str
    residual: str
    multiplier: str

    @property
    def path(self) -> str:
        """Name of the connection with the weight rho."""
        return wire_name(self.residual, self.multiplier)


@dataclass(frozen=True, kw_only=True, eq=False)
class InequalityDual:
    r"""Nodes of a rectifying multiplier neuron, m = max(0, z + w g), for a row g <= 0.

    .. math:: \tau\, \dot z = (m - z) / w ,

    which is g if the rectifier conducts and a leak, -z / w, if it does not. In the second case z
    and m vanish with one time constant, tau w. Like rho of a PI multiplier neuron, w augments the
    Lagrangian.

    The multiplier of a soft row g <= 0 is limited by the penalty weight P, m = min(P, max(0, z + w
    g)). With the compliance d, g - d z replaces g. The equilibrium is m = z, g = d z below P, and m
    = z = P if the violation is larger. As a circuit, this is one amplifier with a resistor across
    its integrator, clamped on both sides.

    Attributes
    ----------
    neuron : str
        Integrator z.
    residual : str
        Sum g, which must not be positive; for a compliant row, g - d z.
    sum : str
        Sum z + w g.
    multiplier : str
        Multiplier m, which all other nodes read: the rectified sum minus the rectified excess.
    excess : str
        Sum z + w g - P, positive at the penalty weight; empty if there is none.

    References
    ----------
    .. [1] R. T. Rockafellar, The multiplier method of Hestenes and Powell applied to convex
       programming, Journal of Optimization Theory and Applications 12, 1973, 555-562.
    """

    neuron: str
    residual: str
    sum: str
    multiplier: str
    excess: str = ""

    @property
    def path(self) -> str:
        """Name of the connection with the weight w."""
        return wire_name(self.residual, self.sum)

    @property
    def leak(self) -> str:
        """Name of the connection with the weight -d; absent for a row without compliance."""
        return wire_name(self.neuron, self.residual)

    @property
    def rail(self) -> str:
        """Name of the connection with the weight -P; absent without a penalty weight."""
        return wire_name(ONE, self.excess)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the blocks."""
        excess = (self.excess,) if self.excess else ()
        return self.residual, self.sum, *excess, self.multiplier

    def weights(self, w: float) -> dict[str, float]:
        """Return the connection weights by name; z is constant without a path (w = 0)."""
        pull = 1.0 / w if w > 0 else 0.0
        ends = {self.multiplier: pull, self.neuron: -pull}
        wires = {wire_name(s, self.neuron): pull for s, pull in ends.items()}
        return {self.path: w, **wires}


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectiveDual:
    r"""Nodes of an objective of a minimax problem: a row J - E <= 0.

    .. math::
        \zeta = \max(0, z + r (J - E)), \qquad \tau_z \dot z = \zeta - z, \qquad
        \tau_J \dot J = \sum_k l_k - J, \qquad \tau_E \dot E = \sum_i \zeta_i - 1 .

    The neurons z, J and E are shared by all cells; the blocks exist in each cell.

    At a temperature T > 0 the maximum is softened: z is the logarithm of zeta and leaks,

    .. math::
        s = z + r (J - E - T z), \qquad \zeta = \exp(s), \qquad \tau_z \dot z = s - z ,

    with the equilibrium zeta = exp((J - E) / T), E = T log sum_i exp(J_i / T).

    Attributes
    ----------
    neuron : str
        Neuron z.
    measure : str
        Neuron J, which measures the objective.
    level : str
        Neuron E, the upper level of all objectives; common to all.
    residual : str
        Sum J - E, minus T z at a temperature.
    sum : str
        Sum s = z + r (J - E - T z).
    multiplier : str
        Coefficient zeta of the objective in the cost.
    curve : str
        Function of the multiplier: ``rectify``, or ``exp`` at a temperature.

    References
    ----------
    Paper equation (6); at a temperature

    .. [1] J. Lazzaro, S. Ryckebusch, M. A. Mahowald, C. A. Mead, Winner-take-all networks of O(N)
       complexity, Neural Information Processing Systems, 1988.
    """

    neuron: str
    measure: str
    level: str
    residual: str
    sum: str
    multiplier: str
    curve: str = "rectify"

    @property
    def path(self) -> str:
        """Name of the connection with the weight r."""
        return wire_name(self.residual, self.sum)

    @property
    def is_softened(self) -> bool:
        """True if there is a temperature."""
        return self.curve == "exp"

    @property
    def followed(self) -> str:
        """Name of the node that z follows."""
        return self.sum if self.is_softened else self.multiplier

    @property
    def leak(self) -> str:
        """Name of the connection with the weight -T; absent without a temperature."""
        return wire_name(self.neuron, self.residual)

    def at_rest(self, share: float) -> float:
        """Return the equilibrium z for a coefficient zeta of the objective."""
        return float(np.log(share)) if self.is_softened else share

    @property
    def neurons(self) -> tuple[str, str, str]:
        """Names of the neurons."""
        return self.neuron, self.measure, self.level

    @property
    def nodes(self) -> tuple[str, str, str]:
        """Names of the blocks."""
        return self.residual, self.sum, self.multiplier
