from .populations import kkt_point as kkt_point, neuron_values as neuron_values
from .reference import evaluator as evaluator
