from .board_report import BoardReport as BoardReport
from .corner_table import CornerTable as CornerTable
from .interface_table import InterfaceTable as InterfaceTable
from .trim_table import TrimTable as TrimTable
from .yield_table import YieldTable as YieldTable
