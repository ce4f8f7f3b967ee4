from .formulas import (
    IN_OTHER_WORDS as IN_OTHER_WORDS,
    expression_of as expression_of,
    lines_of as lines_of,
)
from .written_problem import (
    WrittenProblem as WrittenProblem,
    WrittenRelation as WrittenRelation,
    declared as declared,
    written as written,
)
