from .code import code as code
