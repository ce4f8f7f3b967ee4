"""Application of all commands, with central error handling.

User input is converted to objects in `arguments`. A command then consists of a few library calls
and the output of `report`.

Exit codes: 0 settled and certified (or shown), 1 ran but did not settle or is not certified, 2 bad
input or unwritable output, 130 interrupted.

A command is loaded on request and imports the library when it runs. No command therefore waits for
imports of another.
"""

from __future__ import annotations

import gc
import io
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Annotated, Any

import typer
import typer.main
from rich.text import Text
from typer.core import TyperCommand, TyperGroup

from ann_dc.cli.commands.renamed import check_command, check_options
from ann_dc.cli.terminal import console
from ann_dc.errors import AnnDcError

COMMANDS = {
    "solve": "solve",
    "design": "design",
    "coordinate": "coordinate",
    "circuit": "circuit",
    "levels": "levels",
    "run": "run",
    "navigate": "navigate",
    "study": "study",
    "report": "study",
    "export": "export",
    "inspect": "export",
    "show": "show",
    "plants": "show",
    "paper": "paper",
}
"""Modules by command, in the order of the help; a function has the name of its command."""


class _Command(TyperCommand):
    """Command that refuses former names of options with the present ones."""

    def parse_args(self, ctx, args):
        if not ctx.resilient_parsing:
            check_options(args, {name for each in self.params for name in each.opts})
        return super().parse_args(ctx, args)


class _OnDemand(Mapping[str, Any]):
    """Commands by name, loaded on request."""

    def __init__(self) -> None:
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            module = import_module(f"ann_dc.cli.commands.{COMMANDS[name]}")
            alone = typer.Typer(add_completion=False)
            alone.command(name, cls=_Command)(getattr(module, name))
            self._loaded[name] = typer.main.get_command(alone)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(TyperGroup):
    """Group of commands that converts errors to messages and exit codes."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands = _OnDemand()

    def resolve_command(self, ctx, args):
        check_command(args[0])
        return super().resolve_command(ctx, args)

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # `ann-dc show car | head`: typer ends quietly
            raise
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except (AnnDcError, OSError) as error:
            message = Text.assemble(("error: ", "bold red"), _sentence(error))
            console(stderr=True).print(message, soft_wrap=True)
            raise typer.Exit(2) from None


app = typer.Typer(
    cls=_Commands,
    help="Optimal control with analog neural networks: problem declaration, simulation, "
    "certified optimum.\n\nExit code: 0 the result is certified or complete, 1 the command ran "
    "with another outcome, 2 bad input or unwritable output, 130 interrupted.",
    epilog="Start with:  ann-dc plants,  ann-dc solve car,  ann-dc show car",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; entry point of ``ann-dc`` and of ``python -m ann_dc``."""
    gc.set_threshold(400_000, 50, 50)  # what a command loads lives to its end, or nearly
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a letter that cannot be shown becomes `?`
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="ann-dc")
    finally:
        gc.freeze()  # an end looks through everything for circles: 0.3 s that free no memory


def _show_version(wanted: bool) -> None:
    if wanted:
        import ann_dc

        typer.echo(f"ann-dc {ann_dc.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and not isinstance(error, AnnDcError) and error.strerror:
        return f"{error.filename or 'output'}: {error.strerror}; choose another path"
    return " ".join(str(error).split())
