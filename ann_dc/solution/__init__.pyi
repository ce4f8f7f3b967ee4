from .loading import load_solution as load_solution
from .solution import Solution as Solution
