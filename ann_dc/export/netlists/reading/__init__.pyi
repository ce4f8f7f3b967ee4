from .board import comments_of as comments_of, values_of as values_of, wiring_of as wiring_of
from .flat import (
    Element as Element,
    flattened as flattened,
    logical_lines as logical_lines,
)
from .s_expressions import (
    Tree as Tree,
    entries as entries,
    entry as entry,
    read as read,
    written as written,
)
from .verilog import Instance as Instance, Module as Module, modules_of as modules_of
