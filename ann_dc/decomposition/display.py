"""Stage equations to look at: plain text and LaTeX, with the user's own names."""

from __future__ import annotations

import sympy as sp

from ann_dc.decomposition.equations import StageEquations, Stationarity

_TITLES = (
    ("(11)", "grad_q", r"\nabla_{q_k} L"),
    ("(12)", "grad_u", r"\nabla_{u_k} L"),
    ("(13)", "grad_mu", r"\nabla_{\mu_k} L"),
    ("(14)", "grad_t", r"\nabla_{t_k} L"),
    ("(15)", "grad_beta", r"\nabla_{\beta_k} L"),
)


def as_text(equations: StageEquations) -> str:
    """The Lagrangian and the equations (11)-(15) of a stage as plain text, one a line.

    ``t_prev_x`` is t_{k-1} and ``beta_next_x`` is beta_{k+1}; each line also says what the neuron
    does with its equation.
    """
    lines = [f"form: {equations.form}", f"L_k = {_short(equations.lagrangian)}"]
    for number, field, _ in _TITLES:
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
    for number, field, title in _TITLES:
        for equation in getattr(equations, field):
            tag = rf"\tag*{{{number}}} \\"
            lines.append(
                f"{_component(title, equation, names)} &= {printed(equation.expression)} {tag}"
            )
    return "\n".join([r"\begin{align*}", *lines, r"\end{align*}"])


def _component(title: str, equation: Stationarity, names: dict) -> str:
    return title.replace("L", f"L_{{[{names[equation.variable]}]}}")


def _short(expression: sp.Expr) -> sp.Expr:
    """Numbers to six digits: this is for reading."""
    return sp.nsimplify(
        expression.xreplace({n: sp.Float(f"{float(n):.6g}") for n in expression.atoms(sp.Float)}),
        rational=False,
    )


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
    return sp.latex(symbol)
