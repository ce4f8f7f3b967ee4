"""Records of related options, declared once and used by several commands.

A command has records as parameters. Typer sees the fields of the records as options, in the order
of the command's parameters and of the fields:

    @unfolded
    def solve(*, problem: ProblemOptions, quiet: QuietOption = False) -> None: ...

Typer sees a command with PROBLEM, --set, -N, --q-0, --q-d and --quiet. The function is called with
a `ProblemOptions` that contains all of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints

Command = Callable[..., None]


def unfolded(command: Command) -> Command:
    """Replace every record in the signature of a command by its fields, for typer.

    The parameters of the command are keyword parameters. A parameter whose type is a dataclass is a
    record of options.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Size:
    ...     wide: int
    ...     high: int = 1
    >>> @unfolded
    ... def draw(*, size: Size, quiet: bool = False) -> None:
    ...     print(size.wide * size.high)
    >>> [*signature(draw).parameters]
    ['wide', 'high', 'quiet']
    >>> draw(wide=3, high=2)
    6
    """
    types = get_type_hints(command, include_extras=True)
    options: dict[str, Parameter] = {}
    records: dict[str, type] = {}
    for parameter in signature(command).parameters.values():
        kind = types[parameter.name]
        if isinstance(kind, type) and is_dataclass(kind):
            records[parameter.name] = kind
            options |= {option.name: option for option in _options_of(kind)}
        else:
            options[parameter.name] = parameter.replace(annotation=kind)

    @functools.wraps(command)
    def called_by_typer(**given: Any) -> None:
        command(**_folded(given, records))

    called_by_typer.__signature__ = Signature([*options.values()])  # type: ignore[attr-defined]
    called_by_typer.__annotations__ = {name: o.annotation for name, o in options.items()}
    return called_by_typer


def _options_of(record: type) -> Iterator[Parameter]:
    types = get_type_hints(record, include_extras=True)
    for field in fields(record):
        default = Parameter.empty if field.default is MISSING else field.default
        yield Parameter(
            field.name, Parameter.KEYWORD_ONLY, default=default, annotation=types[field.name]
        )


def _folded(given: Mapping[str, Any], records: Mapping[str, type]) -> dict[str, Any]:
    """Return the given values, with the fields of each record collected in it."""
    rest, gathered = dict(given), {}
    for name, record in records.items():
        own = {field.name: rest.pop(field.name) for field in fields(record) if field.name in rest}
        gathered[name] = record(**own)
    return rest | gathered
