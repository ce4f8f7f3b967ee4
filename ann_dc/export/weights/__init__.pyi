from .network_file import load as load, save as save
from .reading import MAX_MANIFEST as MAX_MANIFEST
