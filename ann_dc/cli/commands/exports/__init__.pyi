from .export import export as export
from .inspect import inspect as inspect
