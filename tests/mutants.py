"""Files that something happened to, from a seed: bytes, manifests, headers, arrays.

Run as a script with a folder of them, it opens each under a limit of its address space and prints
what became of it, one JSON line a file.
"""

import contextlib
import hashlib
import io
import json
import random
import re
import resource
import shutil
import sys
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ann_dc
from ann_dc.errors import AnnDcError
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.weights.hashes import content_hash, hashes_of

SPARE = 50_000_000
"""Bytes that opening a file may take besides `TIMES` its size."""
TIMES = 10
LONGEST = 5.0
"""Seconds."""


class Mutant(NamedTuple):
    """One file, or a folder with one file that was changed."""

    name: str
    """With the end that says what it is."""
    content: bytes
    other: bool
    """Whether it may be another valid file: its hashes were made anew, or it has none."""


JUNK = [
    True, False, None, 1.0, -1, 0, 2, 64, 10**6, 2**63, 10**30, 1e300, "", "q.x", "one", "\0",
    "\ud800", "../../x", [], {}, [[]], [{}], [1, 2], {"a": 1}, "tau/q.x", "a" * 10_000, "\xb5",
]  # fmt: skip
TEXTS = [
    '{"a":1,"a":2}', "NaN", "-Infinity", "1e999", "[" * 5_000, '{"a":' * 5_000, "9" * 5_000,
    "[" + "[]," * 100_000 + "[]]", '"\\ud800"', "'", "{", "[" * 200 + "]" * 200, "\x00", "",
]  # fmt: skip
SOUND = b"{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }"
HEADERS = [
    SOUND[:-2], SOUND.replace(b"4", b"9" * 11), SOUND.replace(b"4,", b"0, 1" + b"0" * 12),
    SOUND.replace(b"<f8", b"|O"), SOUND.replace(b"'<f8'", b"[('a', '<f8')]"), b"'shape': ((((",
    SOUND[:-6], b"\\", b"'''", b"(" * 60, b"\t\n 1\n  2", b"__import__('os').abort()", b"0x",
    b"1_", b"\xff",
]  # fmt: skip


# ---- bytes ---------------------------------------------------------------------------------------


def of_bytes(rng: random.Random, data: bytes) -> bytes:
    """One or a few changes, anywhere."""
    for _ in range(rng.choice([1, 1, 1, 2, 5])):
        data = _changed(rng, data) or b"\0"
    return data


def _changed(rng: random.Random, data: bytes) -> bytes:
    """Cut off, cut out, said twice, overwritten, lengthened, or with another bit."""
    start = rng.randrange(len(data) + 1)
    end = min(len(data), start + rng.choice([1, 2, 8, 64, 1000]))
    before, part, after = data[:start], data[start:end], data[end:]
    how = rng.randrange(10)
    if how < 4:
        return _one_bit(rng, data)
    if how == 4:
        return before
    more = rng.randbytes(rng.choice([1, 8, 5000]))
    instead = [b"", part + part, rng.randbytes(len(part)), bytes(len(part)), part + more]
    return before + instead[how - 5] + after


def _one_bit(rng: random.Random, data: bytes) -> bytes:
    place = rng.randrange(len(data))
    return data[:place] + bytes([data[place] ^ 1 << rng.randrange(8)]) + data[place + 1 :]


# ---- JSON ----------------------------------------------------------------------------------------


def of_json(rng: random.Random, text: str) -> str:
    """A table with a value, a key or a row changed, or its text."""
    how = rng.randrange(6)
    if how == 0:
        return of_bytes(rng, text.encode()).decode("utf-8", "replace")
    if how == 1:
        places = [m.start() for m in re.finditer(r'[\[{,:"0-9]', text)] or [0]
        place = rng.choice(places)
        return text[:place] + rng.choice(TEXTS) + text[place + rng.randrange(2) :]
    table = json.loads(text)
    holder, key = rng.choice(_places(table))
    if how == 2:
        del holder[key]
    elif how == 3 and isinstance(holder, dict):
        holder[rng.choice([f"{key} ", "colour", "", "stages", "\0"])] = holder[key]
    elif how == 4 and isinstance(holder[key], list):
        holder[key] = (holder[key] * rng.choice([2, 50_000]))[:50_000]
    else:
        holder[key] = rng.choice(JUNK)
    return json.dumps(table)


def _places(thing) -> list:
    keys = thing.keys() if isinstance(thing, dict) else range(len(thing))
    found = [(thing, key) for key in keys]
    for key in keys:
        if isinstance(thing[key], (dict, list)):
            found += _places(thing[key])
    return found


def sealed_anew(text: str, arrays: dict[str, np.ndarray]) -> str:
    """The manifest with the hashes that it should have, where it is one."""
    with contextlib.suppress(ValueError, TypeError, AttributeError, RecursionError):
        table = json.loads(text)
        table["hashes"] = hashes_of(table, arrays)
        return json.dumps(table)
    return text


# ---- .npz ----------------------------------------------------------------------------------------


def of_npz(rng: random.Random, data: bytes) -> tuple[bytes, bool]:
    """Entries changed inside a sound archive, or the archive itself."""
    if rng.random() < 0.4:
        return of_bytes(rng, data), False
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = {info.filename: archive.read(info) for info in archive.infolist()}
    name, sealed = rng.choice(list(entries)), False
    how = rng.randrange(8 if "manifest.npy" in entries else 5)
    if how == 0:
        header = rng.choice(HEADERS)
        entries[name] = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    elif how == 1:
        entries[name] = of_bytes(rng, entries[name][:128]) + entries[name][128:]
    elif how == 2:
        entries[name] = entries[name][:128] + of_bytes(rng, entries[name][128:])
    elif how == 3:
        entries[rng.choice(["evil.npy", name + "x", "../x.npy", " "])] = entries[name]
    elif how == 4:
        del entries[name]
    else:
        arrays = {n[:-4]: _array(d) for n, d in entries.items() if n != "manifest.npy"}
        text = of_json(rng, entries["manifest.npy"][128:].decode())
        sealed = how == 7
        text = sealed_anew(text, arrays) if sealed else text
        stream = io.BytesIO()
        np.lib.format.write_array(stream, np.frombuffer(text.encode("utf-8", "replace"), np.uint8))
        entries["manifest.npy"] = stream.getvalue()
    stream = io.BytesIO()
    packing = rng.choice([zipfile.ZIP_STORED] * 6 + [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
    with zipfile.ZipFile(stream, "w") as archive:
        for entry, content in entries.items():
            archive.writestr(entry, content, packing if entry == name else zipfile.ZIP_STORED)
    return stream.getvalue(), sealed


def _array(entry: bytes) -> np.ndarray:
    return np.lib.format.read_array(io.BytesIO(entry))


# ---- .safetensors --------------------------------------------------------------------------------


def of_safetensors(rng: random.Random, data: bytes) -> tuple[bytes, bool]:
    """The header changed, the manifest in it, the numbers, or any bytes."""
    if rng.random() < 0.4:
        return of_bytes(rng, data), False
    length = int.from_bytes(data[:8], "little")
    header, body, sealed = json.loads(data[8 : 8 + length]), data[8 + length :], False
    how = rng.randrange(6)
    if how == 0:
        text = of_json(rng, json.dumps(header))
    elif how == 1:
        body, text = of_bytes(rng, body), json.dumps(header)
    elif how == 2:
        names = [name for name in header if name != "__metadata__"]
        one, other = rng.sample(names, 2)
        field = rng.choice(["data_offsets", "shape", "dtype"])
        header[one][field] = rng.choice(
            [header[other][field], *JUNK, [0, 2**62], "F32", [2**62, 0]]
        )
        text = json.dumps(header)
    else:
        arrays = {
            name: np.frombuffer(body[slice(*given["data_offsets"])]).reshape(given["shape"])
            for name, given in header.items()
            if name != "__metadata__"
        }
        manifest = of_json(rng, header["__metadata__"]["manifest"])
        sealed = how == 5
        manifest = sealed_anew(manifest, arrays) if sealed else manifest
        header["__metadata__"]["manifest"] = manifest
        text = json.dumps(header)
    plain = text.encode("utf-8", "replace")
    size = rng.choice([len(plain)] * 20 + [0, 2**63, len(plain) + 1, 10**8])
    return size.to_bytes(8, "little") + plain + body, sealed


# ---- the folder of a solution --------------------------------------------------------------------


def folder_as_bytes(folder: Path) -> bytes:
    """A folder as one file: a JSON table of its files in hexadecimal digits."""
    return json.dumps({p.name: p.read_bytes().hex() for p in sorted(folder.iterdir())}).encode()


def folder_from(content: bytes, folder: Path) -> None:
    folder.mkdir()
    for name, digits in json.loads(content).items():
        (folder / name).write_bytes(bytes.fromhex(digits))


def of_folder(rng: random.Random, data: bytes) -> tuple[bytes, bool]:
    """One of its files changed or gone; often with a line of SHA256SUMS that fits."""
    files = {name: bytes.fromhex(digits) for name, digits in json.loads(data).items()}
    name = rng.choice(sorted(files))
    sealed = rng.random() < 0.7 and name != "SHA256SUMS"
    if rng.random() < 0.1:
        del files[name]
    else:
        files[name], _ = CHANGES.get(Path(name).suffix, of_text)(rng, files[name])
        if sealed:
            sums = files["SHA256SUMS"].decode()
            digest = hashlib.sha256(files[name]).hexdigest()
            files["SHA256SUMS"] = re.sub(rf"\w+(?=  {name}\n)", digest, sums).encode()
    return json.dumps({name: content.hex() for name, content in files.items()}).encode(), sealed


def of_text(rng: random.Random, data: bytes) -> tuple[bytes, bool]:
    return of_bytes(rng, data), False


# ---- all of them ---------------------------------------------------------------------------------

CHANGES: dict[str, Callable[[random.Random, bytes], tuple[bytes, bool]]] = {
    ".npz": of_npz,
    ".safetensors": of_safetensors,
    ".folder": of_folder,
    ".json": lambda rng, data: (of_json(rng, data.decode()).encode("utf-8", "replace"), True),
}


def mutants(originals: dict[str, bytes], count: int, seed: int) -> Iterator[Mutant]:
    """So many changed files, from originals by name; the end of a name says how to open them."""
    names = sorted(originals)
    for number in range(count):
        name = names[number % len(names)]
        rng = random.Random(f"{seed} {name} {number}")
        content, other = CHANGES[Path(name).suffix](rng, originals[name])
        yield Mutant(f"{number}_{name}", content, other or "schema_1" in name)


# ---- opening -------------------------------------------------------------------------------------


def written(folder: Path, name: str, content: bytes) -> Path:
    """The place of a file, or of the folder that it stands for."""
    path = folder / name
    folder_from(content, path) if path.suffix == ".folder" else path.write_bytes(content)
    return path


def opened(path: Path) -> str:
    """What a file holds, in a word that differs where it does."""
    if path.suffix == ".json":
        vector = ReferenceVector.from_json(path.read_bytes())
        return vector.content
    if path.suffix == ".folder":
        return content_hash(ann_dc.load_solution(path).network)
    network = ann_dc.load(path)
    return f"{content_hash(network)} {network.title!a}"


def size_of(path: Path) -> int:
    return path.stat().st_size if path.is_file() else sum(map(size_of, path.iterdir()))


def under_a_limit(path: Path) -> dict:
    """What became of one file, where little more memory can be had than it has bytes."""
    virtual = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limit = virtual + SPARE + TIMES * size_of(path)
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    start, found = time.monotonic(), {"file": path.name}
    try:
        found["holds"] = opened(path)
    except AnnDcError as error:
        found["refused"] = f"{type(error).__name__}: {error}"
    except BaseException:
        found["broken"] = traceback.format_exc()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)
    return found | {"seconds": time.monotonic() - start}


def main(folder: Path) -> None:
    for path in sorted(folder.iterdir()):
        print(json.dumps(under_a_limit(path)), flush=True)
        shutil.rmtree(path) if path.is_dir() else path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
