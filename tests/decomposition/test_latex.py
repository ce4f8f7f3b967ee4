"""Stage equations as LaTeX."""

import sympy as sp

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.latex import as_latex
from ann_dc.problem.declaration import OptimalControlProblem


def test_names_and_numbers_of_the_paper():
    x, phi, drive = sp.symbols("x phi drive")
    problem = OptimalControlProblem(
        states=(x, phi), controls=(drive,), map=(x + sp.cos(phi), phi + drive),
        cost=drive**2 / 2, horizon=3, q_0=(0, 0),
    )  # fmt: skip
    text = as_latex(decompose(problem))
    assert text.startswith("\\begin{align*}\nL_k &= ")
    assert text.endswith("\\end{align*}")
    assert (
        r"\frac{\partial L}{\partial \mathrm{drive}_{k}} &= "
        r"\mathrm{drive}_{k} + \mu^{{\phi}}_{k} \tag*{(12)} \\"
    ) in text
    for number in range(11, 16):
        assert rf"\tag*{{({number})}}" in text
    assert r"t^{{x}}_{k-1}" in text
    assert r"\beta^{{x}}_{k+1}" in text
