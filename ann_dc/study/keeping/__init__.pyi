from .curves import packed as packed
from .rows import FAILED as FAILED, Finished as Finished, Point as Point, Row as Row
from .store import Store as Store
