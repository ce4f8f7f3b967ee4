from .columns import plain_row as plain_row
from .curves import packed as packed, unpacked as unpacked
from .identity import differences as differences
from .rows import (
    CIRCUMSTANCES as CIRCUMSTANCES,
    FAILED as FAILED,
    HEAD as HEAD,
    LOST as LOST,
    TAIL as TAIL,
    TIMED_OUT as TIMED_OUT,
    Finished as Finished,
    Point as Point,
    Row as Row,
    Value as Value,
    without_result as without_result,
)
from .store import Store as Store
