from . import results as results, weights as weights
