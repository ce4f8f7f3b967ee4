"""Messages, help and labels: the word rates and the terms of the style guide.

The texts are the string constants of the package that contain two words, without docstrings.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest
from test_docstrings import MODULES, ROOT, WORDS, tree_of

ELECTRICAL = ("hardware", "backends/spice", "export/netlists", "fidelity")
"""Packages in which rails are supply rails."""

BANNED = {
    "pyramid": "additive multilevel",
    "neighbour grid": "resistive grid",
    "feed-forward tree": "cyclic reduction",
    "diode neurons?": "rectifying multiplier neuron",
    "shadow stiffness": "multiplier sensitivity",
    "fastest time constants": "tau_min",
    "rehears(?:al|als|ed|e)": "trial run",
    "recipes?": "gain rule",
    "specimens?": "circuit instance",
    "defects?": "non-ideality",
    "ladders?": "level comparison",
    "half-planes?": "linearised constraint",
    "legs?": "segment",
    "share of": "fraction of, relative to",
    "by hand": "manually",
    "pinned": "fixed",
    "repels?": "is unstable",
    "fall(?:s|en)? no further": "no longer decreases",
    "leave (?:it|them|this|one of them) out": "omit",
    "nothing says": "",
    "prospects": "feasibility",
    "somebody|nobody|whoever": "",
}
"""Regular expression of a former term, and the term of the glossary."""


def texts(tree: ast.AST) -> Iterator[str]:
    """Yield the string constants of a module; docstrings are expressions and omitted."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        if isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "0" for part in node.values)
            yield "".join(map(str, parts))
            inner = (part for part in node.values if isinstance(part, ast.FormattedValue))
            yield from (text for part in inner for text in texts(part))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        else:
            yield from texts(node)


CODE = re.compile(r"(?m)^ *(import|def|module|N,) |;\n|<\+")
"""Lines of generated programs."""


def messages(tree: ast.AST) -> list[str]:
    """Return the texts of a module that have two words, not code."""
    found = (text for text in texts(tree) if re.search(r"[A-Za-z]{2,}[,;:]? [a-z]{2,}", text))
    return [text for text in found if not CODE.search(text)]


@cache
def texts_of_modules() -> dict[str, list[str]]:
    """Return the messages of every module of the package by its path."""
    return {path.relative_to(ROOT).as_posix(): messages(tree_of(path)) for path in MODULES}


def rates_of(text: str) -> dict[str, float]:
    """Return the occurrences of every listed word per 10,000 words."""
    return {
        word: 1e4 * len(re.findall(rf"\b(?:{pattern})\b", text, re.IGNORECASE)) / len(text.split())
        for word, (pattern, _) in WORDS.items()
    }


def too_frequent(text: str) -> dict[str, float]:
    return {word: rate for word, rate in rates_of(text).items() if rate > WORDS[word][1]}


def banned(path: str, text: str) -> list[str]:
    """Return the former terms in a text."""
    terms = [term for term in BANNED if re.search(rf"\b(?:{term})\b", text, re.IGNORECASE)]
    if not path.startswith(ELECTRICAL) and re.search(r"\brails?\b", text):
        terms.append("rails")
    return terms


def test_word_rates_of_messages_are_those_of_technical_english():
    assert (
        too_frequent(" ".join(text for found in texts_of_modules().values() for text in found))
        == {}
    )


def test_messages_have_no_former_terms():
    found = [
        f"{path}: {text[:80]!r}: {terms}"
        for path, each in texts_of_modules().items()
        for text in each
        if (terms := banned(path, text))
    ]
    assert found == []


@pytest.mark.parametrize("term", BANNED)
def test_former_terms_are_found(term):
    former = re.sub(r"\(\?:([^|)]*)[^)]*\)\??|\?", r"\1", term).split("|")[0]
    assert term in banned("cli/app.py", f"the {former} settles")


def test_frequent_words_and_rails_are_found():
    assert too_frequent("what " * 10 + "value " * 1000) == {"what": pytest.approx(99.0, abs=0.1)}
    assert banned("network/cell.py", "its rails") == ["rails"]
    assert banned("hardware/parts/levels.py", "its rails") == []


def test_texts_are_messages_not_docstrings_and_not_code():
    tree = ast.parse(
        '"""A module text."""\nraise E(f"a: expected {b} here, got {c[\'the key\']}")\n'
    )
    assert messages(tree) == ["a: expected 0 here, got 0", "the key"]
    assert sum(map(len, texts_of_modules().values())) > 1500
