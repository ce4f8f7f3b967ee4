import torch as torch

from .in_layers import OUTCOMES as OUTCOMES
from .layer import RecurrentLayer as RecurrentLayer
from .ledger import DIVERGED as DIVERGED, SETTLED as SETTLED, Settled as Settled
from .memory import Memory as Memory
from .moves import move_of as move_of
from .proposal import Proposal as Proposal
from .steps import StepState as StepState, dual_limit as dual_limit, lengths_of as lengths_of
