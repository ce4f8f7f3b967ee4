"""Operating conditions of a circuit, and analyses beyond one run of it: `BoardOptions`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from ann_dc.cli.arguments.options import option
from ann_dc.cli.arguments.problem import number_of
from ann_dc.errors import NetworkError, ProblemError

_board_option = partial(option, rich_help_panel="Boards and chips")
PLURALS = {"temperature": "temperatures", "supply": "supplies", "process": "processes"}


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Temperature, supplies and process; comma-separated values with --corners."""

    temperature: str | None = _board_option(
        "Temperature (C), -55 to 150; with --corners several, for instance -40,27,125.",
        metavar="C",
        show_default="27",
    )
    supply: str | None = _board_option(
        "Supply voltage relative to nominal, 0.5 to 1.5; with --corners several (0.9,1,1.1).",
        metavar="RATIO",
        show_default="1",
    )
    process: str | None = _board_option(
        "Process corner of n- and p-channel transistors: tt, ss, ff, sf or fs; with --corners "
        "several.",
        metavar="CORNER",
        show_default="tt",
    )

    def several(self) -> dict[str, list]:
        """Return all given values by parameter name of `corners`."""
        return {PLURALS[name]: values for name, values in self._given().items()}

    def single(self):
        """Return the `Conditions` of a single operating point.

        Raises `ProblemError` if several values are given, which require --corners.
        """
        from ann_dc.hardware.parts.conditions import Conditions

        given = self._given()
        for name, values in given.items():
            if len(values) != 1:
                raise ProblemError(
                    f"--{name}: expected one value without --corners, got several; add --corners"
                )
        return Conditions(**{name: value for name, (value,) in given.items()})

    def _given(self) -> dict[str, list]:
        """Return the given values by option."""
        words = {n: text.split(",") for n, text in asdict(self).items() if text is not None}
        return {
            name: [word.strip().lower() for word in each]
            if name == "process"
            else [number_of(f"--{name}", word.strip()) for word in each]
            for name, each in words.items()
        }


SAMPLES = 100
"""Default number of drawn circuits."""

TRIMMED = 20
"""Default number of circuits that are drawn and trimmed."""

_ONE = "applies to the construction of one circuit; omit it"
_REFUSED = {
    "seed": "--yield and --trim use the seeds 0, 1, ...; omit it",
    "duration": "corners, yields, trims and converters need a network that settles; omit it",
}


@dataclass(frozen=True, kw_only=True)
class BoardOptions:
    """Analyses; any of them replaces the simulation of one circuit."""

    corners: bool = _board_option(
        "Report the error over temperature, supply and process: by emulation, for transistors "
        "in ngspice.",
        "--corners",
        default=False,
    )

    spec: str | None = _board_option(
        "Report the fraction of drawn circuits that meet a specification: error<1%, settle<50us, "
        "stable, or several (emulation of --samples circuits).",
        "--yield",
        metavar="SPEC",
    )
    simulate_samples: int = _board_option(
        "Also simulate COUNT of the circuits of --yield in ngspice, from best to worst.",
        default=0,
        metavar="COUNT",
        min=0,
    )

    trim: str | None = _board_option(
        "List the offsets and gains to trim, in order, until 95 % of the circuits meet a limit "
        "such as error<1%.",
        metavar="SPEC",
    )

    dac: int | None = _board_option(
        "Report the control error added by a BITS-bit DAC for q_0 and q_d with 1 us conversion "
        "time, and the cold start.",
        metavar="BITS",
        min=1,
        max=32,
    )
    adc: int | None = _board_option(
        "Report the control error added by a BITS-bit ADC with 1 us conversion time.",
        metavar="BITS",
        min=1,
        max=32,
    )

    @property
    def converts(self) -> bool:
        """True if converters are analysed."""
        return self.dac is not None or self.adc is not None

    @property
    def written(self) -> bool:
        """True if a netlist is written: of one circuit, its corners or simulated samples."""
        return bool(self.corners or self.simulate_samples or not self.asked)

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
        if self.simulate_samples and self.spec is None:
            raise ProblemError("--simulate-samples: needs --yield SPEC")
        if self.spec is not None:
            _read(self.spec, "--yield")
        if self.trim is not None and list(_read(self.trim, "--trim").limits) != ["error"]:
            raise ProblemError(
                f"--trim: expected an error limit such as error<1%, got {self.trim!r}"
            )
        for name, value in given.items():
            if self.asked and value:
                raise ProblemError(f"--{name}: {_REFUSED.get(name, _ONE)}")
        if self.simulate_samples or (self.corners and _simulated(level)):
            from ann_dc.backends.spice.ngspice.process import find_ngspice

            find_ngspice()

    @property
    def takes_seed(self) -> bool:
        """True if one circuit is analysed, whose parts may be drawn."""
        return self.corners or self.converts

    def report(
        self, subject: dict[str, str], network, backend, place: PlaceOptions, samples: int | None
    ):
        """Return the results as a `BoardReport`."""
        from ann_dc.fidelity.boards.corners import corners
        from ann_dc.fidelity.boards.interface import Interface, interface_cost
        from ann_dc.fidelity.boards.trimming import trimming
        from ann_dc.fidelity.boards.yields import yield_of
        from ann_dc.report import boards

        circuit, probe = backend.prepare(network)
        answers: list[Any] = []
        if self.corners:
            found = corners(backend, circuit, probe, **place.several())
            answers.append(boards.CornerTable(corners=found, backend=backend))
        if self.spec is not None:
            spec, count = _read(self.spec, "--yield"), samples or SAMPLES
            yielded = yield_of(
                backend, circuit, probe, spec, samples=count, spots=self.simulate_samples
            )
            answers.append(boards.YieldTable(yielded=yielded, backend=backend))
        if self.trim is not None:
            error, count = _read(self.trim, "--trim").error, samples or TRIMMED
            trims = trimming(backend, circuit, probe, error, samples=count)
            answers.append(boards.TrimTable(found=trims, backend=backend))
        if self.converts:
            chosen = Interface(dac_bits=self.dac, adc_bits=self.adc)
            cost = interface_cost(backend, circuit, probe, chosen)
            answers.append(boards.InterfaceTable(cost=cost, backend=backend))
        return boards.BoardReport(subject=subject, backend=backend, answers=answers)


def _simulated(word: str) -> bool:
    """Return True if corners of a level with given parts run in ngspice."""
    from ann_dc.hardware.parts.level_words import level_words

    found = level_words().get(word.lower())
    if found is None or not found.is_fixed:
        return False
    level = found.made()
    return level.transistors or not level.emulated


def _read(text: str, option: str):
    from ann_dc.fidelity.boards.yields import spec_of

    try:
        return spec_of(text)
    except NetworkError as error:
        raise ProblemError(f"{option}: {str(error).removeprefix('spec: ')}") from error
