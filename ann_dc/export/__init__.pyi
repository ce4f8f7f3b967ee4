from . import netlists as netlists, reference as reference, results as results, weights as weights
