"""What can go wrong, as types.

Every error inherits from `AnnDcError` and from the builtin that a user would expect, and its
sentence says which field is wrong, what was given, and what to do.
"""


class AnnDcError(Exception):
    """Base of every error that ann_dc raises on purpose."""


class ArgumentError(AnnDcError):
    """An argument is not what its type hint says; the message says what to pass."""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument is of another type than it has to be."""


class ArgumentValueError(ArgumentError, ValueError):
    """An argument is of the right type, but nan, empty, out of range or of another shape."""


class ProblemError(AnnDcError, ValueError):
    """A declared optimal-control problem is not one that a network can solve."""


class ExpressionError(ProblemError):
    """A text expression (in a TOML problem file) is not plain mathematics."""


class WorldError(AnnDcError, ValueError):
    """A world, an obstacle or a robot is not one that anything can be planned in."""


class StudyError(AnnDcError, ValueError):
    """A study asks for what cannot be varied or measured."""


class StoreError(AnnDcError, OSError):
    """The store of a study cannot be read, written, or mixed with what it holds."""


class FormError(AnnDcError, ValueError):
    """A switch of the printed form has no meaning for this problem."""


class NetworkError(AnnDcError, ValueError):
    """A network description contradicts itself."""


class SynthesisError(NetworkError):
    """A stage equation cannot be wired with the available blocks."""


class DesignError(AnnDcError, ValueError):
    """Gains cannot be designed for this network with these settings."""


class FileFormatError(AnnDcError, ValueError):
    """A file is not what its name or its manifest says."""


class ExportError(AnnDcError, ValueError):
    """A format cannot carry a network, or not with these settings; the message names what."""


class OutputError(AnnDcError, OSError):
    """A result cannot be written where it was asked for."""


class UnknownNameError(AnnDcError, LookupError):
    """A name is not among those that exist; the message lists them.

    Examples
    --------
    >>> raise UnknownNameError.of("plant", "cat", ["car", "cstr"])
    Traceback (most recent call last):
    ann_dc.errors.UnknownNameError: plant 'cat' does not exist; choose one of: car, cstr
    """

    @classmethod
    def of(cls, kind: str, given: object, available) -> "UnknownNameError":
        """Build the error from what was asked for and what there is.

        Parameters
        ----------
        kind : str
            What a name stands for, as the message begins.
        given : object
            What was asked for.
        available : iterable of str
            The names that exist.

        Returns
        -------
        UnknownNameError
        """
        return cls(f"{kind} {str(given)!r} does not exist; choose one of: {', '.join(available)}")


def require_positive(kind: type[AnnDcError] = NetworkError, /, **numbers: float) -> None:
    """Refuse a number that is not positive and finite, by its name.

    Parameters
    ----------
    kind : type of AnnDcError
        What is raised.
    **numbers : float
        By the name of their field.

    Raises
    ------
    AnnDcError
        Of that kind, naming the first that is not.

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
    """There is no pandas to make a data frame with."""


class PlotlyMissing(AnnDcError, ImportError):
    """There is no plotly to draw the figures of a page with."""


class ExportPackageMissing(AnnDcError, ImportError):
    """A package that writes or reads a format is not installed; the message has the line."""


class PyarrowMissing(AnnDcError, ImportError):
    """There is no pyarrow to write a Parquet file with."""


class PdkMissing(AnnDcError, ImportError):
    """The models of a foundry's transistors are not installed; the message has the line."""


class NgspiceMissing(AnnDcError, RuntimeError):
    """There is no ngspice to run a circuit with."""


class SpiceError(AnnDcError, RuntimeError):
    """A circuit could not be simulated; the message has the end of ngspice's log."""


class SpiceInputError(SpiceError, ValueError):
    """A deck, a file beside it or a setting is not one that ngspice can be run with."""


class SpiceTimeoutError(SpiceError, TimeoutError):
    """A run of ngspice took longer than it was given."""


class SpiceCrashError(SpiceError):
    """A run of ngspice could not be started, was killed, or ended with an exit code."""


class EndedEarlyError(SpiceError):
    """A transient stopped before its end."""


class NotFiniteError(SpiceError, ArithmeticError):
    """A simulated voltage or current is no number."""


class RawFileError(SpiceError, FileFormatError):
    """A raw file is missing, cut off, or not what its header says."""


class RangeWarning(UserWarning):
    """An input lies outside the ranges for which a network was designed."""
