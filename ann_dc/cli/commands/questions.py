"""Circuit analyses beyond one run: --corners, --yield, --trim, --dac and --adc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from ann_dc.cli.commands.places import PANEL, PlaceOptions
from ann_dc.errors import NetworkError, ProblemError

SAMPLES = 100
"""Default number of drawn circuits."""

TRIMMED = 20
"""Default number of circuits that are drawn and trimmed."""

_ONE = "belongs to one circuit that is built and simulated; leave it out here"
_REFUSED = {"seed": "--yield and --trim draw circuits with seeds 0, 1, ...; leave it out"}


@dataclass(frozen=True, kw_only=True)
class BoardOptions:
    """Analyses; any of them replaces the simulation of one circuit."""

    corners: Annotated[
        bool,
        typer.Option(
            "--corners",
            help="A table over temperature, supplies and process instead: by emulation, of "
            "transistors in ngspice.",
            rich_help_panel=PANEL,
        ),
    ] = False

    spec: Annotated[
        str | None,
        typer.Option(
            "--yield",
            metavar="SPEC",
            help="What share of circuits, drawn from the tolerances of the level's parts, keeps a "
            "spec: error<1% (of the controls), settle<50us, stable, or several with commas. By "
            "emulation; --samples says how many are drawn.",
            rich_help_panel=PANEL,
        ),
    ] = None
    spot: Annotated[
        int,
        typer.Option(
            metavar="COUNT",
            min=0,
            help="With --yield: so many of the drawn circuits, best to worst, run in ngspice too.",
            rich_help_panel=PANEL,
        ),
    ] = 0

    trim: Annotated[
        str | None,
        typer.Option(
            metavar="SPEC",
            help="Which offsets and gains to trim, in which order, until 95 % of the circuits keep "
            "error<1%; what to measure, and what remains after every step.",
            rich_help_panel=PANEL,
        ),
    ] = None

    dac: Annotated[
        int | None,
        typer.Option(
            metavar="BITS",
            min=1,
            max=32,
            help="What it costs that q_0 and q_d come from a converter of so many bits over both "
            "full scales, and 1 us; also tells how the circuit starts cold.",
            rich_help_panel=PANEL,
        ),
    ] = None
    adc: Annotated[
        int | None,
        typer.Option(
            metavar="BITS",
            min=1,
            max=32,
            help="What it costs that u is read by a converter of so many bits, in 1 us.",
            rich_help_panel=PANEL,
        ),
    ] = None

    @property
    def converts(self) -> bool:
        """True if converters are analysed."""
        return self.dac is not None or self.adc is not None

    @property
    def written(self) -> bool:
        """True if a netlist is written: of one circuit, its corners or simulated samples."""
        return bool(self.corners or self.spot or not self.asked)

    @property
    def asked(self) -> bool:
        """True if any analysis is requested."""
        return self.corners or self.draws or self.converts

    @property
    def draws(self) -> bool:
        """True if circuits are drawn; --samples is their number."""
        return self.spec is not None or self.trim is not None

    def check(self, given: Mapping[str, Any], level: str) -> None:
        """Reject options of a single circuit if an analysis is requested.

        `given` contains these options by name. Raises `ProblemError` for the first one with a
        value, or for an invalid specification. Raises NgspiceMissing before the design if simulated
        samples, or corners of the level named `level`, require ngspice.
        """
        if self.spot and self.spec is None:
            raise ProblemError("--spot: is about drawn circuits; say --yield SPEC too")
        if self.spec is not None:
            _read(self.spec, "--yield")
        if self.trim is not None and list(_read(self.trim, "--trim").limits) != ["error"]:
            raise ProblemError(
                f"--trim: makes controls right, not quick; give an error, such as error<1%, got "
                f"{self.trim!r}"
            )
        for option, value in given.items():
            if self.asked and value:
                raise ProblemError(f"--{option}: {_REFUSED.get(option, _ONE)}")
        if self.spot or (self.corners and _simulated(level)):
            from ann_dc.backends.spice.ngspice.process import find_ngspice

            find_ngspice()

    @property
    def takes_seed(self) -> bool:
        """True if one circuit is analysed, whose parts may be drawn."""
        return self.corners or self.converts

    def report(self, problem, network, backend, place: PlaceOptions, samples: int | None):
        """Return the results as a `BoardReport`."""
        from ann_dc.report.board_report import BoardReport

        circuit, probe = backend.prepare(network)
        answers: list[Any] = []
        if self.corners:
            answers.append(self._corners(backend, circuit, probe, place))
        if self.spec is not None:
            answers.append(self._yield(backend, circuit, probe, samples or SAMPLES))
        if self.trim is not None:
            answers.append(self._trimming(backend, circuit, probe, samples or TRIMMED))
        if self.converts:
            answers.append(self._interface(backend, circuit, probe))
        return BoardReport(problem=problem.name, backend=backend, answers=answers)

    def _corners(self, backend, circuit, probe, place: PlaceOptions):
        from ann_dc.fidelity.boards.corners import corners
        from ann_dc.report.corner_table import CornerTable

        found = corners(backend, circuit, probe, **place.several())
        return CornerTable(corners=found, backend=backend)

    def _yield(self, backend, circuit, probe, samples: int):
        from ann_dc.fidelity.boards.yields import yield_of
        from ann_dc.report.yield_table import YieldTable

        spec = _read(self.spec or "", "--yield")
        found = yield_of(backend, circuit, probe, spec, samples=samples, spots=self.spot)
        return YieldTable(yielded=found, backend=backend)

    def _trimming(self, backend, circuit, probe, samples: int):
        from ann_dc.fidelity.boards.trimming import trimming
        from ann_dc.report.trim_table import TrimTable

        error = _read(self.trim or "", "--trim").error
        found = trimming(backend, circuit, probe, error, samples=samples)
        return TrimTable(found=found, backend=backend)

    def _interface(self, backend, circuit, probe):
        from ann_dc.fidelity.boards.interface import Interface, interface_cost
        from ann_dc.report.interface_table import InterfaceTable

        chosen = Interface(dac_bits=self.dac, adc_bits=self.adc)
        cost = interface_cost(backend, circuit, probe, chosen)
        return InterfaceTable(cost=cost, backend=backend)


def _simulated(word: str) -> bool:
    """Return True if corners of a level with given parts run in ngspice."""
    from ann_dc.backends.spice import level_words
    from ann_dc.hardware.parts.levels import Level

    found = level_words().get(word.lower())
    return isinstance(found, Level) and (found.transistors or not found.emulated)


def _read(text: str, option: str):
    from ann_dc.fidelity.boards.yields import spec_of

    try:
        return spec_of(text)
    except NetworkError as error:
        raise ProblemError(f"{option}: {str(error).removeprefix('spec: ')}") from error
