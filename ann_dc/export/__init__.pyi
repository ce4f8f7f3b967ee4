from . import drawings as drawings, reference as reference, results as results, weights as weights
