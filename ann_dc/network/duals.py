"""Neurons that are multipliers of equalities, inequalities and objectives: their nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ONE = "one"
"""The source of every bias: a node whose value is 1."""


def wire_name(source: str, target: str, where: str = "") -> str:
    """Name of the connection between two nodes; ``where`` says in which cell the source is."""
    return f"{target}<-{source}{where}"


@dataclass(frozen=True, kw_only=True, eq=False)
class PIDual:
    """The three nodes of a PI dual neuron: m = mu + rho c.

    The augmentation rho/2 |c|^2 of the Lagrangian costs no wire of its own: whatever reads the
    multiplier reads ``multiplier`` instead, and rho is the weight of its connection from
    ``residual``.

    Attributes
    ----------
    neuron : str
        mu: integrates the residual.
    residual : str
        c: the sum that the constraint makes zero.
    multiplier : str
        m: the sum that everything else reads.

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
        """Name of the connection whose weight is rho."""
        return wire_name(self.residual, self.multiplier)


@dataclass(frozen=True, kw_only=True, eq=False)
class DiodeDual:
    r"""The nodes of a diode neuron, the multiplier of an inequality g <= 0: m = max(0, z + w g).

    .. math:: \tau\, \dot z = (m - z) / w ,

    which is g where the diode conducts and a leak, -z / w, where it does not: z and m vanish with
    one time constant, tau w. Like rho of a PI dual, w augments the Lagrangian.

    That of a soft row g <= 0 stops at the row's price P, m = min(P, max(0, z + w g)), and leaks,
    with g less d z in the place of g: it rests at m = z, g = d z below the price, and at m = z = P
    where the row is exceeded by more. In parts that is one amplifier with a resistor across its
    integrator, and clamped on both sides.

    Attributes
    ----------
    neuron : str
        z.
    residual : str
        g: the sum that is not to be positive; of a compliant row, g - d z.
    sum : str
        z + w g.
    multiplier : str
        m, which everything else reads: the rectifier of the sum, less that of the excess.
    excess : str
        z + w g - P: the sum that is positive at the price; empty where there is none.

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
        """Name of the connection whose weight is w."""
        return wire_name(self.residual, self.sum)

    @property
    def leak(self) -> str:
        """Name of the connection whose weight is -d; a row that is not compliant has none."""
        return wire_name(self.neuron, self.residual)

    @property
    def rail(self) -> str:
        """Name of the connection whose weight is -P; a row without a price has none."""
        return wire_name(ONE, self.excess)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of its blocks."""
        excess = (self.excess,) if self.excess else ()
        return self.residual, self.sum, *excess, self.multiplier

    def weights(self, w: float) -> dict[str, float]:
        """Weights of its connections, by name; without a path (w = 0) z stands still."""
        pull = 1.0 / w if w > 0 else 0.0
        ends = {self.multiplier: pull, self.neuron: -pull}
        wires = {wire_name(s, self.neuron): pull for s, pull in ends.items()}
        return {self.path: w, **wires}


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectiveDual:
    r"""The nodes of an objective of which the largest is minimised: a row J - E <= 0.

    .. math::
        \zeta = \max(0, z + r (J - E)), \qquad \tau_z \dot z = \zeta - z, \qquad
        \tau_J \dot J = \sum_k l_k - J, \qquad \tau_E \dot E = \sum_i \zeta_i - 1 .

    The neurons z, J and E are shared by all cells, each of which has the blocks.

    At a temperature T > 0 the largest is softened: z is the logarithm of a share and leaks,

    .. math::
        s = z + r (J - E - T z), \qquad \zeta = \exp(s), \qquad \tau_z \dot z = s - z ,

    so that it rests at zeta = exp((J - E) / T), E = T log sum_i exp(J_i / T).

    Attributes
    ----------
    neuron : str
        z.
    measure : str
        J: measures the objective.
    level : str
        E: what no objective is above; the same for all.
    residual : str
        J - E, less T z.
    sum : str
        s = z + r (J - E - T z).
    multiplier : str
        zeta: the objective's share of the cost.
    curve : str
        Of the multiplier: ``rectify``, or ``exp`` at a temperature.

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
        """Name of the connection whose weight is r."""
        return wire_name(self.residual, self.sum)

    @property
    def is_softened(self) -> bool:
        """Whether there is a temperature."""
        return self.curve == "exp"

    @property
    def followed(self) -> str:
        """Name of the node that z follows."""
        return self.sum if self.is_softened else self.multiplier

    @property
    def leak(self) -> str:
        """Name of the connection whose weight is -T; without a temperature there is none."""
        return wire_name(self.neuron, self.residual)

    def at_rest(self, share: float) -> float:
        """z where the objective has this ``share`` of the cost."""
        return float(np.log(share)) if self.is_softened else share

    @property
    def neurons(self) -> tuple[str, str, str]:
        """Names of its neurons."""
        return self.neuron, self.measure, self.level

    @property
    def nodes(self) -> tuple[str, str, str]:
        """Names of its blocks."""
        return self.residual, self.sum, self.multiplier
