from . import object_cache as object_cache
