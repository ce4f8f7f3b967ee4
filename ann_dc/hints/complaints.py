"""What is wrong with a value, and the error that says it: what was expected, given, and to pass."""

from __future__ import annotations

import collections.abc as abc
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from ann_dc.errors import ArgumentError, ArgumentTypeError
from ann_dc.hints.words import class_words, given_words, way_out


@dataclass(frozen=True, kw_only=True)
class Complaint:
    """What is wrong with a value.

    Attributes
    ----------
    expected : str
        In words.
    given : object
    where : str
        The place inside the argument, such as "[2]"; empty where it is the argument itself.
    error : type of ArgumentError
        What is raised.
    wanted : type or None
        The class that was expected, where it was one.
    """

    expected: str
    given: object
    where: str = ""
    error: type[ArgumentError] = ArgumentTypeError
    wanted: type | None = None

    def raised_for(self, name: str) -> ArgumentError:
        """The error for an argument of that ``name``."""
        hint, kind = "", self.wanted
        if kind is not None:
            fits = class_check(kind)
            hint = way_out(self.given, kind, lambda one: fits(one) is None)
        return self.error(
            f"{name}{self.where}: expected {self.expected}, got {given_words(self.given)}{hint}"
        )


Check: TypeAlias = Callable[[Any], Complaint | None]
"""None where a value is as it should be."""


def class_check(kind: type) -> Check:
    """The check of a class: of a protocol by its members, of any other by `isinstance`."""
    if kind in (abc.Callable, types.FunctionType):
        return callable_check
    protocol = getattr(kind, "_is_protocol", False)
    members = _members(kind) if protocol else ()

    def check(value: Any) -> Complaint | None:
        fits = all(_has(value, m) for m in members) if protocol else isinstance(value, kind)
        if fits and not (protocol and isinstance(value, type)):
            return None
        return Complaint(expected=class_words(kind), given=value, wanted=kind)

    return check


def _members(protocol: type) -> tuple[str, ...]:
    """Names that a protocol asks for."""
    kinds = [kind for kind in protocol.__mro__ if getattr(kind, "_is_protocol", False)]
    names = {n for kind in kinds for n in (*vars(kind), *getattr(kind, "__annotations__", {}))}
    asked = {name for name in names if not name.startswith("_") or name == "__call__"}
    return tuple(sorted(asked - {"__init__"}))


def _has(value: Any, name: str) -> bool:
    """Whether an object has an attribute; a property of its class is not evaluated."""
    return hasattr(type(value), name) or name in getattr(value, "__dict__", ())


def callable_check(value: Any) -> Complaint | None:
    """The check of a function: a ``value`` that can be called and is no class."""
    if callable(value) and not isinstance(value, type):
        return None
    return Complaint(expected="a function", given=value)
