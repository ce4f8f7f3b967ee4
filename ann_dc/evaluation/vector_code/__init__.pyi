from . import object_cache as object_cache
from .calls import call as call
from .code import code as code, is_there as is_there, key_of as key_of
from .memory import LINE as LINE, lined_up as lined_up
from .object_cache import FOLDER_VARIABLE as FOLDER_VARIABLE
from .writer import Function as Function, Module as Module
