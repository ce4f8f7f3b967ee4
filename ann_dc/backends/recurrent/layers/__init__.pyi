import torch as torch

from .layer import RecurrentLayer as RecurrentLayer
