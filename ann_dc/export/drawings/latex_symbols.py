"""LaTeX symbols of nodes and numbers: escaped user names with Greek letters."""

from __future__ import annotations

import re

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.export.drawings.labels import short_names
from ann_dc.network.cell import ONE, Block, Function
from ann_dc.network.functions import ELEMENTARY, function_block, lacking, written
from ann_dc.network.network import Network

PLAIN = ("q", "u")
"""Populations whose neurons have the names of the user's variables."""
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
"""Placeholder of the stage in a node's symbol."""
SPECIAL = {
    "\\": r"\backslash ", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "%": r"\%", "_": r"\_", "^": r"\wedge ", "~": r"\sim ", " ": r"\ ", "-": "{-}",
    INDEX: r"\mathrm{at}",
}  # fmt: skip
FORMS = {name: rf"\{command}({{}})" for command, name in ELEMENTARY.items()}
FORMS |= {"add": "{} + {}", "subtract": "{} - {}", "multiply": r"{} \cdot {}"}
FORMS |= {"divide": r"\frac{{{}}}{{{}}}", "sqrt": r"\sqrt{{{}}}", "maximum": r"\max({1}, {0})"}
"""Operations of formulas in LaTeX."""


def symbols_of(network: Network) -> dict[str, str]:
    """Return every node in LaTeX, with `INDEX` for its stage (none for shared nodes)."""
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
    """Insert stage k plus an offset into a node's symbol."""
    return symbol.replace(INDEX, f"k{offset:+d}" if offset else "k")


def is_inline(block: Block) -> bool:
    """Return True if a block is named by its expression, such as cos(phi), and needs no symbol."""
    return isinstance(block, Function) and block.name.startswith(f"{block.function}(")


def applied(function: str, x: str) -> str:
    """Return a function of ``x`` in LaTeX; raises `ExportError` if its formula has a choice."""
    tree = function_block(function).trees[0]
    lacked = lacking(tree, FORMS)
    if lacked:
        raise ExportError(
            f"latex: function block {function!r} has the operation {lacked!r}; its formula can "
            f"be written with {', '.join(FORMS)}"
        )
    return written(tree, {"x": x}, FORMS, number)


def _letter(name: str) -> str:
    """Return a name as a braced symbol: Greek, one letter, or an upright word, with subscripts."""
    head, _, low = name.partition("_")
    if head and low:
        return f"{{{_letter(head)}_{_letter(low)}}}"
    plain = LETTERS.get(name, name)
    if plain in GREEK:
        return rf"{{\{plain}}}"
    text = escaped(name)
    return f"{{{text}}}" if len(name) == 1 else rf"{{\mathrm{{{text}}}}}"


def escaped(text: str) -> str:
    r"""Escape a text for LaTeX mathematics.

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
    """Format a number, or the range of the stages' numbers."""
    low, high = np.min(values), np.max(values)
    return number(low) if low == high else rf"{number(low)} \dots {number(high)}"


def number(value: float) -> str:
    """Format a number with six digits."""
    if not np.isfinite(value):
        return r"-\infty" if value < 0 else r"\infty"
    mantissa, _, power = f"{value + 0.0:.6g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(power)}}}" if power else mantissa
