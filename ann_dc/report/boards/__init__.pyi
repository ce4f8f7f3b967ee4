from .board_report import BoardReport as BoardReport
from .corner_table import CornerTable as CornerTable
from .yield_table import YieldTable as YieldTable
