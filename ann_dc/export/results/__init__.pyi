from .reading import Reader as Reader
from .saved_result import (
    SavedResult as SavedResult,
    opened_result as opened_result,
    save_result as save_result,
)
from .writing import Writer as Writer
