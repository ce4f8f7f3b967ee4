"""Inspection of exported files and folders: content and integrity."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import AnnDcError, ExportPackageMissing, FileFormatError
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.formats import Files
from ann_dc.export.index import INDEX, Index, check_index, read_files, read_index
from ann_dc.export.readme import without_readme
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.si_prefixes import counted
from ann_dc.validation.checked import checked
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.network_file import load

NETWORKS = (".npz", ".safetensors")
"""File name suffixes of network files."""
VECTOR = "reference_vector.json"
"""Test vector file, present in every folder."""
SHOWN = 16
"""Number of displayed digits of a hash."""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Result of the inspection of one file or folder.

    Attributes
    ----------
    place : Path
        Inspected file or folder.
    kind : str
        Kind of content.
    facts : dict of str to str
        Properties by name.
    wrong : str
        Description of the first error; empty if there is none.
    """

    place: Path
    kind: str
    facts: dict[str, str]
    wrong: str = ""

    @property
    def good(self) -> bool:
        """True if the content is unmodified and behaves as recorded."""
        return not self.wrong


@checked
def inspect_export(
    path: str | os.PathLike[str], *, progress: Progress = silent
) -> list[Inspection]:
    """Inspect a weight file, the folder of an export, or a folder with exports.

    Hashes are checked, and the behaviour of a file is compared with its test vector. A network is
    run until it settles. The content of a file is executed only by the packages of its format.

    Parameters
    ----------
    path : path-like
        File or folder to inspect.
    progress : Progress
        Receiver of progress messages. Silent by default.

    Returns
    -------
    list of Inspection
        One entry per export.

    Raises
    ------
    FileFormatError
        If the path contains neither a weight file nor an export.

    Examples
    --------
    >>> import tempfile, ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ann_dc.save(network, f"{folder}/network.npz")
    ...     [found] = inspect_export(f"{folder}/network.npz")
    >>> found.good, found.facts["neurons"]
    (True, '21 in 3 cells')
    """
    place = Path(path)
    if place.is_file() and place.suffix in NETWORKS:
        progress(f"reading {place}")
        return [_of_network(place)]
    folders = [place] if (place / INDEX).is_file() else []
    folders += sorted(index.parent for index in place.glob(f"*/{INDEX}")) if place.is_dir() else []
    if not folders:
        raise FileFormatError(
            f"{str(place)!r}: no weight file ({', '.join(NETWORKS)}) and no folder that ann-dc "
            "export wrote; give one of these"
        )
    found = []
    for folder in folders:
        progress(f"checking {folder}")
        found.append(_of_folder(folder))
    return found


def short(digest: str) -> str:
    """Return the first digits of a hash, sufficient for comparison by readers."""
    return digest[:SHOWN]


def _of_folder(folder: Path) -> Inspection:
    kind, facts = "export", {}
    try:
        index = read_index(folder)
        kind = index.to
        facts = {
            "network": index.title,
            "wiring": short(index.wiring),
            "content": short(index.content),
            "settings": ", ".join(f"{k}={v}" for k, v in index.settings.items()) or "default",
            "written by": f"ann_dc {index.version}",
        }
        if kind not in FORMATS:
            raise FileFormatError(f"format {kind!r:.40} is none that this ann_dc knows")
        files = read_files(folder, index)
        check_index(folder, index)
        _check_network(index, files)
        facts["files"] = ", ".join(f"{name} ({len(c):,} bytes)" for name, c in files.items())
        facts["checked"] = FORMATS[kind].check(without_readme(kind, files))
    except ExportPackageMissing as error:
        facts["checked"] = f"hashes alone; not run: {error}"
    except AnnDcError as error:
        return Inspection(place=folder, kind=kind, facts=facts, wrong=str(error))
    return Inspection(place=folder, kind=kind, facts=facts)


def _check_network(index: Index, files: Files) -> None:
    """Check that the index and the test vector belong to the same network."""
    if VECTOR not in files:
        raise FileFormatError(f"{VECTOR}: missing; export the network again")
    vector = ReferenceVector.from_json(files[VECTOR])
    if (index.wiring, index.content) != (vector.wiring, vector.content):
        raise FileFormatError(
            f"{INDEX}: is of another network than {VECTOR} beside it; export the network again"
        )


def _of_network(file: Path) -> Inspection:
    try:
        network = load(file)
    except FileFormatError as error:
        return Inspection(place=file, kind="network", facts={}, wrong=str(error))
    run = OdeBackend(verify=False).run(network)
    facts = {**_of_wiring(network), "settles": str(run.status)}
    wrong = "" if run.status.settled else f"it does not settle: {run.status}"
    return Inspection(place=file, kind="network", facts=facts, wrong=wrong)


def _of_wiring(network: Network) -> dict[str, str]:
    cell = network.cell
    return {
        "network": network.title,
        "neurons": f"{network.size} in {counted(network.stages, 'cells')}",
        "cell": f"{counted(len(cell.neurons), 'neurons')}, {counted(len(cell.blocks), 'blocks')}, "
        f"{counted(len(cell.connections), 'connections')}",
        "inputs": ", ".join(cell.inputs) or "none",
        "preconditioner": network.preconditioner.kind.value,
        "wiring": short(wiring_hash(network)),
        "content": short(content_hash(network)),
    }
