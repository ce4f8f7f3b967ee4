"""Error types of the package, and words for their messages.

Every error inherits from `AnnDcError` and from the matching builtin exception. Its message names
the field, the given value and a remedy.
"""

import collections.abc as abc
import enum
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

_Class = TypeVar("_Class", bound=type)

_EXAMPLES: dict[type, str] = {}
_LONGEST_TEXT = 40  # characters of a given text in a message


class AnnDcError(Exception):
    """Base class of all errors that ann_dc raises deliberately."""


class ArgumentError(AnnDcError):
    """Raised if an argument does not match its type hint; the message names a remedy."""


class ArgumentTypeError(ArgumentError, TypeError):
    """Raised if an argument has the wrong type."""


class ArgumentValueError(ArgumentError, ValueError):
    """Raised if an argument is nan, empty, out of range or of another shape."""


class ProblemError(AnnDcError, ValueError):
    """Raised if a network cannot solve the declared optimal-control problem."""


class ExpressionError(ProblemError):
    """Raised if a text expression (in a TOML problem file) is not plain mathematics."""


class ScenarioError(AnnDcError, ValueError):
    """Raised if planning is impossible with a world, an obstacle or a robot."""


class StudyError(AnnDcError, ValueError):
    """Raised if a study requests a setting or preconditioner that is not available."""


class StoreError(AnnDcError, OSError):
    """Raised if a study database cannot be read, written or combined with new results."""


class FormError(AnnDcError, ValueError):
    """Raised if a switch of the printed form does not apply to the problem."""


class NetworkError(AnnDcError, ValueError):
    """Raised if a network description is inconsistent."""


class SynthesisError(NetworkError):
    """Raised if a stage equation cannot be wired with the available blocks."""


class DesignError(AnnDcError, ValueError):
    """Raised if gains cannot be designed for a network with the given settings."""


class FileFormatError(AnnDcError, ValueError):
    """Raised if a file does not match its name or its manifest."""


class ExportError(AnnDcError, ValueError):
    """Raised if a format cannot represent a network or its settings.

    The message names the unsupported part.
    """


class OutputError(AnnDcError, OSError):
    """Raised if a result cannot be written to the requested place."""


class UnknownNameError(AnnDcError, LookupError):
    """Raised if a name does not exist; the message lists the available names.

    Examples
    --------
    >>> raise UnknownNameError.of("plant", "cat", ["car", "cstr"])
    Traceback (most recent call last):
    ann_dc.errors.UnknownNameError: plant 'cat' does not exist; choose one of: car, cstr
    """

    @classmethod
    def of(cls, kind: str, given: object, available) -> "UnknownNameError":
        """Return the error for a requested name and the available names of a ``kind``."""
        return cls(f"{kind} {str(given)!r} does not exist; choose one of: {', '.join(available)}")


def require_positive(kind: type[AnnDcError] = NetworkError, /, **numbers: float) -> None:
    """Raise an error if a number is not positive and finite.

    Parameters
    ----------
    kind : type of AnnDcError
        Type of the error. Default: `NetworkError`.
    **numbers : float
        Numbers by field name.

    Raises
    ------
    AnnDcError
        Error of this type that names the first invalid number.

    Examples
    --------
    >>> require_positive(DesignError, penalty=2.0, dual=-1.0)
    Traceback (most recent call last):
    ann_dc.errors.DesignError: dual: expected a positive number, got -1.0
    """
    for name, value in numbers.items():
        if not 0 < value < float("inf"):
            raise kind(f"{name}: expected a positive number, got {value!r}")


class PandasMissing(AnnDcError, ImportError):
    """Raised if pandas, required for data frames, is not installed."""


class PlotlyMissing(AnnDcError, ImportError):
    """Raised if plotly, required for the figures of a page, is not installed."""


class JinjaMissing(AnnDcError, ImportError):
    """Raised if jinja2, required for the HTML of a page, is not installed."""


class ExportPackageMissing(AnnDcError, ImportError):
    """Raised if a package for a format is missing; the message has the command."""


class PyarrowMissing(AnnDcError, ImportError):
    """Raised if pyarrow, required for Parquet files, is not installed."""


class PdkMissing(AnnDcError, ImportError):
    """Raised if foundry transistor models are missing; the message has the command."""


class NgspiceMissing(AnnDcError, RuntimeError):
    """Raised if the ngspice executable is not found."""


class SpiceError(AnnDcError, RuntimeError):
    """Raised if a simulation fails; the message has the end of the ngspice log."""


class SpiceInputError(SpiceError, ValueError):
    """Raised if a netlist, a sidecar file or a setting is not valid for ngspice."""


class SpiceTimeoutError(SpiceError, TimeoutError):
    """Raised if an ngspice run exceeds its time limit."""


class SpiceCrashError(SpiceError):
    """Raised if ngspice cannot be started, is killed, or ends with an exit code."""


class EndedEarlyError(SpiceError):
    """Raised if a transient stops before its end."""


class NotFiniteError(SpiceError, ArithmeticError):
    """Raised if a simulated voltage or current is not finite."""


class RawFileError(SpiceError, FileFormatError):
    """Raised if a raw file is missing, truncated, or inconsistent with its header."""


class RangeWarning(UserWarning):
    """Issued if an input lies outside the ranges for which a network was designed."""


def such_as(example: str) -> Callable[[_Class], _Class]:
    """Declare an example of a class, such as "ann_dc.plants.car()", for error messages."""

    def keep(kind: _Class) -> _Class:
        _EXAMPLES[kind] = example
        return kind

    return keep


def class_words(kind: type) -> str:
    """Return the description of an instance of a class in messages, with its example."""
    if issubclass(kind, enum.Enum):
        return f"one of {', '.join(map(str, kind))}"
    example = f" such as {_EXAMPLES[kind]}" if kind in _EXAMPLES else ""
    return _with_article(kind.__name__) + example


def given_words(given: Any) -> str:
    """Return the description of a given value in error messages."""
    code = getattr(getattr(given, "dtype", None), "kind", "")  # NumPy is not loaded for it
    shape = getattr(given, "shape", ()) if code else ()
    if shape:
        kind = "an array" if code in "fiu" else f"an array of {given.dtype}"
        return f"{kind} of shape {shape}"
    if code or given is None or isinstance(given, (bool, int, float, complex, enum.Enum)):
        return repr(given)
    if isinstance(given, (str, bytes)):
        text = repr(given[:_LONGEST_TEXT]) + ("..." if len(given) > _LONGEST_TEXT else "")
        return f"{'the text' if isinstance(given, str) else 'the bytes'} {text}"
    if isinstance(given, type) or inspect.isroutine(given):
        kind = "class" if isinstance(given, type) else "function"
        return f"the {kind} {getattr(given, '__name__', given)}"
    name = type(given).__name__
    if isinstance(given, abc.Collection) and type(given).__module__ == "builtins":
        return f"{_with_article(name)} of {len(given)}" if given else f"an empty {name}"
    return _with_article(name)


def _with_article(name: str) -> str:
    return f"{'an' if name[:1] in 'AEIOaeio' else 'a'} {name}"
