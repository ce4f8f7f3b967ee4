from . import reference as reference, results as results, weights as weights
