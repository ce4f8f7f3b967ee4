from .network_file import load as load
from .network_file import save as save
from .reading import MAX_MANIFEST as MAX_MANIFEST
