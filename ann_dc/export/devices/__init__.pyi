from .conductances import (
    conductances_check as conductances_check,
    conductances_files as conductances_files,
    weights_of as weights_of,
)
