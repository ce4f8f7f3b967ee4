"""ann_dc: optimal control on an analog neural network."""

__version__ = "0.1.0"
