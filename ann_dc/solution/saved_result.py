"""Storage of a result as a folder that is either complete or rejected.

=================  ===============================================================================
``manifest.json``  readable content: formulas, figures, sentences, and the list of the arrays
``arrays.npz``     arrays of the records, by place: ``run/trajectory/states``
``<name>.npz``     every network as a separate weight file, readable by `load`
``SHA256SUMS``     digests of the other files, checked also by ``sha256sum --check SHA256SUMS``
=================  ===============================================================================

The content is never executed or unpickled, and names cannot refer to places outside the folder.

A number, a text or a list of them is stored in the manifest. An array is a separate entry named by
its place, and the manifest stores its kind. A network is a separate file. None is omitted if the
field allows it (`WHERE_GIVEN`). Types come from the annotations of the records, so that a new field
is read without further code. A field with a default may be missing, as in files of earlier
versions. Shapes are declared in `SHAPES`, since annotations do not contain them.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import numbers
import os
import re
import types
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.trajectory import Trajectory
from ann_dc.dataclass_pickling import WHERE_GIVEN
from ann_dc.errors import AnnDcError, FileFormatError, OutputError, UnknownNameError
from ann_dc.files import check_new, read_whole, write_folder
from ann_dc.gain_design.gains import Gains
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.scheduled_run import ScheduledRun
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.progress import Stopped
from ann_dc.weights.entries import BROKEN, Entries, NpzEntries, packed_entries
from ann_dc.weights.manifest import Table, read_manifest, typed
from ann_dc.weights.network_file import MAX_BYTES, packed, unpacked

SHAPES: dict[type, dict[str, str]] = {
    Trajectory: {"time": "T", "states": "T n", "residual_time": "R", "residuals": "R 2"},
    Gains: {"rho": "P", "rate": "P N"},
    Multilevel: {"gains": "* C C"},
    Spectrum: {"eigenvalues": "*"},
    ScheduledRun: {"state": "n"},
    Candidate: {"other_equilibrium": "n"},
    Design: {"state": "n"},
}
"""Shapes of the arrays of a record; no size is zero.

n, P and N are those of the network, other letters agree within the record, a star is any size.
"""

NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}

FORMAT = "ann_dc solution"
SCHEMA = 2
MANIFEST, ARRAYS, SUMS = "manifest.json", "arrays.npz", "SHA256SUMS"
REMEDY = "use the path of a folder with a saved solution"
MAX_MANIFEST = 10_000_000
"""Largest size of `MANIFEST` in bytes."""
LONGEST_SUMS = 10_000
"""Largest size of `SUMS` in bytes; one line per file."""
SUM = re.compile(r"([0-9a-f]{64})  ([a-z]{1,40}\.(?:npz|json))")
"""Pattern of a line of `SUMS`: a digest, and the name of a file directly in the folder."""
PRECONDITIONERS: dict[str, type[Preconditioner]] = {
    kind.__name__: kind for kind in (Diagonal, Multilevel, ResistiveGrid, CyclicReduction)
}
"""Preconditioner classes by their name in a table."""


class Reader:
    """Reader of records about one network, which is inserted where a record has one."""

    def __init__(self, entries: Entries, network: Network | None) -> None:
        self.entries, self.network = entries, network

    def value(self, hint: Any, given: Any, place: str) -> Any:
        """Return a value of the annotated type `hint` from JSON data; messages begin with `place`.

        Data that do not match raise `FileFormatError` or `UnknownNameError`.
        """
        if get_origin(hint) in (types.UnionType, Union):
            (kind,) = (part for part in get_args(hint) if part is not type(None))
            return None if given is None else self.value(kind, given, place)
        if get_origin(hint) is not None:
            return self._composed(hint, given, place)
        if hint is np.ndarray:
            return self._array(given, place)
        if hint in (bool, int, float, str):
            return _plain(hint, given, place)
        if issubclass(hint, Enum):
            return _choice(hint.__members__, given, place)
        if hint is Preconditioner:
            return self._preconditioner(given, place)
        if hint is Stopped:
            return Stopped(_plain(str, given, place))
        return self.record(hint, given, place)

    def _composed(self, hint: Any, given: Any, place: str) -> Any:
        """Return a tuple of one type, or a mapping of names to one type."""
        if get_origin(hint) is tuple:
            kind = get_args(hint)[0]
            if not isinstance(given, list):
                raise FileFormatError(f"{place}: expected a list, got {given!r:.60}")
            return tuple(self.value(kind, part, f"{place}/{i}") for i, part in enumerate(given))
        kind = get_args(hint)[1]
        parts = Table(place, given).given
        return {name: self.value(kind, part, f"{place}/{name}") for name, part in parts.items()}

    def record(self, kind: type, given: Any, place: str) -> Any:
        """Return a record (dataclass), which validates its values.

        Raises `FileFormatError` if a field is missing, unknown, or of another type or shape.
        """
        table, hints = Table(place, given), _hints(kind)
        table.only(" ".join(hints))
        values = {}
        for field in fields(kind):
            name, hint = field.name, hints[field.name]
            if hint is Network:
                values[name] = self.network
            elif table.has(name):
                values[name] = self.value(hint, table.given[name], f"{place}/{name}")
            elif field.default is MISSING and field.default_factory is MISSING:
                raise FileFormatError(f"{place}/{name}: missing")
        self._check_shapes(kind, values, place)
        return kind(**values)

    def _preconditioner(self, given: Any, place: str) -> Any:
        table = dict(Table(place, given).given)
        kind = _choice(PRECONDITIONERS, table.pop("type", None), f"{place}/type")
        preconditioner = self.record(kind, table, place)
        if self.network is not None:
            with np.errstate(over="ignore"):  # of rates, where a time constant is next to nothing
                preconditioner.check(self.network.layout)
        return preconditioner

    def _array(self, given: Any, place: str) -> np.ndarray:
        """Return an array of any shape; the record that contains it checks the shape."""
        kind = _choice({"float": float, "complex": complex}, given, place)
        values = self.entries.numbers(place, *((None,) * axes for axes in range(5)))
        if kind is float:
            return values
        if values.shape[-1:] != (2,):
            raise FileFormatError(f"entry {place!r}: expected two parts of a complex number")
        return values[..., 0] + 1j * values[..., 1]

    def _check_shapes(self, kind: type, values: Mapping[str, Any], place: str) -> None:
        known: dict[str, int] = {}
        if self.network is not None:
            neurons, stages = self.network.live.shape
            known = {"n": self.network.size, "P": neurons, "N": stages}
        for name, shape in SHAPES.get(kind, {}).items():
            given = values.get(name)
            for array in given if isinstance(given, tuple) else (given,):
                if array is not None and not _fits(array.shape, shape.split(), known):
                    raise FileFormatError(
                        f"entry {f'{place}/{name}'!r} has shape {array.shape}, expected ({shape}) "
                        f"with {known}"
                    )


def _fits(shape: tuple[int, ...], letters: list[str], known: dict[str, int]) -> bool:
    """Return True if a shape is the expected one; new letters are added to `known`."""
    if len(shape) != len(letters):
        return False
    for length, letter in zip(shape, letters):
        expected = int(letter) if letter.isdigit() else known.setdefault(letter, length)
        if length < 1 or (letter != "*" and length != expected):
            return False
    return True


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _plain(kind: type, given: Any, place: str) -> Any:
    """Return a number, a text or a bool; a bool is not accepted as a number."""
    if kind is float and isinstance(given, str) and given in NOT_FINITE:
        return NOT_FINITE[given]
    if kind is float and isinstance(given, int) and not isinstance(given, bool):
        try:
            return float(given)
        except OverflowError:
            given = "a whole number beyond the range of a float"
    return typed(kind, given, place)


def _choice(available: Mapping[str, Any], given: Any, place: str) -> Any:
    if not isinstance(given, str) or given not in available:
        raise UnknownNameError.of(f"{place}:", given, available)
    return available[given]


# ---- A result as a folder, which is complete or refused


def check_result_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Raise `OutputError` if a result cannot be saved to this folder.

    With `overwrite` the folder of a saved result is accepted, but no other existing folder or file.
    """
    if _is_saved(Path(folder)):
        remedy = "use overwrite=True or --overwrite to replace it, or a new folder"
    else:
        remedy = "it is not a saved solution and is not replaced; use a new folder"
        overwrite = False
    check_new(folder, replace=overwrite, remedy=remedy)


def _is_saved(place: Path) -> bool:
    """Return True for a folder whose manifest is that of a saved result."""
    try:
        manifest = json.loads(read_whole(place / MANIFEST, MAX_MANIFEST, REMEDY))
    except (FileFormatError, ValueError, RecursionError):
        return False
    return isinstance(manifest, dict) and manifest.get("format") == FORMAT


def save_result(
    folder: str | os.PathLike[str],
    networks: Mapping[str, Network],
    records: Mapping[str, object],
    *,
    overwrite: bool = False,
) -> None:
    """Write networks and records into a folder, completely or not at all.

    Raises `OutputError` if the folder exists, unless `overwrite` is true and it is a saved result.
    """
    check_result_folder(folder, overwrite=overwrite)
    writer = Writer()
    manifest = {
        "format": FORMAT,
        "schema": SCHEMA,
        "networks": list(networks),
        "records": {name: writer.value(record, name) for name, record in records.items()},
    }
    files = {MANIFEST: (json.dumps(manifest, indent=1, allow_nan=False) + "\n").encode()}
    files[ARRAYS] = packed_entries({}, writer.arrays)
    files |= {f"{name}.npz": packed(network) for name, network in networks.items()}
    sums = "".join(f"{_digest(content)}  {name}\n" for name, content in files.items())
    write_folder(folder, {**files, SUMS: sums.encode()}, replace=overwrite)


class _SavedResult:
    """Content of a folder: manifest, arrays and networks; every record is taken once."""

    def __init__(self, table: Table, entries: Entries, networks: dict[str, Network]) -> None:
        table.only("format schema networks records")
        self.networks, self._entries = networks, entries
        self._records = dict(table.get("records", dict))

    def network(self, name: str) -> Network:
        """Return a network by name, or raise `FileFormatError`."""
        if name not in self.networks:
            raise FileFormatError(f"manifest.networks: {name!r} is missing; save the result again")
        return self.networks[name]

    def record(self, name: str, hint: Any, network: Network | None = None) -> Any:
        """Take a record of the type `hint`, or raise `FileFormatError` if it is missing."""
        if name not in self._records:
            raise FileFormatError(f"manifest.records: {name!r} is missing; save the result again")
        return Reader(self._entries, network).value(hint, self._records.pop(name), name)

    def finish(self) -> None:
        """Raise `FileFormatError` with the entries that were not taken, if any."""
        if self._records:
            raise FileFormatError(f"manifest.records: unknown {', '.join(sorted(self._records))}")
        self._entries.finish()


@contextlib.contextmanager
def opened_result(folder: str | os.PathLike[str]) -> Iterator[_SavedResult]:
    """Open a folder written by `save_result`; on exit all content must be taken.

    Raises `FileFormatError`, which begins with the folder, if it is invalid or incomplete.
    """
    place = Path(folder)
    try:
        files = _files(place)
        table = read_manifest(_taken(files, MANIFEST).decode(), FORMAT, SCHEMA)
        arrays = _taken(files, ARRAYS)
        networks = {
            name: unpacked(_taken(files, f"{name}.npz"), Path(f"{name}.npz"))
            for name in table.names("networks")
        }
        if files:
            raise FileFormatError(f"{SUMS}: names {', '.join(files)}, which the manifest does not")
        with zipfile.ZipFile(io.BytesIO(arrays)) as archive:
            saved = _SavedResult(table, NpzEntries(archive, len(arrays)), networks)
            yield saved
            saved.finish()
    except AnnDcError as error:
        raise FileFormatError(f"{place}: {error}") from error
    except BROKEN as error:
        raise FileFormatError(f"{place}: not a complete result ({error}); save it again") from error


def _files(folder: Path) -> dict[str, bytes]:
    """Return the contents of all files listed in `SUMS`, with checked digests."""
    if not folder.is_dir():
        reason = "is a file" if folder.exists() else "does not exist"
        raise FileFormatError(f"{reason}; {REMEDY}")
    sums = read_whole(folder / SUMS, LONGEST_SUMS, REMEDY).decode("ascii", "replace")
    files: dict[str, bytes] = {}
    for line in sums.removesuffix("\n").split("\n"):
        found = SUM.fullmatch(line)
        if found is None or found[2] in files:
            raise FileFormatError(
                f"{SUMS}: {line!r:.120} is not a valid line; save the result again"
            )
        largest = MAX_MANIFEST if found[2] == MANIFEST else MAX_BYTES
        content = read_whole(folder / found[2], largest, "save the result again")
        if _digest(content) != found[1]:
            raise FileFormatError(f"{found[2]}: changed after it was saved; save the result again")
        files[found[2]] = content
    return files


def _taken(files: dict[str, bytes], name: str) -> bytes:
    if name not in files:
        raise FileFormatError(f"{SUMS}: does not name {name[:60]!r}; save the result again")
    return files.pop(name)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Writer:
    """Writer of records that collects their arrays in ``arrays``, by place.

    A complex array has its real and imaginary parts in a last axis.
    """

    def __init__(self) -> None:
        self.arrays: dict[str, np.ndarray] = {}

    def value(self, value: Any, place: str) -> Any:
        """Convert None, bool, number, str, Enum, array, tuple, list, mapping or record to JSON.

        The cause of an early end becomes its text.
        """
        if value is None or isinstance(value, (bool, str)):
            return value
        if isinstance(value, numbers.Number):
            return self._number(value, place)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, np.ndarray):
            return self._array(value, place)
        if isinstance(value, Stopped):
            return str(value)
        return self._composed(value, place)

    def _composed(self, value: Any, place: str) -> Any:
        if isinstance(value, (tuple, list)):
            return [self.value(part, f"{place}/{i}") for i, part in enumerate(value)]
        if isinstance(value, Mapping):
            return {name: self.value(part, f"{place}/{name}") for name, part in value.items()}
        if is_dataclass(value) and not isinstance(value, type):
            return self._record(value, place)
        raise OutputError(f"{place}: a {type(value).__name__} cannot be saved")

    def _record(self, record: Any, place: str) -> dict[str, Any]:
        given = ((f, getattr(record, f.name)) for f in fields(record))
        values = {f.name: v for f, v in given if v is not None or WHERE_GIVEN not in f.metadata}
        kind = {"type": type(record).__name__} if isinstance(record, Preconditioner) else {}
        return kind | {
            name: self.value(value, f"{place}/{name}")
            for name, value in values.items()
            if not isinstance(value, Network)
        }

    def _number(self, value: Any, place: str) -> int | float | str:
        """Convert a number to JSON data; non-finite numbers become text."""
        if isinstance(value, numbers.Integral):
            return int(value)
        if not isinstance(value, numbers.Real):
            raise OutputError(f"{place}: {value!r} is not a real number and cannot be saved")
        return float(value) if math.isfinite(value) else str(float(value))

    def _array(self, values: np.ndarray, place: str) -> str:
        if values.dtype.kind not in "fc":
            raise OutputError(f"{place}: an array of {values.dtype} cannot be saved")
        is_complex = np.iscomplexobj(values)
        self.arrays[place] = (
            np.stack([np.real(values), np.imag(values)], -1) if is_complex else values
        )
        return "complex" if is_complex else "float"
