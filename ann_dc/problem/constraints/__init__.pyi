from .boundary import boundary_slopes as boundary_slopes
from .bounds import (
    Bounds as Bounds,
    bounds_of as bounds_of,
    limits_of as limits_of,
    rows_of as rows_of,
)
from .domain import (
    culprit as culprit,
    defined as defined,
    into_domain as into_domain,
    within_domain as within_domain,
)
from .inequality import (
    SIGNS as SIGNS,
    Inequality as Inequality,
    Relations as Relations,
    relations_of as relations_of,
)
from .relation_text import parse_relations as parse_relations
from .soft import Soft as Soft, soft_of as soft_of
