"""Stage equations to look at: plain text and LaTeX, with the user's own names."""

from __future__ import annotations

from typing import Any

import sympy as sp

from ann_dc.decomposition.equations import StageEquations

_GROUPS = (
    ("(11)", "grad_q"),
    ("(12)", "grad_u"),
    ("(13)", "grad_mu"),
    ("(14)", "grad_t"),
    ("(15)", "grad_beta"),
)


def as_text(equations: StageEquations) -> str:
    """The Lagrangian and the equations (11)-(15) of a stage as plain text, one a line.

    ``t_prev_x`` is t_{k-1} and ``beta_next_x`` is beta_{k+1}; each line also says what the neuron
    does with its equation.
    """
    lines = [f"form: {equations.form}", f"L_k = {_short(equations.lagrangian)}"]
    for number, field in _GROUPS:
        for equation in getattr(equations, field):
            sign = "-" if equation.sign < 0 else "+"
            lines.append(
                f"{number} tau d{equation.variable}/ds = {sign}( {_short(equation.expression)} )"
            )
    return "\n".join(lines)


def as_latex(equations: StageEquations) -> str:
    """The same as a LaTeX ``align*`` environment, with stage indices as subscripts."""
    names = _latex_names(equations)
    printed = lambda e: sp.latex(_short(e), symbol_names=names)  # noqa: E731
    lines = [rf"L_k &= {printed(equations.lagrangian)} \\"]
    for number, field in _GROUPS:
        for equation in getattr(equations, field):
            left = rf"\frac{{\partial L}}{{\partial {names[equation.variable]}}}"
            lines.append(rf"{left} &= {printed(equation.expression)} \tag*{{{number}}} \\")
    return "\n".join([r"\begin{align*}", *lines, r"\end{align*}"])


def _short(expression: sp.Expr) -> Any:
    """Numbers to six digits: this is for reading."""
    return expression.xreplace({n: sp.Float(f"{float(n):.6g}") for n in expression.atoms(sp.Float)})


def _latex_names(equations: StageEquations) -> dict[sp.Symbol, str]:
    problem = equations.problem
    names = {s: f"{_letter(s)}_{{k}}" for s in (*problem.states, *problem.controls)}
    names |= {s: f"{_letter(s)}_{{k}}" for s in problem.inputs}
    groups = (
        (equations.t, "t", "k"),
        (equations.mu, r"\mu", "k"),
        (equations.beta, r"\beta", "k"),
        (equations.t_neighbour, "t", "k+1" if equations.form.coupling_reads_next else "k-1"),
        (equations.beta_next, r"\beta", "k+1"),
    )
    for symbols, letter, index in groups:
        for symbol, state in zip(symbols, problem.states):
            names[symbol] = f"{letter}^{{{_letter(state)}}}_{{{index}}}"
    return names


def _letter(symbol: sp.Symbol) -> str:
    """Greek and single letters as they are, words upright; braced, to take an index."""
    text = sp.latex(symbol)
    return rf"\mathrm{{{text}}}" if text.isalpha() and len(text) > 1 else f"{{{text}}}"
