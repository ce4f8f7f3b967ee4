"""The network in discrete time: recurrent layers in torch (`layer`), and a backend on them.

One step of a cell is in `cell`; here are the orders in which its neurons move, the lengths of
steps, acceleration, and the loop that steps until every sample has settled.
"""

try:
    import torch as torch
except ImportError as error:
    raise ImportError(
        "the recurrent layers run on torch, which is not installed: pip install 'ann-dc[torch]'"
    ) from error
