"""Devices are read off the cards that use them."""

import pytest

from ann_dc.backends.spice.pdk.devices import Device, devices_in
from ann_dc.errors import FileFormatError, UnknownNameError

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


@pytest.mark.parametrize("sizes", ["w = 20 l = 1.9", "W=20  L= 1.9", "l=1.9 w=2e1 "])
def test_spaces_around_sizes_do_not_hide_a_device(sizes):
    found = devices_in(f"x1 d g s b sky130_fd_pr__nfet_g5v0d10v5 {sizes}")
    assert found == [Device(name="nfet_g5v0d10v5", width=20.0, length=1.9)]


@pytest.mark.parametrize(
    "sizes", ["w=20u l=1", "w={x} l=1", "w=20 l=1.2.3", "w=20 l=", "w=20 1", "w=2 l=1 m=1.5"]
)
def test_sizes_that_cannot_be_read_are_refused_with_their_card(sizes):
    with pytest.raises(FileFormatError, match=r"^'X1 d g .*expected sizes as plain numbers"):
        devices_in(f"X1 d g s b sky130_fd_pr__nfet_g5v0d10v5 {sizes}")


def test_a_device_that_is_not_known_is_refused():
    with pytest.raises(UnknownNameError, match="device 'nfet_01v8' does not exist; choose one of"):
        devices_in("X1 d g s b sky130_fd_pr__nfet_01v8 w=1 l=1")
