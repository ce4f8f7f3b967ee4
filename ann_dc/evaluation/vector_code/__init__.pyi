from .calls import call as call
from .code import code as code, is_there as is_there, key_of as key_of
from .writer import Function as Function, Module as Module
