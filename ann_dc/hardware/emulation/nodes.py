"""What the nodes of an emulation are called, and which of the ideal network they stand for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AmplifierNodes:
    """Names of the nodes that stand for an amplifier, or for the inverter behind a part.

    Attributes
    ----------
    part : str
        Name of the part.
    inverter : bool
        Whether the inverter behind it is meant.
    rectified : bool
        Whether its op amp before the diodes is meant.

    Examples
    --------
    >>> AmplifierNodes("q.x").held, AmplifierNodes("q.x", inverter=True).output
    ('held.q.x', 'not.q.x')
    """

    part: str
    inverter: bool = False
    rectified: bool = False

    @property
    def output(self) -> str:
        """Its output."""
        if self.rectified:
            return f"open.{self.part}"
        return f"not.{self.part}" if self.inverter else self.part

    @property
    def summed(self) -> str:
        """What its input resistors bring."""
        return f"summed.{self.output}"

    @property
    def ground(self) -> str:
        """Its virtual ground."""
        return f"ground.{self.output}"

    @property
    def bias(self) -> str:
        """The bias current of its input, times what a volt at its output stands for."""
        return f"bias.{self.output}"

    @property
    def lagging(self) -> str:
        """What the virtual ground of a diode neuron would be without its diodes."""
        return f"lagging.{self.output}"

    @property
    def first(self) -> str:
        """Behind the first of its two poles."""
        return f"first.{self.output}"

    @property
    def below(self) -> str:
        """How far it is below where the diode of its virtual ground begins to conduct."""
        return f"below.{self.output}"

    @property
    def back(self) -> str:
        """What that diode takes from its virtual ground."""
        return f"back.{self.output}"

    @property
    def beyond(self) -> str:
        """Its distance from where its own diode begins to conduct, while that is off."""
        return f"beyond.{self.output}"

    @property
    def pace(self) -> str:
        """The rate at which the far end of its own diode follows, over its own."""
        return f"pace.{self.output}"

    @property
    def paced(self) -> str:
        """Its drive times its pace."""
        return f"paced.{self.output}"

    @property
    def drop_free(self) -> str:
        """Its drive, had its own diode no drop."""
        return f"drop_free.{self.output}"

    @property
    def held(self) -> str:
        """The voltage across its capacitor."""
        return f"held.{self.output}"

    @property
    def trailing(self) -> str:
        """The current of that capacitor, one time constant of an op amp late."""
        return f"trailing.{self.output}"

    @property
    def leak(self) -> str:
        """What leaks into that capacitor."""
        return f"leak.{self.output}"

    @property
    def clamps(self) -> str:
        """What the op amps of its rails, which are off, follow it with."""
        return f"clamps.{self.output}"

    @property
    def drive(self) -> str:
        """What would drive it, were its slew rate infinite."""
        return f"drive.{self.output}"


@dataclass(frozen=True)
class ClampNodes:
    """Names of the nodes that stand for the clamp of one of an integrator's rails.

    Attributes
    ----------
    part : str
        Name of the integrator.
    upper : bool
        Of its two rails.
    """

    part: str
    upper: bool

    @property
    def op_amp(self) -> str:
        """The output of its op amp."""
        return f"clamp_{'hi' if self.upper else 'lo'}.{self.part}"

    @property
    def share(self) -> str:
        """The capacitor's share in it, at the end that is not the virtual ground."""
        return f"share.{self.op_amp}"

    @property
    def short(self) -> str:
        """By what its other input is short of the reference, over V_T: through the idle diode."""
        return f"short.{self.op_amp}"

    @property
    def current(self) -> str:
        """What it carries, times its resistors, over V_T."""
        return f"current.{self.op_amp}"

    @property
    def drive(self) -> str:
        """What would drive its op amp, were the slew rate infinite."""
        return f"drive.{self.op_amp}"


@dataclass(frozen=True)
class Origin:
    """What a neuron stands for: ``sign`` times a node of the ideal network.

    Attributes
    ----------
    node : str
        Of the ideal network.
    sign : float
        1 or -1.
    """

    node: str
    sign: float = 1.0
