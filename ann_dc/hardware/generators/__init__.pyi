from .curves import Polynomial as Polynomial
