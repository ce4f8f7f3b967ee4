"""What a run came to is told from its cost and certificate, input by input."""

import numpy as np

from ann_dc.study.shipped.basin import End, basin, ends
from ann_dc.study.table import Table


def table(**columns) -> Table:
    return Table(columns={name: np.array(values) for name, values in columns.items()}, spec={})


def test_the_best_is_that_of_the_same_inputs():
    found = table(
        **{"input.q_d.x": [1.0, 1.0, 2.0, 2.0]},
        objective=[5.0, 9.0, 9.0, 9.0 + 1e-6],
        certified=[1, 1, 1, 1],
        outcome=["settled"] * 4,
    )
    assert ends(found) == [End.BEST, End.OTHER, End.BEST, End.BEST]


def test_a_lower_cost_that_is_no_optimum_is_not_the_best():
    found = table(
        objective=[1.0, 2.0, np.nan, 0.5],
        certified=[0, 1, 0, 0],
        outcome=["settled", "settled", "diverged", "stalled"],
    )
    assert ends(found) == [End.NO_OPTIMUM, End.BEST, End.NOWHERE, End.NOWHERE]


def test_a_convex_problem_has_one_basin():
    study = basin("double_integrator", inputs={"q_d.x": [0.5, 1.0]}, spreads=[0.1, 10.0], samples=3)
    assert set(ends(study.run(workers=0))) == {End.BEST}
    assert len(study) == 12
