r"""The equations of a network as LaTeX: what every neuron and block of a cell adds up.

.. math:: \tau\, \frac{dx}{ds} = \sum_e w_e\, s_e .

A neuron ``mu.phi`` of stage k is :math:`\mu^{\varphi}_k` and a state ``q.phi`` just
:math:`\varphi_k`, as in the stage equations; products are numbered. All follows from the network
alone, so that one that was loaded has its equations too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings.checking import VECTOR, read_vector
from ann_dc.export.drawings.labels import short_names
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.export.weights.hashes import content_hash, wiring_hash
from ann_dc.hints.checked import checked
from ann_dc.network.cell import ONE, Block, Connection, Product, Sum
from ann_dc.network.network import Network

TEX = "equations.tex"
PLAIN = ("q", "u")
"""Populations whose neurons are called as the user's own variables."""
TERMS = 4
"""Terms of a sum in a line."""

SMALL = (
    "alpha beta gamma delta epsilon varepsilon zeta eta theta vartheta iota kappa lambda mu nu xi "
    "pi rho sigma tau upsilon phi varphi chi psi omega"
)
CAPITAL = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
GREEK = {*SMALL.split(), *CAPITAL.split()}
LETTERS = dict(zip("αβγδϵεζηθϑικλμνξπρστυϕφχψωΓΔΘΛΞΠΣΥΦΨΩ", f"{SMALL} {CAPITAL}".split()))
"""Greek letters as LaTeX calls them."""
INDEX = "@"
"""Where a stage stands in a node's symbol."""
SPECIAL = {
    "\\": r"\backslash ", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "%": r"\%", "_": r"\_", "^": r"\hat{\ }", "~": r"\sim ", " ": r"\ ", "-": "{-}",
    INDEX: r"\mathrm{at}",
}  # fmt: skip
PLAIN_FUNCTIONS = "sin cos tan exp log tanh sinh cosh"
FUNCTIONS = {name: rf"\{name}" for name in PLAIN_FUNCTIONS.split()}
FUNCTIONS |= {"atan": r"\arctan", "asin": r"\arcsin", "acos": r"\arccos"}
COMMANDS = (
    "documentclass usepackage allowdisplaybreaks begin end section hline endhead qquad frac sqrt "
    "mathrm sum max infty dots cdot backslash hat sim"
)
WORDS = {*COMMANDS.split(), *GREEK, *(word.removeprefix("\\") for word in FUNCTIONS.values())}
"""Every command that such a file uses; a file with another one is none of ours."""


@checked
def latex_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    r"""The equations of a cell as a document, with tables of weights, time constants and inputs.

    It needs no more than ``amsmath``, ``longtable`` and ``geometry``. Numbers are in network
    units; those that differ from stage to stage are told by their range.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network.

    Returns
    -------
    dict of str to bytes
        ``equations.tex`` and ``reference_vector.json``.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    >>> files = latex_files(network, reference_vector(network))
    >>> lines = files["equations.tex"].decode().splitlines()
    >>> print(*(line for line in lines if "d {a}_{k}" in line))
    \tau\,\frac{d {a}_{k}}{ds} &= -{a}_{k} - {m}^{{v}}_{k} \\
    >>> latex_check(files)
    'equations of 9 neurons, of the network of the reference vector'
    """
    text = "\n".join(_document(network))
    return {TEX: (text + "\n").encode("ascii"), VECTOR: vector.as_json()}


@checked
def latex_check(files: Mapping[str, bytes]) -> str:
    """Whether equations are whole, safe to typeset, and of the network of the reference vector.

    Parameters
    ----------
    files : mapping of file name to bytes
        As `latex_files` gives them.

    Returns
    -------
    str
        What was found.

    Raises
    ------
    FileFormatError
        If a file is missing, braces or environments do not match, a command is none that such
        files use, or the equations are of another network.
    """
    vector = read_vector(files)
    if set(files) != {TEX, VECTOR}:
        raise FileFormatError(f"expected {TEX} and {VECTOR}, got {', '.join(sorted(files)):.200}")
    try:
        text = files[TEX].decode("ascii")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{TEX}: not plain ASCII: {error}") from error
    head = dict(re.findall(r"^% (wiring|content): ([0-9a-f]{64})$", text, re.MULTILINE))
    if head != {"wiring": vector.wiring, "content": vector.content}:
        raise FileFormatError(f"{TEX}: its hashes are not those of {VECTOR}; export them together")
    _check_structure(text)
    count = len(re.findall(r"^\\tau\\,\\frac", text, re.MULTILINE))
    if count != len(vector.start):
        raise FileFormatError(f"{TEX}: {count} neurons, but the network has {len(vector.start)}")
    return f"equations of {count} neurons, of the network of the reference vector"


TOKEN = re.compile(r"\\([A-Za-z]+|.|\Z)|(?m:%.*$)|[{}$]", re.DOTALL)


def _check_structure(text: str) -> None:
    """Refuse what does not match: braces, dollars, environments, and unknown commands."""
    open_ones: list[str] = []
    for token in TOKEN.finditer(text):
        word, sign = token[1], token[0]
        if word in ("begin", "end"):
            name = re.compile(r"\{([a-z*]+)\}").match(text, token.end())
            _match(open_ones, word == "begin", name[1] if name else "?")
        elif word and word.isalpha() and word not in WORDS:
            raise FileFormatError(f"{TEX}: the command \\{word:.40} is none of ours")
        elif sign in "{}":
            _match(open_ones, sign == "{", "brace")
        elif sign == "$":
            _match(open_ones, open_ones[-1:] != ["$"], "$")
    if open_ones:
        raise FileFormatError(f"{TEX}: {open_ones[-1]} is not closed")


def _match(open_ones: list[str], opens: bool, name: str) -> None:
    if opens:
        open_ones.append(name)
    elif not open_ones or open_ones.pop() != name:
        raise FileFormatError(f"{TEX}: {name} is closed where it is not open")


# ---- the document --------------------------------------------------------------------------------


def _document(network: Network) -> Iterator[str]:
    names = _symbols(network)
    yield from (
        f"% wiring: {wiring_hash(network)}",
        f"% content: {content_hash(network)}",
        r"\documentclass{article}",
        r"\usepackage{amsmath}",
        r"\usepackage{longtable}",
        r"\usepackage[margin=20mm]{geometry}",
        r"\allowdisplaybreaks",
        r"\begin{document}",
        rf"\section*{{$\mathrm{{{escaped(network.title)}}}$}}",
        rf"A row of {network.stages} cells; the equations of cell $k$, in network units.",
        r"\section*{Neurons}",
        r"\begin{align*}",
    )
    for neuron in network.cell.neurons:
        rows = _sum(network, neuron.name, names)
        if neuron.shared:
            rows = rf"\sum_k [ {rows} ]"
        yield rf"\tau\,\frac{{d {_at(names[neuron.name])}}}{{ds}} &= {rows} \\"
    yield r"\end{align*}"
    if network.cell.blocks:
        yield r"\section*{Blocks}"
        yield r"\begin{align*}"
        for block in network.cell.blocks:
            yield rf"{_at(names[block.name])} &= {_formula(network, block, names)} \\"
        yield r"\end{align*}"
    yield from _neuron_table(network, names)
    yield from _weight_table(network, names)
    yield from _ends(network, names)
    yield r"\end{document}"


def _formula(network: Network, block: Block, names: Mapping[str, str]) -> str:
    if isinstance(block, Sum):
        return _sum(network, block.name, names)
    if isinstance(block, Product):
        return rf"{_at(names[block.a])}\,{_at(names[block.b])}"
    x = _at(names[block.x])
    if block.function == "rectify":
        return rf"\max(0, {x})"
    if block.function == "sqrt":
        return rf"\sqrt{{{x}}}"
    if block.function == "reciprocal":
        return rf"\frac{{1}}{{{x}}}"
    return rf"{FUNCTIONS[block.function]}({x})"


def _sum(network: Network, target: str, names: Mapping[str, str]) -> str:
    """What arrives at a node, a few terms a line."""
    wires = [
        (number, wire)
        for number, wire in enumerate(network.cell.connections, 1)
        if wire.target == target
    ]
    terms = [_term(*wire, names, not place) for place, wire in enumerate(wires)] or ["0"]
    lines = [" ".join(terms[i : i + TERMS]) for i in range(0, len(terms), TERMS)]
    return " \\\\\n&\\qquad ".join(lines)


def _term(number: int, wire: Connection, names: Mapping[str, str], first: bool) -> str:
    weight = np.atleast_1d(np.asarray(wire.weight, float))
    source = _at(names[wire.source], int(wire.template))
    factor, sign = rf"w_{{{number},k}}", "+"
    if not np.ptp(weight):
        factor, sign = _number(abs(weight[0])), "-" if weight[0] < 0 else "+"
    lead = f"{sign} " if not first else "-" if sign == "-" else ""
    if wire.source == ONE:
        return f"{lead}{factor}"
    return f"{lead}{source}" if factor == "1" else rf"{lead}{factor}\,{source}"


def _at(symbol: str, offset: int = 0) -> str:
    """A node's symbol, of a stage so far from k."""
    return symbol.replace(INDEX, f"k{offset:+d}" if offset else "k")


def _neuron_table(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    yield r"\section*{Time constants and rails}"
    yield r"\begin{longtable}{lllll}"
    yield r"neuron & role & $\tau$ & lowest & highest \\ \hline \endhead"
    for neuron in network.cell.neurons:
        rails = [f"${_number(end)}$" for end in (neuron.limiter.low, neuron.limiter.high)]
        role = neuron.role.value + (", shared" if neuron.shared else "")
        cells = (f"${_at(names[neuron.name])}$", role, f"${_range(neuron.tau)}$", *rails)
        yield " & ".join(cells) + r" \\"
    yield r"\end{longtable}"


def _weight_table(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    yield r"\section*{Weights}"
    yield r"\begin{longtable}{rlll}"
    yield r"number & target & source & weight \\ \hline \endhead"
    for number, wire in enumerate(network.cell.connections, 1):
        source = _at(names[wire.source], int(wire.template))
        ends = f"${_at(names[wire.target])}$ & ${source}$"
        yield rf"{number} & {ends} & ${_range(wire.weight)}$ \\"
    yield r"\end{longtable}"


def _ends(network: Network, names: Mapping[str, str]) -> Iterator[str]:
    """Inputs, and what the ends of the row are."""
    if network.cell.inputs:
        yield r"\section*{Inputs}"
        yield r"\begin{longtable}{ll}"
        yield r"input & value \\ \hline \endhead"
        for name in network.cell.inputs:
            yield rf"${_at(names[name])}$ & ${_range(network.input_values[name])}$ \\"
        yield r"\end{longtable}"
    if network.pins or network.absent or network.left:
        yield r"\section*{Ends of the row}"
        yield r"\begin{longtable}{ll}"
        at = lambda name, stage: names[name].replace(INDEX, str(stage))  # noqa: E731
        for pin in network.pins:
            yield rf"${at(pin.neuron, pin.stage)}$ & $= {at(pin.input, pin.stage)}$ \\"
        for gone in network.absent:
            yield rf"${at(gone.neuron, gone.stage)}$ & is absent \\"
        for node, given in network.left.items():
            yield rf"${at(node, -1)}$ & $= {at(given, 0)}$ \\"
        yield r"\end{longtable}"


def _symbols(network: Network) -> dict[str, str]:
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
    return found


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
    >>> print(escaped("torque_s"), escaped("50%"), escaped("ω"))
    torque\_s 50\% \omega
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


def _range(values: float | np.ndarray) -> str:
    low, high = np.min(values), np.max(values)
    return _number(low) if low == high else rf"{_number(low)} \dots {_number(high)}"


def _number(value: float) -> str:
    if not np.isfinite(value):
        return r"-\infty" if value < 0 else r"\infty"
    mantissa, _, power = f"{value + 0.0:.6g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(power)}}}" if power else mantissa
