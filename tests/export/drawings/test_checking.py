"""Changed files: found to be the same network's, or refused with our error."""

import numpy as np
import pytest

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings.diagram import diagram_check, diagram_files
from ann_dc.export.drawings.equations import latex_check, latex_files

FORMATS = {"diagram": (diagram_files, diagram_check), "latex": (latex_files, latex_check)}


def mutated(content: bytes, draw: np.random.Generator) -> bytes:
    """Bytes changed, cut out, doubled, or strange ones put in."""
    low, high = sorted(draw.integers(0, len(content), 2))
    high = min(high, low + 300)
    strange = [b"<", b"&x;", b"\xff\xfe", b"<!ENTITY a 'b'>", b"{", b"}", b"$", b"\\", b"\x00"]
    return [
        content[:low] + bytes([draw.integers(256)]) + content[low + 1 :],
        content[:low] + content[high:],
        content[:high] + content[low:high] + content[high:],
        content[:low] + strange[draw.integers(len(strange))] + content[low:],
        content[:low],
    ][draw.integers(5)]


@pytest.mark.parametrize("name", FORMATS)
def test_a_mutated_file_passes_or_is_refused(name, network, vector):
    write, check = FORMATS[name]
    files, draw = write(network, vector), np.random.default_rng(16)
    refused, names = 0, sorted(files)
    for _ in range(150):
        changed = names[draw.integers(len(names))]
        try:
            assert check({**files, changed: mutated(files[changed], draw)})
        except FileFormatError:
            refused += 1
    assert refused > 50
