from .family import Family as Family, family_of as family_of
from .family_design import FamilyDesign as FamilyDesign, design_family as design_family
from .front import Front as Front, pareto as pareto
from .many_starts import Multistart as Multistart, multistart as multistart
from .optima import Optimum as Optimum
from .race import Runner as Runner
from .seeded_starts import checked_starts as checked_starts, seeded_starts as seeded_starts
from .validation import Failure as Failure, Validation as Validation, why as why
