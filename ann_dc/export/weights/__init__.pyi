from .hashes import content_hash as content_hash, wiring_hash as wiring_hash
from .network_file import load as load, save as save
from .npz import Entries as Entries, packed_entries as packed_entries
from .reading import MAX_MANIFEST as MAX_MANIFEST
