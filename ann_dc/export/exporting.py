"""Export of networks to folders: one folder per format, with an index of files.

A file is replaced after its successor is complete, by one writer at a time, and the index is
written last. An interrupted export leaves complete old and new files and an index that does not
match them, so the mixture is detected. In a new folder the index is also written first. Files that
no index names belong to the user and are not changed.
"""

from __future__ import annotations

import contextlib
import difflib
import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ann_dc
from ann_dc.errors import (
    ExportError,
    ExportPackageMissing,
    FileFormatError,
    OutputError,
    UnknownNameError,
)
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.formats import Files, Format, reason_of
from ann_dc.export.index import INDEX, Index, below, hashes_of, is_as_written, read_index
from ann_dc.export.readme import ABOUT, readme
from ann_dc.export.reference.contents import README
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.files import Lock, as_output_error, make_folder, write_whole
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.validation import PositiveFinite, checked

DRIVEN = ("weights", "csv", "pack", "ltspice", "xyce")
"""Formats that hold inputs over time."""
LOCK = ".lock"
"""File in a folder that marks a writer while it is active."""


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Result of one format's export.

    ``files`` were written, the index last; there are none if the format cannot represent the
    network, for the reason ``why_not``. ``worth`` is the result of the format's check.
    """

    name: str
    folder: Path
    files: tuple[Path, ...] = ()
    worth: str = ""
    why_not: str = ""


@checked
def export_network(
    network: Network,
    to: str | Sequence[str],
    out: str | os.PathLike[str],
    *,
    duration: PositiveFinite | None = None,
    progress: Progress = silent,
    **settings: Any,
) -> list[Exported]:
    """Export a network in one or several formats, each to a separate folder.

    The files of a format are checked before they are written.

    Parameters
    ----------
    network : Network
        Designed network with gains, inputs and an initial guess.
    to : str or sequence of str
        Names of formats; "all" denotes every format that can represent the network.
    out : path-like
        Output folder; the files of a format are written to a subfolder with the format's name.
    duration : float, optional
        Network time of the runs by which circuits and integers are scaled, for a network that does
        not settle; by default they last until it settles.
    progress : Progress
        Receiver of progress messages. Silent by default.
    **settings
        Settings of the formats; each format uses the settings that it has.

    Returns
    -------
    list of Exported
        One entry per format. With "all" or several formats, the reason is recorded for a format
        that cannot represent the network, lacks a package or fails otherwise, and the other formats
        are written. A single format raises an error instead.

    Raises
    ------
    UnknownNameError
        If a format or a setting does not exist.
    ExportError
        If the format cannot represent the network, or its files do not pass its check.
    ExportPackageMissing
        If a required package is not installed.
    OutputError
        If the folder cannot be written, or another process is writing there.

    Examples
    --------
    >>> import tempfile, ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [done] = export_network(network, "weights", folder)
    ...     print(*sorted(file.name for file in done.files))
    README.md export.json manifest.json network.safetensors reference_vector.json
    """
    names = _asked(to)
    for name in settings:
        _form_with(name, names)
    place = make_folder(out)
    progress("run to the settled point" if duration is None else "first steps")
    vector = reference_vector(network, duration=duration)
    done = []
    for name in names:
        progress(f"writing {name} ({len(done) + 1} of {len(names)})")
        try:
            done.append(_exported(name, network, vector, settings, place / name))
        except Exception as error:  # whatever it is, the others are written
            if len(names) == 1:
                raise
            done.append(Exported(name=name, folder=place / name, why_not=reason_of(error)))
    return done


def settings_from(to: str | Sequence[str], words: Mapping[str, str]) -> dict[str, Any]:
    """Convert setting texts to the types of the settings in the given formats."""
    names = _asked(to)
    return {key: _form_with(key, names).setting_of(key, word) for key, word in words.items()}


def _form_with(setting: str, formats: Iterable[str]) -> Format:
    """Return the first of the named formats that has a setting."""
    forms = [FORMATS[name] for name in formats]
    for form in forms:
        if setting in form.settings:
            return form
    known = {key for form in forms for key in form.settings}
    near = difflib.get_close_matches(setting, known, 1)
    there = f"choose from: {', '.join(known)}" if known else "these formats have no settings"
    what = f"did you mean {near[0]!r}?" if near else there
    raise UnknownNameError(f"setting {setting!r} does not exist; {what}")


def _asked(to: str | Sequence[str]) -> list[str]:
    """Return the distinct names of the requested formats."""
    given = [to] if isinstance(to, str) else list(to)
    if not given:
        raise ExportError(f"to: expected one or more formats of: all, {', '.join(FORMATS)}")
    for name in given:
        if name not in ("all", *FORMATS):
            raise UnknownNameError.of("format", name, ["all", *FORMATS])
    return list(FORMATS) if "all" in given else list(dict.fromkeys(given))


def _exported(
    name: str, network: Network, vector: ReferenceVector, settings: Mapping[str, Any], folder: Path
) -> Exported:
    """Create, check and write the files of one format."""
    if network.waveforms and name not in DRIVEN:
        raise ExportError(
            f"inputs: expected constant values for {name}, got {', '.join(network.waveforms)} "
            f"over time; use one of {', '.join(DRIVEN)}, or export the network of one time, "
            "network.at_time(0.0)"
        )
    form = FORMATS[name]
    own = {key: value for key, value in settings.items() if key in form.settings}
    files = form.write(network, vector, **own)
    worth = _worth(name, files)
    if name in ABOUT:
        files = {**files, README: readme(name, form, network, vector, files)}
    index = Index(
        to=name,
        title=network.title,
        version=ann_dc.__version__,
        wiring=vector.wiring,
        content=vector.content,
        settings={key: getattr(value, "name", value) for key, value in own.items()},
        files=hashes_of(files),
    )
    _write_locked(folder, files, index)
    written = tuple(folder / name for name in (*files, INDEX))
    return Exported(name=name, folder=folder, files=written, worth=worth)


def _worth(name: str, files: Files) -> str:
    """Return the result of a format's check of files before they are written."""
    try:
        return FORMATS[name].check(files)
    except ExportPackageMissing as error:
        return f"not checked: {error}"
    except FileFormatError as error:
        raise ExportError(
            f"{name}: the files failed their check and are not written: {error}"
        ) from error


def _write_locked(folder: Path, files: Files, index: Index) -> None:
    """Write the files of a format to its folder and remove those of an earlier export."""
    make_folder(folder)
    for name in (*files, INDEX, LOCK):
        _check_own(folder, name)
    with as_output_error(folder / LOCK):
        lock = Lock(folder / LOCK)
    try:
        with as_output_error(folder):
            _write(folder, files, index)
    finally:
        open_stays = (PermissionError,) if os.name == "nt" else ()  # removed at the release there
        try:
            with as_output_error(folder / LOCK), contextlib.suppress(*open_stays):
                (folder / LOCK).unlink(missing_ok=True)
        finally:
            lock.release()


def _write(folder: Path, files: Files, index: Index) -> None:
    before = _named_before(folder)
    for name, content in files.items():
        if name not in before:
            _check_foreign(folder / name, content)
    if not before:
        _check_foreign(folder / INDEX, index.as_json())
        write_whole(folder / INDEX, index.as_json())
    for name in (*before, *files, INDEX):
        _remove_parts(folder / name)
    for name, content in files.items():
        make_folder((folder / name).parent)
        write_whole(folder / name, content)
    write_whole(folder / INDEX, index.as_json())
    for name in before.keys() - files.keys():
        if is_as_written(folder, name, before[name]):
            (folder / name).unlink()


def _check_own(folder: Path, name: str) -> None:
    """Raise `OutputError` for a path with a symbolic link, which points elsewhere."""
    for place in below(folder, name):
        if place.is_symlink():
            raise OutputError(
                f"{str(place)!r} is a link, which an export does not follow; remove the link, "
                "or use another folder"
            )


def _check_foreign(file: Path, content: bytes) -> None:
    """Raise `OutputError` if a file would be replaced that no known export wrote."""
    if file.is_file() and file.read_bytes() != content:
        raise OutputError(
            f"{str(file)!r} already exists and was not written by an export; move it, or use "
            "another folder"
        )


def _remove_parts(file: Path) -> None:
    """Remove partial files that a killed process has left."""
    for part in file.parent.glob(f".{glob.escape(file.name)}.*.part"):
        if part.is_file() or part.is_symlink():
            part.unlink()


def _named_before(folder: Path) -> Mapping[str, str]:
    """Return the files and hashes in the index of an earlier export."""
    try:
        return read_index(folder).files
    except FileFormatError:
        return {}
