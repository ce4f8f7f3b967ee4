from .calls import call as call
from .code import code as code, key_of as key_of
from .memory import LINE as LINE, lined_up as lined_up
from .writer import Function as Function, Module as Module
