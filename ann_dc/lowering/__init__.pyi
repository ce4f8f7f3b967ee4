from .program import Program as Program
from .writing import program_of as program_of
