"""Model levels: circuits of one network at increasing fidelity.

A level is a record of technology and models, independent of the network. The emulation uses its
datasheet and technology, the netlist its models. The built-in levels are ideal parts, op-amp macro
models, transconductors, switched capacitors and transistors. `ann_dc.hardware.parts.presets` adds
part sets with the data of real parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ann_dc.errors import NetworkError, require_positive, such_as
from ann_dc.hardware.parts.board_models import (
    MACRO_PARAMETERS,
    check_parasitics,
    macro_parameters,
    model_parameters,
)
from ann_dc.hardware.parts.conditions import NOMINAL, Conditions
from ann_dc.hardware.parts.datasheet import TYPICAL, Datasheet, Tolerances
from ann_dc.hardware.parts.generator_curves import Curves, Polynomial
from ann_dc.hardware.parts.technologies import (
    DIFFERENTIAL_PAIRS,
    OP_AMPS,
    OtaC,
    SwitchedCapacitors,
    Technology,
)
from ann_dc.hardware.parts.transistors import transistor_sheet
from ann_dc.network.preconditioners import base as contract
from ann_dc.summaries import summarised
from ann_dc.validation import FloatOrNan, PositiveFinite, checked


@such_as("ann_dc.levels.macro()")
@checked
@summarised(
    lambda self: {
        "name": self.name,
        "models": self.models,
        "technology": type(self.technology).__name__,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """Model level of a circuit.

    Attributes
    ----------
    name : str
        Name in tables.
    models : str
        Folder of ``circuits/models`` with op amps, multipliers and function generators: ``ideal``,
        ``macro``, ``transistor`` or ``sky130``.
    datasheet : Datasheet
        Values common to the parts of a kind; ideal by default.
    technology : Technology
        Technology of the cells; op amps with resistors by default.
    functions : Curves or None
        Fitting method for function generators made of parts; None uses those of the models.
    smallest_resistor : float, optional
        Smallest resistor in ohms. If omitted, it suits the capacitances and output currents of the
        parts, or is `SMALLEST_RESISTOR` if the parts have none.
    smallest_capacitor : float
        Smallest integrating capacitor in farads, large relative to parasitic capacitances; 0 by
        default.
    full_scale : float
        Volts of the largest value; 1 by default.
    area : float
        Area of the matched gates of ``transistor`` models relative to the smallest gates; 1 by
        default.
    conditions : Conditions
        Operating conditions of datasheet and netlist; nominal by default. Use `at` to change them.

    Raises
    ------
    NetworkError
        If the macro models do not support a number, the cells lack a part with parasitics, or a
        process corner is given for parts without transistors.

    Examples
    --------
    >>> BEHAVIOURAL.emulated, TRANSISTOR.emulated, TRANSISTOR.limit
    (False, True, 2.4)
    """

    name: str
    models: Literal["ideal", "macro", "transistor", "sky130"]
    datasheet: Datasheet = field(default_factory=Datasheet)
    technology: Technology = OP_AMPS
    functions: Curves | None = None
    smallest_resistor: float | None = None
    smallest_capacitor: float = 0.0
    full_scale: float = 1.0
    area: PositiveFinite = 1.0
    conditions: Conditions = NOMINAL

    def __post_init__(self) -> None:
        if self.smallest_resistor is not None:
            require_positive(smallest_resistor=self.smallest_resistor)
        if not 0 <= (least := self.smallest_capacitor) < math.inf:
            raise NetworkError(f"smallest_capacitor: expected farads of at least 0, got {least!r}")
        own, parts = transistor_sheet(self.area).parasitics, self.datasheet.parasitics
        check_parasitics(parts, own, self.models, self.technology, self.name)
        corner = self.conditions.process
        if not self.transistors and corner != NOMINAL.process:
            raise NetworkError(
                f"process: {self.name} parts have no transistors and no process corners, got "
                f"{corner!r}; use the level transistor, or {NOMINAL.process!r}"
            )
        if self.models != "macro":
            return
        for attribute, low, high in MACRO_PARAMETERS.values():
            value = float(getattr(self.datasheet, attribute))
            if value not in (0.0, math.inf) and not low <= value <= high:
                raise NetworkError(
                    f"{attribute}: the macro models do {low:g} to {high:g}, got {value:g}"
                )

    @property
    def transistors(self) -> bool:
        """True if the parts are made of transistors, which have process corners."""
        return self.models not in ("ideal", "macro")

    @property
    def limit(self) -> float:
        """Lowest saturation voltage of a part kind; infinite without saturation."""
        return min(self.datasheet.output_swing, self.datasheet.multiplier_output_swing)

    @property
    def tolerances(self) -> Tolerances:
        """Error sizes of single parts at the operating conditions; `TYPICAL` if unknown."""
        sizes = self.datasheet.tolerances or TYPICAL
        return sizes.at(self.conditions).without(self.technology.without)

    @checked
    def at(self, conditions: Conditions) -> Level:
        """Return the level at other operating conditions.

        Output swing and power follow the supplies, tolerances grow with drift, and bias currents
        grow with temperature. Raises `NetworkError` if a process corner is given for parts without
        transistors.

        Examples
        --------
        >>> level = macro(output_swing=14.0).at(Conditions(supply=0.9, temperature=85.0))
        >>> f"{level.datasheet.output_swing:g}", level.conditions.temperature
        ('12.6', 85.0)
        """
        sheet = self.datasheet.at(conditions, self.conditions)
        return replace(self, datasheet=sheet, conditions=conditions)

    @property
    def emulated(self) -> bool:
        """True if circuits can be emulated; those of ideal op amps equal the ODE."""
        built = self.technology
        return not built.clocked and (self.models != "ideal" or built.differential)

    @property
    def preconditioners(self) -> tuple[contract.PreconditionerKind, ...]:
        """Preconditioner kinds that the level supports.

        Circuits of ideal op amps find no operating point for a resistive grid.
        """
        kinds, ideal = self.technology.preconditioners, self.models == "ideal"
        return tuple(
            kind
            for kind in kinds
            if not (ideal and kind is contract.PreconditionerKind.RESISTIVE_GRID)
        )

    @property
    def parameters(self) -> dict[str, float]:
        """Global parameters of the models."""
        own = macro_parameters(self.datasheet, self.full_scale) if self.models == "macro" else {}
        return own | model_parameters(self.datasheet.parasitics, self.models)


BEHAVIOURAL = Level(name="behavioural", models="ideal")
"""Level of ideal op amps, multipliers and function generators."""


@checked
def macro(datasheet: Datasheet | None = None, *, differential: bool = False, **given: Any) -> Level:
    """Return a level of op-amp macro models.

    Raises `NetworkError` if a number is out of its range or not supported by the macro models.

    Parameters
    ----------
    datasheet : Datasheet, optional
        Data of the parts.
    differential : bool
        True for fully differential op amps, with both signs of every signal and without inverters;
        False by default.
    **given : float
        Attributes of `Datasheet`, instead of ``datasheet``. The default of a0 is 1e6.

    Examples
    --------
    >>> level = macro(gbw=1e6, slew=5e5)
    >>> level.datasheet.a0, level.parameters["opamp_sr"]
    (1000000.0, 500000.0)
    """
    return Level(
        name="macro, differential" if differential else "macro",
        models="macro",
        datasheet=datasheet or Datasheet(**{"a0": 1e6, **given}),
        technology=DIFFERENTIAL_PAIRS if differential else OP_AMPS,
    )


@checked
def ota_c(
    *, a0: FloatOrNan = math.inf, linear_range: FloatOrNan = 30.0, gbw: FloatOrNan = 10e6
) -> Level:
    """Return an OTA-C level: a node per neuron, a tanh transconductor per weight [1]_.

    Raises `NetworkError` if a number is not positive.

    Parameters
    ----------
    a0 : float
        Voltage gain of a transconductor into its output resistance; infinite by default.
    linear_range : float
        Voltage scale of the tanh relative to full scale; 30 by default.
    gbw : float
        Bandwidth in Hz that scales network time, as for op amps; 10 MHz by default.

    References
    ----------
    .. [1] R. L. Geiger, E. Sánchez-Sinencio, Active filter design using operational
       transconductance amplifiers: a tutorial, IEEE Circuits and Devices Magazine 1, 1985, 20-32.

    Examples
    --------
    >>> level = ota_c(linear_range=10.0)
    >>> level.technology.linear_range, level.technology.differential
    (10.0, True)
    """
    require_positive(linear_range=linear_range)
    return Level(
        name="ota-c",
        models="ideal",
        datasheet=Datasheet(a0=a0, gbw=gbw),
        technology=OtaC(linear_range=linear_range),
    )


@checked
def switched_capacitor(
    *,
    a0: FloatOrNan = math.inf,
    gbw: FloatOrNan = 200e6,
    step: FloatOrNan,
    clock: FloatOrNan = 1e6,
    **given,
) -> Level:
    """Return a level of switched capacitors, one step per clock period [1]_.

    The circuit realises the recurrent layer with a fixed step. Raises `NetworkError` if a number is
    out of its range.

    Parameters
    ----------
    a0, gbw : float
        Open-loop gain of the op amps, infinite by default, and gain-bandwidth product in Hz, 200
        MHz by default.
    step : float
        Network time of a period.
    clock : float
        Clock frequency in Hz; 1 MHz by default.
    **given : float
        Further attributes of `SwitchedCapacitors`.

    References
    ----------
    .. [1] R. Gregorian, G. C. Temes, Analog MOS Integrated Circuits for Signal Processing, Wiley,
       1986.

    Examples
    --------
    The step is one that the network's forward Euler rule can take:

    >>> level = switched_capacitor(step=0.5, clock=2e6)
    >>> level.technology.clocked, level.technology.step
    (True, 0.5)
    """
    return Level(
        name="switched-capacitor",
        models="macro",
        datasheet=Datasheet(a0=a0, gbw=gbw),
        technology=SwitchedCapacitors(step=step, clock=clock, **given),
    )


@checked
def transistor(*, area: PositiveFinite = 1.0) -> Level:
    """Return a level of CMOS op amps and Gilbert multipliers.

    Functions are polynomials, and the circuits contain no behavioural source. Raises `NetworkError`
    if the area is out of its range.

    Parameters
    ----------
    area : float
        Area of the op amps' matched gates relative to the smallest gates, 1 to 64, see
        `transistor_sheet`; 1 by default.

    Examples
    --------
    >>> wide = transistor(area=36.0)
    >>> f"{wide.tolerances.offset:.2g}", f"{TRANSISTOR.tolerances.offset:.2g}"
    ('0.00055', '0.0033')
    """
    return Level(
        name="transistor",
        models="transistor",
        datasheet=transistor_sheet(area),
        functions=Polynomial(most_terms=10),
        smallest_resistor=100e3,
        smallest_capacitor=0.5e-12,
        area=area,
    )


TRANSISTOR = transistor()
"""Transistor level with the smallest gates."""
