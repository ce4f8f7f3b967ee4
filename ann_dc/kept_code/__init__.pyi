from . import object_cache as object_cache
from .functions import kept as kept
from .object_cache import FOLDER_VARIABLE as FOLDER_VARIABLE
