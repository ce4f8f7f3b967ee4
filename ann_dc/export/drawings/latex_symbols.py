"""Nodes and numbers in LaTeX: the user's names, with Greek letters as such and the rest escaped."""

from __future__ import annotations

import re

import numpy as np

from ann_dc.export.drawings.labels import short_names
from ann_dc.network.cell import ONE, Block, Function
from ann_dc.network.network import Network

PLAIN = ("q", "u")
"""Populations whose neurons are called as the user's own variables."""
SMALL = (
    "alpha beta gamma delta epsilon varepsilon zeta eta theta vartheta iota kappa lambda mu nu xi "
    "pi rho sigma tau upsilon phi varphi chi psi omega"
)
CAPITAL = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
GREEK = {*SMALL.split(), *CAPITAL.split()}
LETTERS = dict(zip("αβγδϵεζηθϑικλμνξπρστυϕφχψωΓΔΘΛΞΠΣΥΦΨΩ", f"{SMALL} {CAPITAL}".split()))
LETTERS |= {"\N{MICRO SIGN}": "mu", "\N{OHM SIGN}": "Omega"}
"""Greek letters as LaTeX calls them, with the signs of micro and ohm."""
INDEX = "@"
"""Where a stage stands in a node's symbol."""
SPECIAL = {
    "\\": r"\backslash ", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "%": r"\%", "_": r"\_", "^": r"\wedge ", "~": r"\sim ", " ": r"\ ", "-": "{-}",
    INDEX: r"\mathrm{at}",
}  # fmt: skip
PLAIN_FUNCTIONS = "sin cos tan exp log tanh sinh cosh"
FUNCTIONS = {name: rf"\{name}" for name in PLAIN_FUNCTIONS.split()}
FUNCTIONS |= {"atan": r"\arctan", "asin": r"\arcsin", "acos": r"\arccos"}


def symbols_of(network: Network) -> dict[str, str]:
    """Every node in LaTeX, with `INDEX` for its stage; what all cells share has none."""
    shared = {neuron.name for neuron in network.cell.neurons if neuron.shared}
    found = {ONE: "1"}
    for name, short in short_names(network.cell).items():
        numbered = re.fullmatch(r"([psf])(\d+)", short)
        head, _, tail = name.partition(".")
        index = "" if name in shared else f"_{{{INDEX}}}"
        if numbered and short != name:
            found[name] = f"{numbered[1]}_{{{numbered[2]},{INDEX}}}"
        elif not tail:
            found[name] = f"{_letter(head)}{index}"
        elif head in PLAIN:
            found[name] = f"{_letter(tail)}{index}"
        else:
            found[name] = f"{_letter(head)}^{{{_letter(tail)}}}{index}"
    for block in network.cell.blocks:
        if isinstance(block, Function) and is_inline(block):
            found[block.name] = applied(block.function, found[block.x])
    return found


def at_stage(symbol: str, offset: int = 0) -> str:
    """A node's symbol, of a stage so far from k."""
    return symbol.replace(INDEX, f"k{offset:+d}" if offset else "k")


def is_inline(block: Block) -> bool:
    """Whether a block is named as what it computes, cos(phi), so that it needs no symbol."""
    return isinstance(block, Function) and block.name.startswith(f"{block.function}(")


def applied(function: str, x: str) -> str:
    """A function of ``x``."""
    if function == "rectify":
        return rf"\max(0, {x})"
    if function == "sqrt":
        return rf"\sqrt{{{x}}}"
    if function == "reciprocal":
        return rf"\frac{{1}}{{{x}}}"
    return rf"{FUNCTIONS.get(function) or _letter(function)}({x})"


def _letter(name: str) -> str:
    """Greek and single letters as they are, words upright, indices low; braced, to take one."""
    head, _, low = name.partition("_")
    if head and low:
        return f"{{{_letter(head)}_{_letter(low)}}}"
    plain = LETTERS.get(name, name)
    if plain in GREEK:
        return rf"{{\{plain}}}"
    text = escaped(name)
    return f"{{{text}}}" if len(name) == 1 else rf"{{\mathrm{{{text}}}}}"


def escaped(text: str) -> str:
    r"""A text that stands for itself in LaTeX's mathematics.

    Examples
    --------
    >>> print(escaped("torque_s"), escaped("50%"))
    torque\_s 50\%
    """
    return "".join(map(_safe, text))


def _safe(letter: str) -> str:
    if letter in SPECIAL:
        return SPECIAL[letter]
    if letter in LETTERS:
        return rf"\{LETTERS[letter]} "
    if letter.isascii() and letter.isprintable():
        return letter
    return f"u{ord(letter):X}"


def range_of(values: float | np.ndarray) -> str:
    """A number, or the range of those of the stages."""
    low, high = np.min(values), np.max(values)
    return number(low) if low == high else rf"{number(low)} \dots {number(high)}"


def number(value: float) -> str:
    """A number in six digits."""
    if not np.isfinite(value):
        return r"-\infty" if value < 0 else r"\infty"
    mantissa, _, power = f"{value + 0.0:.6g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(power)}}}" if power else mantissa
