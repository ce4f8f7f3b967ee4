from .runner import Ngspice as Ngspice
