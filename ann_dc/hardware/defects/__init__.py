r"""What analog parts do to a network, before any part is chosen: network in, network out.

Each function spoils one thing, and every backend runs what comes out. Of a neuron they make

.. math:: \tau\,\dot x = r\tau\; \mathrm{clip}\Big(\tfrac{1}{r\tau}\Big(
    \textstyle\sum_j (1 + \epsilon_j) w_j s_j + o - \frac{x}{A_0} \sum_j |w_j|\Big)\Big),
    \qquad |x| \le limit ,

with another pole behind every s_j. All numbers are the network's own: its units, its time, one full
scale for all nodes. `ann_dc.hardware.emulation.emulation` is the exact version, for a circuit whose
resistors and op amps are chosen. Roles, duals, chains and coordinators stay (what coordinators add
is ideal), so a residual says how far a network is from rest; its certificate says what they cost.

No defect (strength zero, or infinite gain) gives back the network itself. They compose; what one
has added is to the next a node like any other. So begin with what changes numbers (`quantised`,
`mismatch`, `detuned`, `gain_error`, `offset`, `leak`), and end with what adds parts (`extra_pole`,
`slew`, `rails`, `noise`). Design a network before: a design would choose the time constants of
poles too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
