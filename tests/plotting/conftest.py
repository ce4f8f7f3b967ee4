"""A run that settled, and one that diverged."""

import pytest

import ann_dc


@pytest.fixture(scope="session")
def car():
    return ann_dc.solve(ann_dc.plants.car(), backend=ann_dc.OdeBackend(verify=False))


@pytest.fixture(scope="session")
def diverged():
    return ann_dc.solve(
        ann_dc.plants.car(), form=ann_dc.switch("S1"), backend=ann_dc.OdeBackend(verify=False)
    )
