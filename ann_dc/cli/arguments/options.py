"""Options of commands: records of options, common output options, and --timing.

A record declares related options once, for several commands. Typer sees the fields of the records,
in the order of the command's parameters and of the fields:

    @unfolded
    def solve(*, problem: ProblemOptions, quiet: QuietOption = False) -> None: ...

Typer sees a command with PROBLEM, --set, -N, --q-0, --q-d and --quiet. The function is called with
a `ProblemOptions` that contains all of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from ann_dc.cli.terminal import console
from ann_dc.timing import Seconds, Stopwatch

Command = Callable[..., None]

JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", help="Write the result as JSON; - for stdout, without tables."
    ),
]
TrajectoryOption = Annotated[
    Path | None,
    typer.Option(
        "--trajectory",
        metavar="FILE",
        help="Write all neurons over time (.csv, .npz, or .parquet, which needs pyarrow).",
    ),
]
FiguresOption = Annotated[
    Path | None,
    typer.Option("--figures", metavar="DIR", help="Write the figures into this folder (PNG)."),
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
TimingOption = Annotated[
    bool,
    typer.Option(
        "--timing",
        help="Print the duration of each phase (s) on stderr; compilation counts in the phase of "
        "its first use.",
    ),
]


def completing(words: Callable[[], Iterable[str]], *, several: bool = False) -> Callable:
    """Return a shell completion from words, or of the last of several comma-separated words.

    >>> completing(lambda: ["tank", "car", "cart_pole"])("ca")
    ['car', 'cart_pole']
    >>> completing(lambda: ["diagonal", "multilevel"], several=True)("multilevel,d")
    ['multilevel,diagonal']
    """

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",") if several else ("", "", incomplete)
        found = (word for word in words() if word.lower().startswith(last.lower()))
        return [f"{before}{comma}{word}" for word in found]

    return complete


def option(text: str, *names: str, default: Any = None, **look: Any) -> Any:
    """Return the default of a field or parameter that typer shows as an option with a help text."""
    return field(default=default, metadata={"shown": typer.Option(*names, help=text, **look)})


def argument(text: str, *, default: Any = MISSING, **look: Any) -> Any:
    """Return the default of a field or parameter that typer shows as an argument."""
    return field(default=default, metadata={"shown": typer.Argument(help=text, **look)})


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
    options: list[Parameter] = []
    records: dict[str, type] = {}
    for parameter in signature(command).parameters.values():
        kind = types[parameter.name]
        if isinstance(kind, type) and is_dataclass(kind):
            records[parameter.name] = kind
            options += _options_of(kind)
        else:
            options.append(_shown(parameter.name, parameter.default, kind))

    @functools.wraps(command)
    def called_by_typer(**given: Any) -> None:
        command(**_folded(given, records))

    return _with_options(called_by_typer, options)


def timed(command: Command) -> Command:
    """Replace records as `unfolded`, and add --timing: time per phase on stderr at the end."""
    run = unfolded(command)

    @functools.wraps(command)
    def with_timing(*, timing: bool = False, **given: Any) -> None:
        if not timing:
            return run(**given)
        watch = Stopwatch()
        watch.phases["start"] = Seconds.since_start()
        try:
            with watch:
                run(**given)
        finally:
            console(stderr=True).print(str(watch))

    timing = _shown("timing", False, TimingOption)
    return _with_options(with_timing, [*signature(run).parameters.values(), timing])


def _with_options(command: Command, options: list[Parameter]) -> Command:
    """Set the signature that typer reads."""
    command.__signature__ = Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {shown.name: shown.annotation for shown in options}
    return command


def _options_of(record: type) -> Iterator[Parameter]:
    types = get_type_hints(record, include_extras=True)
    for each in fields(record):
        yield _shown(each.name, each, types[each.name])


def _shown(name: str, default: Any, kind: Any) -> Parameter:
    """Return a parameter of a command; `default` may be a `Field` with the option in it."""
    if isinstance(default, Field):
        if "shown" in default.metadata:
            kind = Annotated[kind, default.metadata["shown"]]
        default = default.default
    default = Parameter.empty if default is MISSING else default
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _folded(given: Mapping[str, Any], records: Mapping[str, type]) -> dict[str, Any]:
    """Return the given values, with the fields of each record collected in it."""
    rest, gathered = dict(given), {}
    for name, record in records.items():
        own = {each.name: rest.pop(each.name) for each in fields(record) if each.name in rest}
        gathered[name] = record(**own)
    return rest | gathered
