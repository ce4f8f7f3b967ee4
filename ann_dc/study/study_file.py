"""Text form of studies: construction from a TOML file or a stored identity.

Nothing in the file is executed::

    title = "Fraction of cars that settle in time"
    subject = "car"                # plant name, or path of a problem file next to this one
    metrics = ["settling_time", "control_error"]
    samples = 1000                 # at every combination of listed values
    sampling = "sobol"             # of ranges: random, latin-hypercube or sobol
    seed = 1
    curves = 0                     # states over time stored per case
    time_limit = 60.0              # seconds per case

    [vary]                         # varied settings; names: ann-dc study --list-settings SUBJECT
    nonideal.mismatch = [0.003, 0.01, 0.03]
    input.q_d.x = {low = 3, high = 7}
    gains.rho = {low = 0.1, high = 10, log = true, count = 9}   # nine values instead of samples

    [fixed]                        # optional
    design.preconditioner = "multilevel"

    [spec]                         # optional: limits, or [smallest, largest]
    control_error = 0.05
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ann_dc.errors import AnnDcError, StudyError
from ann_dc.files import read_table
from ann_dc.problem import plants
from ann_dc.problem.toml_file import load_problem
from ann_dc.study.metrics import DEFAULT
from ann_dc.study.sampling import Sampling, Span
from ann_dc.study.settings import subject_from
from ann_dc.study.study import LAYOUT, Study
from ann_dc.validation import checked

PLAIN = {
    "samples": int,
    "seed": int,
    "curves": int,
    "time_limit": (int, float),
    "title": str,
    "metrics": list,
    "spec": dict,
}
"""Optional fields that are passed to `Study` unchanged, and their types."""
KINDS = {
    bool: "true or false",
    int: "a whole number",
    str: "a text",
    list: "a list",
    dict: "a table",
}
"""Descriptions of types for error messages."""
_RANGE = ("low", "high", "log", "count")


@checked
def load_study(path: str | os.PathLike[str]) -> Study:
    """Read a study from a TOML file.

    Parameters
    ----------
    path : path-like
        TOML file.

    Returns
    -------
    Study
        Validated study.

    Raises
    ------
    FileFormatError
        If the file does not exist or is not TOML.
    StudyError
        If the content does not describe a study. The message begins with the path and the field.

    Examples
    --------
    >>> import tempfile
    >>> text = '''
    ... subject = "car"
    ... vary.nonideal.mismatch = [0.003, 0.01]
    ... samples = 100
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "chips.toml")
    ...     _ = file.write_text(text, encoding="utf-8")
    ...     len(load_study(file))
    200
    """
    file = Path(path)
    table = read_table(file, "study", "demos/yield.toml")
    try:
        return _study(table, file)
    except AnnDcError as error:
        raise StudyError(f"{file}: {error}") from error


def _study(table: dict[str, Any], file: Path) -> Study:
    known = {*PLAIN, "subject", "vary", "fixed", "sampling"}
    for name in table:
        if name not in known:
            raise StudyError(
                f"{name}: is not a field of a study; fields are {', '.join(sorted(known))}"
            )
    if "subject" not in table:
        raise StudyError("subject: is missing; name a plant, or the path of a problem file")
    given = {name: _typed(name, table[name], kind) for name, kind in PLAIN.items() if name in table}
    given.setdefault("title", file.stem.replace("_", " "))
    return Study(
        subject=_subject(_typed("subject", table["subject"], str), file.parent),
        vary={n: _axis(n, v) for n, v in _flattened(_typed("vary", table.get("vary", {}), dict))},
        fixed=dict(_flattened(_typed("fixed", table.get("fixed", {}), dict))),
        sampling=_sampling(_typed("sampling", table.get("sampling", Sampling.RANDOM.value), str)),
        **_limits(given),
    )


def _typed(name: str, value: Any, kind: Any) -> Any:
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise StudyError(f"{name}: expected {KINDS.get(kind, 'a number')}, got {value!r}")
    return value


def _sampling(word: str) -> Sampling:
    known = {sampling.value: sampling for sampling in Sampling}
    if word not in known:
        raise StudyError(f"sampling: expected one of {', '.join(known)}, got {word!r}")
    return known[word]


def _subject(word: str, beside: Path) -> Any:
    if word in plants.names() or not word.lower().endswith(".toml"):
        return word
    return load_problem(beside / word)


def _limits(given: dict[str, Any]) -> dict[str, Any]:
    """Convert limits that a file gives as two-element lists to pairs."""
    spec = dict(_flattened(given.get("spec", {})))
    return given | {"spec": {n: tuple(v) if isinstance(v, list) else v for n, v in spec.items()}}


def _flattened(table: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """Return (dotted name, value) pairs of nested tables and of quoted dotted names.

    >>> _flattened({"input": {"q_d": {"x": [1, 2]}}, "problem.N": {"low": 1, "high": 9}})
    [('input.q_d.x', [1, 2]), ('problem.N', {'low': 1, 'high': 9})]
    """
    found = []
    for name, value in table.items():
        if isinstance(value, Mapping) and not {"low", "high"} & {*value}:
            found += _flattened(value, f"{before}{name}.")
        else:
            found.append((f"{before}{name}", value))
    return found


def _axis(name: str, given: Any) -> Any:
    """Return a list of values or a range."""
    if not isinstance(given, Mapping):
        return given
    strange = sorted({*given} - {*_RANGE})
    if strange or not {"low", "high"} <= {*given}:
        raise StudyError(
            f"vary: {name}: a range is {{low = .., high = ..}}, with log = true and count = .. "
            f"if required; got {dict(given)!r}"
        )
    low, high = (_typed(f"vary: {name}", given[end], (int, float)) for end in ("low", "high"))
    is_log = _typed(f"vary: {name}: log", given.get("log", False), bool)
    if "count" not in given:
        return Span(low, high, bool(is_log))
    count = _typed(f"vary: {name}: count", given["count"], int)
    if count < 1 or not -math.inf < low < high < math.inf or (is_log and not low > 0):
        raise StudyError(
            f"vary: {name}: count is 1 or more, low below high, both finite, and log needs "
            f"low > 0; got {dict(given)!r}"
        )
    return (np.geomspace if is_log else np.linspace)(low, high, count).tolist()


@checked
def study_from(identity: Mapping[str, Any]) -> Study:
    """Return the study described by the identity of a store.

    Raises `StudyError` if the identity has another version, or describes a network or user-defined
    metrics.
    """
    if identity.get("version") != LAYOUT:
        raise StudyError(
            f"version: this study was made by another version ({identity.get('version')!r}, "
            f"here {LAYOUT}); use that version, or a new folder"
        )
    vary = {
        name: Span(**value) if isinstance(value, Mapping) else value
        for name, value in identity["vary"].items()
    }
    return Study(
        subject=subject_from(identity["subject"]),
        vary=vary,
        metrics=list(identity.get("metrics", DEFAULT)),
        fixed=identity["fixed"],
        samples=identity["design"]["samples"],
        sampling=_sampling(identity["design"]["sampling"]),
        curves=identity["curves"],
        **_limits({name: identity[name] for name in ("seed", "spec", "title")}),
    )
