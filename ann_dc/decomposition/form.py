"""Forms of the stage equations: corrected, or with selected errata of the paper.

The fields of `Form` are the switches S1-S17 that change the correct equations into those printed in
the paper. The default of every field is correct.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from ann_dc.conversion import declare_words
from ann_dc.errors import UnknownNameError, such_as
from ann_dc.validation import checked


class CostWeight(enum.Enum):
    """Factor of E in a stage's Lagrangian (10), (25).

    ``TOTAL`` is 1, the correct factor; ``MEAN`` is 1/N, as in (10); ``COPIES`` is N, as in (25).
    """

    TOTAL = "1"
    MEAN = "1/N"
    COPIES = "N"


class LowerForm(enum.Enum):
    """Solution of the lower level: (16), or closed form (30) of the paper's example.

    ``CLOSED`` is (30) with corrected signs: mu_k = -beta_{k+1} and q_k = t_{k-1}, which are
    equations of the coordinator. ``LITERAL`` is (30) as printed: mu_k = beta_{k+1}, q_k = t_{k-1} /
    0.99 and u_k = B^T mu_k / dt.
    """

    ITERATED = "(16)"
    CLOSED = "(30), signs corrected"
    LITERAL = "(30) as printed"


@such_as("ann_dc.CORRECTED")
@checked
@dataclass(frozen=True, kw_only=True)
class Form:
    """Form of the stage equations (11)-(17).

    Attributes
    ----------
    primal_ascends : bool
        S1: q and u follow the positive gradient, as in (16).
    dual_descends : bool
        S2: beta follows its negative residual, as in (20).
    without_control_jacobian : bool
        S3: the term d(Bu)/dq is missing from (11).
    damping_without_dt : bool
        S4: 1 - gamma instead of 1 - gamma dt.
    control_reads_state_cost : bool
        S5: dE/dq instead of dE/du in (12).
    control_without_dt : bool
        S6: B without dt in (12), (13).
    coupling_coefficient : float
        S7: factor 0.99 (25) or 0.55 (27) of q_k in the coupling q_k - t_{k-1}.
    coupling_adds : bool
        S8: q_k + t_{k-1}, as in (15).
    coupling_reads_next : bool
        S9: t_{k+1} instead of t_{k-1}, as in (17).
    target_adds : bool
        S10: -mu_k + beta_{k+1}, as in (14).
    printed_ranges : bool
        S11: u and mu from k = 1, beta up to k = N - 2, as in (16), (17).
    cost_weight : CostWeight
        S12: 1 (correct), 1/N (10), N copies (25).
    terminal_free : bool
        S13: mu_{N-1} = 0 (27), without the terminal condition (5), (7).
    start_is_neuron : bool
        S14: q_0 is a neuron, tied by its multiplier beta_0 to t_{-1} := q_init. Not an erratum:
        both closings of the chain solve the problem.
    lower_level : LowerForm
        S15: solved by (30), which uses equations of the coordinator; S17: by (30) as printed.
    oracle_gain : bool
        S16: the rate of t and beta follows ``|B/A|`` (33), which needs the solution.

    References
    ----------
    Paper equations (5), (7), (10)-(17), (20), (25), (27), (30), (33).

    Examples
    --------
    >>> form = Form(without_control_jacobian=True)
    >>> print(form)
    with S3
    >>> form == switch("S3"), Form() == CORRECTED
    (True, True)
    >>> print(Form(coupling_coefficient=0.55, cost_weight=CostWeight.MEAN))
    with S7 (0.55), S12 (1/N)
    """

    primal_ascends: bool = False
    dual_descends: bool = False
    without_control_jacobian: bool = False
    damping_without_dt: bool = False
    control_reads_state_cost: bool = False
    control_without_dt: bool = False
    coupling_coefficient: float = 1.0
    coupling_adds: bool = False
    coupling_reads_next: bool = False
    target_adds: bool = False
    printed_ranges: bool = False
    cost_weight: CostWeight = CostWeight.TOTAL
    terminal_free: bool = False
    start_is_neuron: bool = False
    lower_level: LowerForm = LowerForm.ITERATED
    oracle_gain: bool = False

    @property
    def closed_lower_level(self) -> bool:
        """True if (30) replaces (11)-(13)."""
        return self.lower_level is not LowerForm.ITERATED

    @property
    def designable(self) -> Form:
        """Corrected form with the same closing of the chain; its gains suit this form.

        Gains can only be designed at an equilibrium, which a form with errata may not have.
        """
        return Form(start_is_neuron=self.start_is_neuron, terminal_free=self.terminal_free)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the equations of q, u, mu, t and beta in the paper.

        These are (11)-(15), or (16) and (17) in the form that iterates them as printed; a closed
        lower level takes (30).
        """
        if self.primal_ascends and self.coupling_reads_next:
            return 16, 16, 16, 17, 17
        if self.closed_lower_level:
            return 30, 30 if self.lower_level is LowerForm.LITERAL else 12, 30, 14, 15
        return 11, 12, 13, 14, 15

    def __str__(self) -> str:
        changed = {
            _switch_of(*item): item[1] for item in vars(self).items() if item not in _HOLDING
        }
        used = [name + _value_text(changed[name]) for name in SWITCHES if name in changed]
        return "corrected" if self == CORRECTED else f"with {', '.join(used)}"


CORRECTED = Form()
"""Correct equations."""

PRINTED = Form(
    primal_ascends=True,
    without_control_jacobian=True,
    damping_without_dt=True,
    control_reads_state_cost=True,
    control_without_dt=True,
    coupling_adds=True,
    coupling_reads_next=True,
    printed_ranges=True,
    cost_weight=CostWeight.MEAN,
)
"""Equations (16) and (17) as printed."""

PRINTED_CONDITIONS = Form(
    without_control_jacobian=True,
    damping_without_dt=True,
    control_reads_state_cost=True,
    control_without_dt=True,
    coupling_adds=True,
    target_adds=True,
    cost_weight=CostWeight.MEAN,
)
"""Stationarity conditions (11)-(15) as printed, followed in the correct directions."""

PRINTED_EXAMPLE = Form(coupling_coefficient=0.99, cost_weight=CostWeight.COPIES)
"""Lagrangian (24), (25) of the numerical application as printed."""

SWITCHES: dict[str, Form] = {
    "S1": replace(CORRECTED, primal_ascends=True),
    "S2": replace(CORRECTED, dual_descends=True),
    "S3": replace(CORRECTED, without_control_jacobian=True),
    "S4": replace(CORRECTED, damping_without_dt=True),
    "S5": replace(CORRECTED, control_reads_state_cost=True),
    "S6": replace(CORRECTED, control_without_dt=True),
    "S7": replace(CORRECTED, coupling_coefficient=0.99),
    "S8": replace(CORRECTED, coupling_adds=True),
    "S9": replace(CORRECTED, coupling_reads_next=True),
    "S10": replace(CORRECTED, target_adds=True),
    "S11": replace(CORRECTED, printed_ranges=True),
    "S12": replace(CORRECTED, cost_weight=CostWeight.MEAN),
    "S13": replace(CORRECTED, terminal_free=True),
    "S14": replace(CORRECTED, start_is_neuron=True),
    "S15": replace(CORRECTED, lower_level=LowerForm.CLOSED),
    "S16": replace(CORRECTED, oracle_gain=True),
    "S17": replace(CORRECTED, lower_level=LowerForm.LITERAL),
}
"""Forms with a single switch, otherwise correct."""

FORMS: dict[str, Form] = {
    "corrected": CORRECTED,
    "printed": PRINTED,
    "printed-conditions": PRINTED_CONDITIONS,
    "printed-example": PRINTED_EXAMPLE,
    **SWITCHES,
}
"""Forms by their names in Python, on the command line and in studies."""
declare_words(Form, FORMS)


@checked
def switch(name: str) -> Form:
    """Return the form with a single switch set, otherwise correct.

    Parameters
    ----------
    name : str
        ``"S1"`` to ``"S17"``, the keys of `SWITCHES`.

    Returns
    -------
    Form

    Raises
    ------
    UnknownNameError
        If the switch is unknown; the message lists the existing ones.

    Examples
    --------
    >>> switch("S7").coupling_coefficient
    0.99
    """
    if name not in SWITCHES:
        raise UnknownNameError.of("switch", name, SWITCHES)
    return SWITCHES[name]


_HOLDING = vars(CORRECTED).items()


def _value_text(value: object) -> str:
    """Return the value of a switch that has several values, in parentheses."""
    if isinstance(value, CostWeight):
        return f" ({value.value})"
    return "" if isinstance(value, (bool, LowerForm)) else f" ({value:g})"


def _switch_of(key: str, value: object) -> str:
    """Return the switch that sets a field to a value, or the first of the field."""
    turning = {name: vars(form)[key] for name, form in SWITCHES.items()}
    turning = {name: to for name, to in turning.items() if to != vars(CORRECTED)[key]}
    return next((name for name, to in turning.items() if to == value), next(iter(turning)))
