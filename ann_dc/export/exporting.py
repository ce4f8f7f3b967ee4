"""Networks into folders, one a format, with an index that tells what each file has to be.

A file is replaced when its successor is complete, one writer at a time, and the index comes last:
whoever was interrupted leaves old files and new ones, each of them whole, and an index that does
not fit them, so that a mixture is told. In a new folder the index comes first too: files that no
index names are somebody's own, and stay.
"""

from __future__ import annotations

import contextlib
import glob
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import ann_dc
from ann_dc.atomic_files import as_output_error, make_folder, write_whole
from ann_dc.errors import (
    AnnDcError,
    ExportError,
    ExportPackageMissing,
    FileFormatError,
    OutputError,
    UnknownNameError,
)
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.formats import Files, unknown_setting
from ann_dc.export.index import INDEX, Index, below, hashes_of, is_as_written, read_index
from ann_dc.export.readme import ABOUT, README, readme
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.file_locks import Lock
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked

LOCK = ".lock"
"""File in a folder that says who writes there, while somebody does."""


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What became of one format.

    Attributes
    ----------
    name : str
        Of the format.
    folder : Path
    files : tuple of Path
        Those written, the index last; none where the format cannot carry the network.
    worth : str
        What the format's check said of them.
    why_not : str
        Why there are none.
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
    progress: Progress = silent,
    **settings: Any,
) -> list[Exported]:
    """Write a network in one format or several, each into a folder of its own.

    What a format makes is checked before it is written.

    Parameters
    ----------
    network : Network
        Designed: it has gains, inputs and a start.
    to : str or sequence of str
        Names of formats; "all" is every one that can carry the network.
    out : path-like
        Folder; a format's files go into a folder of the format's name in it.
    progress : Progress
    **settings
        Of the formats; each takes those that it has.

    Returns
    -------
    list of Exported
        One a format. With "all" and several formats, those that cannot carry the network, lack a
        package or fail otherwise say so, and the others are written; one format alone raises.

    Raises
    ------
    UnknownNameError
        If a format or a setting does not exist.
    ExportError
        If the format cannot carry the network, or its files do not pass its check.
    ExportPackageMissing
        If a package for it is not installed.
    OutputError
        If the folder cannot be written, or another process writes there.

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
        if not any(name in FORMATS[asked].settings for asked in names):
            raise unknown_setting(name, {key for f in names for key in FORMATS[f].settings})
    place = make_folder(out)
    progress("walking to the settled point")
    vector = reference_vector(network)
    done = []
    for name in names:
        progress(f"writing {name} ({len(done) + 1} of {len(names)})")
        try:
            done.append(_exported(name, network, vector, settings, place / name))
        except Exception as error:  # whatever it is, the others are written
            if len(names) == 1:
                raise
            done.append(Exported(name=name, folder=place / name, why_not=_reason(error)))
    return done


def settings_from(to: str | Sequence[str], words: Mapping[str, str]) -> dict[str, Any]:
    """Settings of formats, each of the type that they have there, from words.

    Parameters
    ----------
    to : str or sequence of str
        As `export_network` takes it.
    words : mapping of str to str

    Raises
    ------
    UnknownNameError
        If a format does not exist, or none of them has the setting.
    ExportError
        If a word is no such value.
    """
    forms = [FORMATS[name] for name in _asked(to)]
    found = {}
    for name, word in words.items():
        form = next((form for form in forms if name in form.settings), None)
        if form is None:
            raise unknown_setting(name, {key for form in forms for key in form.settings})
        found[name] = form.setting_of(name, word)
    return found


def _asked(to: str | Sequence[str]) -> list[str]:
    """Names of formats, each once."""
    given = [to] if isinstance(to, str) else list(to)
    if not given:
        raise ExportError(f"to: expected a format at least, of: all, {', '.join(FORMATS)}")
    for name in given:
        if name not in ("all", *FORMATS):
            raise UnknownNameError.of("format", name, ["all", *FORMATS])
    return list(FORMATS) if "all" in given else list(dict.fromkeys(given))


def _exported(
    name: str,
    network: Network,
    vector: ReferenceVector,
    settings: Mapping[str, Any],
    folder: Path,
) -> Exported:
    """One format: made, checked, written."""
    form = FORMATS[name]
    own = {key: value for key, value in settings.items() if key in form.settings}
    files = form.files(network, vector, own)
    worth = _worth(name, files)
    if name in ABOUT:
        files = {**files, README: readme(name, form, network, vector, files)}
    written = _written(folder, files, _index(name, network, vector, own, files))
    return replace(written, worth=worth)


def _worth(name: str, files: Files) -> str:
    """What a format's check says of files before they are written."""
    try:
        return FORMATS[name].check(files)
    except ExportPackageMissing as error:
        return f"not checked: {error}"
    except FileFormatError as error:
        raise ExportError(
            f"{name}: the files made do not pass their own check, so that none is written: {error}"
        ) from error


def _reason(error: Exception) -> str:
    """Why a format was not written; what ann_dc does not raise by itself is named by its kind."""
    return str(error) if isinstance(error, AnnDcError) else f"{type(error).__name__}: {error}"


def _index(
    name: str,
    network: Network,
    vector: ReferenceVector,
    settings: Mapping[str, Any],
    files: Files,
) -> Index:
    return Index(
        to=name,
        title=network.title,
        version=ann_dc.__version__,
        wiring=vector.wiring,
        content=vector.content,
        settings=settings,
        files=hashes_of(files),
    )


def _written(folder: Path, files: Files, index: Index) -> Exported:
    """The files of one format in their folder; those of an earlier export are gone."""
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
    written = (*(folder / name for name in files), folder / INDEX)
    return Exported(name=index.to, folder=folder, files=written)


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
    """Refuse a file that a link leads to: it lies elsewhere."""
    for place in below(folder, name):
        if place.is_symlink():
            raise OutputError(
                f"{str(place)!r} is a link, and an export writes into its own folder alone; remove "
                "the link, or give another folder"
            )


def _check_foreign(file: Path, content: bytes) -> None:
    """Refuse to replace a file that no export is known to have written."""
    if file.is_file() and file.read_bytes() != content:
        raise OutputError(
            f"{str(file)!r} is there already, and no export known of wrote it; move "
            "it away, or give another folder"
        )


def _remove_parts(file: Path) -> None:
    """What a process that was killed left of a file."""
    for part in file.parent.glob(f".{glob.escape(file.name)}.*.part"):
        if part.is_file() or part.is_symlink():
            part.unlink()


def _named_before(folder: Path) -> Mapping[str, str]:
    """Files that the index of an earlier export names, as it wrote them."""
    try:
        return read_index(folder).files
    except FileFormatError:
        return {}
