"""Refinement of a design's factors."""

from ann_dc.gain_design import design
from ann_dc.problem import plants
from ann_dc.solver import synthesize


def test_refinement_never_makes_it_worse():
    network = synthesize(plants.double_integrator(N=4))
    plain, refined = design(network), design(network, refine=True)
    assert refined.spectrum.ratio <= plain.spectrum.ratio
    assert refined.best.recipe.penalty != plain.best.recipe.penalty
