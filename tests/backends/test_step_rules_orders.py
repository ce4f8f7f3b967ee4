"""Update orders as data: three, each with a name."""

import pickle

import pytest

from ann_dc.backends.step_rules import ORDERS, TWO_PHASE, Order
from ann_dc.errors import UnknownNameError


def test_orders_have_names():
    assert {name: repr(order) for name, order in ORDERS.items()} == {
        "simultaneous": "simultaneous",
        "two-phase": "two-phase",
        "stage-by-stage": "stage by stage",
    }


def test_there_is_no_other_order():
    with pytest.raises(UnknownNameError, match="order 'odd' does not exist; choose one of: simul"):
        Order("odd")


def test_an_order_is_the_same_in_another_process():
    assert pickle.loads(pickle.dumps(TWO_PHASE)) == TWO_PHASE
