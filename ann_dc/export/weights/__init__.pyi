from .entries import Entries as Entries
from .hashes import content_hash as content_hash, wiring_hash as wiring_hash
from .network_file import load as load, save as save
from .npz import NpzEntries as NpzEntries, packed_entries as packed_entries
from .reading import MAX_MANIFEST as MAX_MANIFEST
from .tensor_file import TensorEntries as TensorEntries, packed_tensors as packed_tensors
