r"""Non-idealities of analog parts as transformations from network to network.

Parts need not be chosen. Each function adds one non-ideality, and every backend runs the result. A
neuron becomes

.. math:: \tau\,\dot x = r\tau\; \mathrm{clip}\Big(\tfrac{1}{r\tau}\Big(
    \textstyle\sum_j (1 + \epsilon_j) w_j s_j + o - \frac{x}{A_0} \sum_j |w_j|\Big)\Big),
    \qquad |x| \le limit ,

with an additional pole behind every s_j. All numbers are in network units and network time, with
one full scale for all nodes. `ann_dc.hardware.emulation.emulation` is the exact version for a
circuit with chosen resistors and op amps. Roles, duals, chains and coarse-level neurons are
preserved; the contribution of the coarse-level neurons stays ideal. The residual therefore measures
the distance of the network from equilibrium, and the optimality certificate gives the cost of the
non-idealities.

Zero strength or infinite gain returns the network unchanged. Functions compose: a node added by one
function is an ordinary node for the next. Apply the functions that change numbers first
(`quantised`, `mismatch`, `detuned`, `gain_error`, `offset`, `leak`), then those that add parts
(`extra_pole`, `slew`, `saturation`, `noise`). Design the network before, because a design would
also choose the time constants of added poles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
