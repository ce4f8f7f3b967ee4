"""The network in discrete time: torch recurrent layers (`layer`) and a backend on them."""

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "the recurrent layers run on torch, which is not installed: pip install 'ann-dc[torch]'"
    ) from error
