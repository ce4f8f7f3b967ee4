from .family_design import FamilyDesign as FamilyDesign, design_family as design_family
from .front import pareto as pareto
from .many_starts import Multistart as Multistart, multistart as multistart
from .seeded_starts import seeded_starts as seeded_starts
