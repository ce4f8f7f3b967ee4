"""Devices are read off the cards that use them."""

import pytest

from ann_dc.backends.spice.pdk import Device, devices_in
from ann_dc.errors import UnknownNameError

CARDS = """
* X9 d g s b sky130_fd_pr__pfet_g5v0d10v5 w=1 l=1
X1 d g s b sky130_fd_pr__nfet_g5v0d10v5 w=20 l=1.9
X2 d g s b sky130_fd_pr__nfet_g5v0d10v5 w=20 l=1.9 m=2 mult=2
X3 c b e s sky130_fd_pr__npn_05v5_W1p00L1p00
X4 a b opamp vos={vos}
"""


def test_each_geometry_is_there_once():
    assert devices_in(CARDS) == [
        Device(name="nfet_g5v0d10v5", width=20.0, length=1.9),
        Device(name="npn_05v5_W1p00L1p00"),
    ]


def test_a_device_that_is_not_known_is_refused():
    with pytest.raises(UnknownNameError, match="device 'nfet_01v8' does not exist; choose one of"):
        devices_in("X1 d g s b sky130_fd_pr__nfet_01v8 w=1 l=1")
