r"""Stage equations as LaTeX, with the user's names and the paper's numbers.

A state phi of stage k is :math:`\phi_k`, its multiplier :math:`\mu^{\phi}_k`, and values read from
a neighbour have that stage's index. The string form of stage equations is plain text.
"""

from __future__ import annotations

import numpy as np
import sympy as sp

from ann_dc.decomposition.equations import InequalityRow, StageEquations, rounded
from ann_dc.validation import checked


@checked
def as_latex(equations: StageEquations) -> str:
    r"""Return Lagrangian, equations (11)-(15) and rows of a stage as ``align*``.

    References
    ----------
    Paper equations (10)-(15).

    Examples
    --------
    >>> from ann_dc import decompose, plants
    >>> print(as_latex(decompose(plants.double_integrator())).splitlines()[-2])
    \frac{\partial L}{\partial \beta^{{v}}_{k}} &= - t^{{v}}_{k-1} + {v}_{k} \tag*{(15)} \\
    """
    names = _latex_names(equations)
    printed = lambda e: sp.latex(rounded(e), symbol_names=names)  # noqa: E731
    lines = [rf"L_k &= {printed(equations.lagrangian)} \\"]
    for number, equation in equations.numbered:
        left = rf"\frac{{\partial L}}{{\partial {names[equation.variable]}}}"
        lines.append(rf"{left} &= {printed(equation.expression)} \tag*{{({number})}} \\")
    for row in (*equations.rows, *equations.end_rows):
        place = r" \quad (k = N-1)" if row.at_end else ""
        g = printed(row.expression)
        lines.append(rf"{_condition(row, names[row.multiplier], g)}{place} \\")
    return "\n".join([r"\begin{align*}", *lines, r"\end{align*}"])


def _condition(row: InequalityRow, zeta: str, g: str) -> str:
    """Return the condition of a row and its multiplier; soft: between zero and P."""
    if row.soft is None:
        return rf"0 &\le {zeta} \;\perp\; {g} \le 0"
    price = r"\infty" if np.isinf(row.soft.weight) else sp.latex(sp.Float(row.soft.weight, 6))
    leak = f" - {row.soft.compliance:g} {zeta}" if row.soft.compliance else ""
    return rf"{zeta} &= \min({price}, \max(0, {zeta} + {g}{leak}))"


def _latex_names(equations: StageEquations) -> dict[sp.Symbol, str]:
    problem = equations.problem
    names = {s: f"{_letter(s)}_{{k}}" for s in (*problem.states, *problem.controls)}
    names |= {s: f"{_letter(s)}_{{k}}" for s in problem.inputs}
    groups = (
        (equations.t, "t", "k"),
        (equations.mu, r"\mu", "k"),
        (equations.beta, r"\beta", "k"),
        (equations.t_neighbour, "t", "k+1"),
        (equations.t_before, "t", "k-1"),  # which are the same unless S9 is turned
        (equations.beta_next, r"\beta", "k+1"),
    )
    for symbols, letter, index in groups:
        for symbol, state in zip(symbols, problem.states):
            names[symbol] = f"{letter}^{{{_letter(state)}}}_{{{index}}}"
    for row in (*equations.rows, *equations.end_rows):
        names[row.multiplier] = rf"\zeta^{{{_letter(sp.Symbol(row.name))}}}_{{k}}"
    return names


def _letter(symbol: sp.Symbol) -> str:
    """Return a braced letter that takes an index; multi-letter names are upright.

    Greek and single letters are unchanged.
    """
    text = sp.latex(symbol)
    return rf"\mathrm{{{text}}}" if text.isalpha() and len(text) > 1 else f"{{{text}}}"
