"""Linear scaling between network values and user values: factor and offset."""

from __future__ import annotations

from typing import Any, NamedTuple

from ann_dc.validation import checked


class _Numbers(NamedTuple):
    factor: float = 1.0
    offset: float = 0.0


@checked
class Scale(_Numbers):
    """Linear scaling: user's value = offset + factor * network's value.

    Attributes
    ----------
    factor : float
        User's amount per network step of 1.
    offset : float
        User's value of a network zero; -0.0 becomes 0.0, so that equal scales have equal text.

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
        """Return the user's value of a network ``value``, a number or any library's array."""
        return self.offset + self.factor * value

    def network(self, value: Any) -> Any:
        """Return the network value of a user's ``value``."""
        return (value - self.offset) / self.factor


IDENTITY = Scale()
"""Identity scale."""
