from .entries import Entries as Entries
from .hashes import (
    content_hash as content_hash,
    frame_hash as frame_hash,
    hashes_of as hashes_of,
    wiring_hash as wiring_hash,
)
from .matrix import WeightMatrix as WeightMatrix, to_csv as to_csv, to_matrix as to_matrix
from .network_file import (
    load as load,
    save as save,
    written as written,
)
from .npz import NpzEntries as NpzEntries, packed_entries as packed_entries
from .reading import MAX_MANIFEST as MAX_MANIFEST
from .tensor_file import TensorEntries as TensorEntries, packed_tensors as packed_tensors
