"""How a number of the network stands for a number of the user: a factor and an offset."""

from __future__ import annotations

from typing import Any, NamedTuple

from ann_dc.validation.checked import checked


class _Numbers(NamedTuple):
    factor: float = 1.0
    offset: float = 0.0


@checked
class Scale(_Numbers):
    """User's value = offset + factor * network's value.

    Attributes
    ----------
    factor : float
        The user's amount that a step of 1 in the network stands for.
    offset : float
        The user's value of a zero in the network; -0.0 becomes 0.0, because equal scales are
        written alike.

    Examples
    --------
    >>> kelvin = Scale(factor=20.0, offset=300.0)
    >>> kelvin.user(1.5), kelvin.network(310.0)
    (330.0, 0.5)
    """

    __slots__ = ()

    def __new__(cls, factor: float = 1.0, offset: float = 0.0):  # noqa: D102
        return super().__new__(cls, factor, offset or 0.0)

    def user(self, value: Any) -> Any:
        """The user's value of a network's ``value``, a number or an array of any library."""
        return self.offset + self.factor * value

    def network(self, value: Any) -> Any:
        """The network's value of a user's ``value``."""
        return (value - self.offset) / self.factor


IDENTITY = Scale()
"""A number that stands for itself."""
