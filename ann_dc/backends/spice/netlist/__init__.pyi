from .timing import Simulation as Simulation
