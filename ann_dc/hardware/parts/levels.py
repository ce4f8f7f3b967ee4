"""The ladder: one network, rising fidelity. A level says what is built, of which models.

A level is a record, whatever network it will serve and whoever reads it: the emulation takes its
datasheet and its technology, the netlist its models. Ideal parts, op amps as macro models,
transconductors, switched capacitors and transistors are the shipped rungs; those with the figures
of real parts are `ann_dc.hardware.parts.presets`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ann_dc.errors import NetworkError, require_positive
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
    OpAmps,
    OtaC,
    SwitchedCapacitors,
    Technology,
)
from ann_dc.hardware.parts.transistors import transistor_sheet
from ann_dc.network.preconditioners import base as contract
from ann_dc.validation.checked import checked
from ann_dc.validation.values import FloatOrNan, PositiveFinite, such_as


@such_as("ann_dc.levels.macro()")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """A rung of the ladder.

    Attributes
    ----------
    name : str
        What tables call it.
    models : str
        Folder of ``circuits/models`` that holds op amps, multipliers and function generators.
    datasheet : Datasheet
        What the parts of a kind have in common.
    technology : Technology
        What cells are built of.
    functions : Curves or None
        Recipe by which function generators are made of parts; None takes the models' own.
    smallest_resistor : float, optional
        In ohms. Where none is given it is what suits the capacitances and output currents of the
        parts, and `SMALLEST_RESISTOR` where they have none.
    smallest_capacitor : float
        In farads, of integrating capacitors: what strays do not swamp.
    full_scale : float
        Volts that stand for the largest value.
    area : float
        Of the matched gates of ``transistor`` models, over that of the smallest ones.
    conditions : Conditions
        Where it stands, which its datasheet and its netlists know; `at` takes it elsewhere.

    Raises
    ------
    NetworkError
        If a number is one that the macro models cannot do, parts leak that its cells lack, or it
        is to have a corner of a process without transistors.

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
            raise NetworkError(f"smallest_capacitor: expected farads not below 0, got {least!r}")
        own, parts = transistor_sheet(self.area).parasitics, self.datasheet.parasitics
        check_parasitics(parts, own, self.models, self.technology, self.name)
        corner = self.conditions.process
        if not self.transistors and corner != NOMINAL.process:
            raise NetworkError(
                f"process: {self.name} parts have no transistors and know no corner, got {corner!r}"
                f"; take the level transistor, or {NOMINAL.process!r}"
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
        """Whether its parts are made of transistors, which a process makes slow or fast."""
        return self.models not in ("ideal", "macro")

    @property
    def limit(self) -> float:
        """Volts at which the first kind of part clips; infinite where none does."""
        return min(self.datasheet.rails, self.datasheet.multiplier_rails)

    @property
    def tolerances(self) -> Tolerances:
        """Sizes of the errors of single parts where it stands, `TYPICAL` ones if none are known."""
        sizes = self.datasheet.tolerances or TYPICAL
        return sizes.at(self.conditions).without(self.technology.without)

    @checked
    def at(self, conditions: Conditions) -> Level:
        """The same parts at another temperature and other supplies.

        Rails and power follow supplies; tolerances grow with drift, and bias currents with heat.

        Parameters
        ----------
        conditions : Conditions

        Returns
        -------
        Level

        Raises
        ------
        NetworkError
            If parts without transistors are to have a corner of a process.

        Examples
        --------
        >>> level = macro(rails=14.0).at(Conditions(supply=0.9, temperature=85.0))
        >>> f"{level.datasheet.rails:g}", level.conditions.temperature
        ('12.6', 85.0)
        """
        sheet = self.datasheet.at(conditions, self.conditions)
        return replace(self, datasheet=sheet, conditions=conditions)

    @property
    def emulated(self) -> bool:
        """Whether its circuits can be emulated; ideal op amps need not: they are the ODE."""
        built = self.technology
        return not built.clocked and (self.models != "ideal" or not isinstance(built, OpAmps))

    @property
    def metrics(self) -> tuple[contract.Kind, ...]:
        """Kinds of metric that it can build; ideal op amps find no operating point for a grid."""
        kinds, ideal = self.technology.metrics, self.models == "ideal"
        return tuple(kind for kind in kinds if not (ideal and kind is contract.Kind.GRID))

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the models' global parameters."""
        own = macro_parameters(self.datasheet, self.full_scale) if self.models == "macro" else {}
        return own | model_parameters(self.datasheet.parasitics, self.models)


BEHAVIOURAL = Level(name="behavioural", models="ideal")
"""Ideal op amps, multipliers and function generators."""


@checked
def macro(datasheet: Datasheet | None = None, *, differential: bool = False, **given: Any) -> Level:
    """Op-amp macro models.

    Parameters
    ----------
    datasheet : Datasheet, optional
    differential : bool
        Fully differential op amps: every signal has both signs, and there are no inverters.
    **given : float
        Attributes of `Datasheet`, instead of ``datasheet``; a0 is 1e6 where it is not given.

    Returns
    -------
    Level

    Raises
    ------
    NetworkError
        If a number is out of its range, or one that the macro models cannot do.

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
    """OTA-C: one node a neuron, one tanh transconductor a weight [1]_.

    Parameters
    ----------
    a0 : float
        Voltage gain of a transconductor into its own output resistance.
    linear_range : float
        Volts of the tanh, over full scale.
    gbw : float
        What network time is scaled by, as for op amps, in Hz.

    Returns
    -------
    Level

    Raises
    ------
    NetworkError
        If a number is not positive.

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
    """Switched capacitors: the recurrent layer with a fixed step, one step a clock period [1]_.

    Parameters
    ----------
    a0, gbw : float
        Of the op amps: open-loop gain, and gain-bandwidth product in Hz.
    step : float
        Network time of a period.
    clock : float
        In Hz.
    **given : float
        Further attributes of `SwitchedCapacitors`.

    Returns
    -------
    Level

    Raises
    ------
    NetworkError
        If a number is out of its range.

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
    """CMOS op amps, Gilbert multipliers, functions as polynomials: no behavioural source.

    Parameters
    ----------
    area : float
        Of the op amps' matched gates over the smallest, 1 to 64; see `transistor_sheet`.

    Returns
    -------
    Level

    Raises
    ------
    NetworkError
        If the area is out of its range.

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
"""That of the smallest transistors."""
