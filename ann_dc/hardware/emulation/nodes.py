"""Names of the nodes of an emulation, and their counterparts in the ideal network."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AmplifierNodes:
    """Names of the nodes of an amplifier, or of the inverter behind a part.

    Attributes
    ----------
    inverter : bool
        True for the inverter behind the part.
    rectified : bool
        True for the op amp before the diodes.

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
        """Output."""
        if self.rectified:
            return f"open.{self.part}"
        return f"not.{self.part}" if self.inverter else self.part

    @property
    def summed(self) -> str:
        """Sum of the input resistors' contributions."""
        return f"summed.{self.output}"

    @property
    def ground(self) -> str:
        """Virtual ground."""
        return f"ground.{self.output}"

    @property
    def bias(self) -> str:
        """Bias current of the input, times the value of one volt at the output."""
        return f"bias.{self.output}"

    @property
    def lagging(self) -> str:
        """Virtual ground that a rectifying neuron would have without its diodes."""
        return f"lagging.{self.output}"

    @property
    def first(self) -> str:
        """Node between the first and the second pole."""
        return f"first.{self.output}"

    @property
    def below(self) -> str:
        """Distance below the conduction threshold of the virtual ground's diode."""
        return f"below.{self.output}"

    @property
    def back(self) -> str:
        """Current of that diode from the virtual ground."""
        return f"back.{self.output}"

    @property
    def beyond(self) -> str:
        """Distance from the conduction threshold of the output diode while it is off."""
        return f"beyond.{self.output}"

    @property
    def pace(self) -> str:
        """Rate of the output diode's far end relative to that of the op amp."""
        return f"pace.{self.output}"

    @property
    def paced(self) -> str:
        """Product of net input and pace."""
        return f"paced.{self.output}"

    @property
    def drop_free(self) -> str:
        """Net input without the drop of the output diode."""
        return f"drop_free.{self.output}"

    @property
    def held(self) -> str:
        """Voltage across the capacitor."""
        return f"held.{self.output}"

    @property
    def trailing(self) -> str:
        """Current of the capacitor, delayed by one op-amp time constant."""
        return f"trailing.{self.output}"

    @property
    def leak(self) -> str:
        """Leakage into the capacitor."""
        return f"leak.{self.output}"

    @property
    def clamps(self) -> str:
        """Follower voltage of the inactive op amps of the limits."""
        return f"clamps.{self.output}"

    @property
    def drive(self) -> str:
        """Net input at infinite slew rate."""
        return f"drive.{self.output}"


@dataclass(frozen=True)
class ClampNodes:
    """Names of the nodes of the clamp at one of an integrator's limits.

    Attributes
    ----------
    part : str
        Name of the integrator.
    upper : bool
        True for the upper limit.
    """

    part: str
    upper: bool

    @property
    def op_amp(self) -> str:
        """Output of the op amp."""
        return f"clamp_{'hi' if self.upper else 'lo'}.{self.part}"

    @property
    def share(self) -> str:
        """Fraction of the capacitor in the clamp, at the end opposite the virtual ground."""
        return f"share.{self.op_amp}"

    @property
    def short(self) -> str:
        """Shortfall of the other input from the reference, over V_T, by the idle diode."""
        return f"short.{self.op_amp}"

    @property
    def current(self) -> str:
        """Current of the clamp times its resistors, over V_T."""
        return f"current.{self.op_amp}"

    @property
    def drive(self) -> str:
        """Net input of the op amp at infinite slew rate."""
        return f"drive.{self.op_amp}"


@dataclass(frozen=True)
class Origin:
    """Counterpart of a neuron: ``sign`` times a node of the ideal network.

    Attributes
    ----------
    node : str
        Node of the ideal network.
    sign : float
        1 or -1.
    """

    node: str
    sign: float = 1.0
