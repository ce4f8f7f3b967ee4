"""Names of the nodes of an emulation, and their counterparts in the ideal network."""

from __future__ import annotations

from dataclasses import dataclass


class _Inner:
    """Name of an inner node: that of the attribute, before that of the output."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, nodes: AmplifierNodes | ClampNodes, owner: type) -> str:
        return f"{self._name}.{nodes.output}"


@dataclass(frozen=True)
class AmplifierNodes:
    """Names of the nodes of an amplifier, of its inverter, or of its op amp before diodes.

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

    summed = _Inner()
    """Sum of the input resistors' contributions."""
    ground = _Inner()
    """Virtual ground."""
    bias = _Inner()
    """Bias current of the input, times the value of one volt at the output."""
    lagging = _Inner()
    """Virtual ground that a rectifying neuron would have without its diodes."""
    first = _Inner()
    """Node between the first and the second pole."""
    below = _Inner()
    """Distance below the conduction threshold of the virtual ground's diode."""
    back = _Inner()
    """Current of that diode from the virtual ground."""
    beyond = _Inner()
    """Distance from the conduction threshold of the output diode while it is off."""
    pace = _Inner()
    """Rate of the output diode's far end relative to that of the op amp."""
    paced = _Inner()
    """Product of net input and pace."""
    drop_free = _Inner()
    """Net input without the drop of the output diode."""
    held = _Inner()
    """Voltage across the capacitor."""
    trailing = _Inner()
    """Current of the capacitor, delayed by one op-amp time constant."""
    leak = _Inner()
    """Leakage into the capacitor."""
    clamps = _Inner()
    """Follower voltage of the inactive op amps of the limits."""
    drive = _Inner()
    """Net input at infinite slew rate."""


@dataclass(frozen=True)
class ClampNodes:
    """Names of the nodes of the clamp at the upper or lower limit of an integrator ``part``."""

    part: str
    upper: bool

    @property
    def output(self) -> str:
        """Output of the op amp."""
        return f"clamp_{'hi' if self.upper else 'lo'}.{self.part}"

    share = _Inner()
    """Fraction of the capacitor in the clamp, at the end opposite the virtual ground."""
    short = _Inner()
    """Shortfall of the other input from the reference, over V_T, by the idle diode."""
    current = _Inner()
    """Current of the clamp times its resistors, over V_T."""
    drive = _Inner()
    """Net input of the op amp at infinite slew rate."""


@dataclass(frozen=True)
class Origin:
    """Counterpart of a neuron: ``sign`` (1 or -1) times a node of the ideal network."""

    node: str
    sign: float = 1.0
