"""Trajectories of a study as columns."""

from functools import cache

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError, UnknownNameError

METHODS = ["RK45", "BDF", "compiled"]


@cache
def table(curves=50):
    study = ann_dc.Study(
        subject=ann_dc.plants.double_integrator(N=4),
        vary={"run.method": METHODS, "problem.N": [3, 4]},
        metrics=["settling_time", "steps"],
        curves=curves,
    )
    return study.run(workers=0)


def test_methods_of_scipy_settle_at_the_same_time():
    assert set(table()["outcome"]) == {"settled"}
    for same in table().by("problem.N").values():
        np.testing.assert_allclose(same["settling_time"], same["settling_time"][0], rtol=1e-2)
        assert len(set(same["steps"].tolist())) == len(METHODS)


def test_residuals_are_columns_over_time():
    curves = table().curves()
    assert list(curves.columns)[:3] == ["point", "run.method", "problem.N"]
    np.testing.assert_array_equal(
        curves["residual"], np.maximum(curves["constraint"], curves["stationarity"])
    )
    for point in range(len(table())):
        rows = curves["point"] == point
        assert set(curves["run.method"][rows]) == {table()["run.method"][point]}
        assert (np.diff(curves["time"][rows]) > 0).all()
        assert curves["residual"][rows][-1] < 1e-8


def test_neurons_are_columns_by_stage():
    curves = table().curves("u.a")
    assert [name for name in curves.columns if name.startswith("u.a")] == [
        f"u.a[{k}]" for k in range(4)
    ]
    short = curves["problem.N"] == 3
    assert np.isnan(curves["u.a[3]"][short]).all()
    assert np.isfinite(curves["u.a[3]"][~short]).all()


def test_frames_and_files_have_the_columns(tmp_path):
    pandas, curves = pytest.importorskip("pandas"), table().curves()
    curves.to_parquet(tmp_path / "curves.parquet")
    read = pandas.read_parquet(tmp_path / "curves.parquet")
    pandas.testing.assert_frame_equal(read, curves.to_frame(), check_dtype=False)


def test_what_is_not_stored_is_named():
    with pytest.raises(StudyError, match="curves=200"):
        table(curves=0).curves()
    with pytest.raises(UnknownNameError, match=r"u\.b"):
        table().curves("u.b")


@pytest.mark.parametrize(
    ("fixed", "named"),
    [
        ({"run.backend": "recurrent", "run.method": "RK45"}, r"run\.method .* 'ode' only"),
        ({"run.backend": "recurrent", "run.duration": 2.0}, r"run\.duration .* 'ode' or 'spice'"),
        ({"run.method": "Euler"}, "Euler"),
        ({"run.duration": -1.0}, r"run\.duration"),
    ],
)
def test_settings_that_mean_nothing_are_refused(fixed, named):
    with pytest.raises(StudyError, match=named):
        ann_dc.Study(subject="car", vary={"problem.N": [9]}, fixed=fixed, metrics=["steps"]).run(
            workers=0
        )
