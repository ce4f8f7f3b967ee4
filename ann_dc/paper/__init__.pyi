from .around import around as around, driven as driven
from .example import demonstrations as demonstrations
from .replans import Case as Case, iterations as iterations, to_the_letter as to_the_letter
