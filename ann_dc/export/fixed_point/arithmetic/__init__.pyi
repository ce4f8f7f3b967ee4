from .formats import quantised as quantised
from .machine import Integers as Integers, Machine as Machine
from .program import Program as Program
from .tables import Table as Table, made_table as made_table
from .walk import Ranges as Ranges, walked as walked
from .writing import program_of as program_of
