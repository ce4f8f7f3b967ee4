"""Curves as tables and files, read back by pandas, by the csv module and by NumPy."""

import csv
import io
import sys

import numpy as np
import pytest

import ann_dc
from ann_dc import plants
from ann_dc.backends.curves import Curves, write_curves
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import OutputError, PandasMissing
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.scale import Scale

Q, U = Neuron(name="q.x", scale=Scale(2.0, 1.0)), Neuron(name="u.a", scale=Scale(-3.0))
NETWORK = Network(
    cell=Cell(neurons=(Q, U), inputs=("q_0.x",), connections=()),
    stages=3,
    inputs={"q_0.x": 5.0},
    fixed=(FixedNeuron(neuron="q.x", stage=0, input="q_0.x"),),
    omitted=(Omitted(neuron="u.a", stage=2),),
)
COLUMNS = ["q.x[1]", "q.x[2]", "u.a[0]", "u.a[1]"]
TRAJECTORY = Trajectory(
    network=NETWORK,
    time=np.array([0.0, 1.0, 3.0]),
    states=np.arange(12.0).reshape(3, 4) / 7,
    residual_time=np.array([0.0, 0.5, 1.0, 2.0]),
    residuals=np.array([[1.0, 2.0], [0.5, 1.0], [0.1, 0.2], [1e-9, 3e-17]]),
    units={"q.x": "m", "u.a": "m/s"},
)


@pytest.fixture(scope="module")
def solution():
    return ann_dc.solve(plants.double_integrator(N=3), backend=ann_dc.OdeBackend(verify=False))


def test_a_neuron_that_moves_is_a_column_in_the_users_units():
    columns = TRAJECTORY.curves.columns()
    named = ["time", *COLUMNS, "constraint_residual", "stationarity_residual"]
    assert sorted(columns) == sorted(named)
    assert [*columns] == named
    for label in COLUMNS:
        name, stage = label[:-1].split("[")
        np.testing.assert_array_equal(columns[label], TRAJECTORY[name][:, int(stage)])


def test_the_residual_of_a_sample_is_that_of_the_last_step():
    columns = TRAJECTORY.curves.columns()
    np.testing.assert_array_equal(columns["constraint_residual"], [1.0, 0.1, 1e-9])
    np.testing.assert_array_equal(columns["stationarity_residual"], [2.0, 0.2, 3e-17])


def test_a_csv_file_keeps_every_digit_and_tells_the_units(tmp_path):
    TRAJECTORY.to_csv(tmp_path / "curves.csv")
    head, *rows = csv.reader(io.StringIO((tmp_path / "curves.csv").read_text()))
    assert head[:3] == ["time (unit time constants)", "q.x[1] (m)", "q.x[2] (m)"]
    assert head[4:] == ["u.a[1] (m/s)", "constraint_residual", "stationarity_residual"]
    columns = np.array(rows, float).T
    np.testing.assert_array_equal(columns, [*TRAJECTORY.curves.columns().values()])


def test_an_npz_file_has_every_neuron_by_its_name(tmp_path):
    TRAJECTORY.to_npz(tmp_path / "curves.npz")
    with np.load(tmp_path / "curves.npz", allow_pickle=False) as file:
        arrays = dict(file)
    for name in ("q.x", "u.a"):
        np.testing.assert_array_equal(arrays[name], TRAJECTORY[name])
    for name in ("time", "residual_time", "residuals"):
        np.testing.assert_array_equal(arrays[name], getattr(TRAJECTORY, name))
    assert dict(arrays["units"]) == {"q.x": "m", "u.a": "m/s", "time": "unit time constants"}


def test_a_solution_tells_the_problems_units(solution, tmp_path):
    assert solution.trajectory.units["mu.v"] == solution.problem.unit("mu.v") == "cost/(m/s)"
    assert solution.trajectory is solution.trajectory
    assert solution.trajectory.states is solution.run.trajectory.states
    solution.trajectory.to_csv(tmp_path / "curves.csv")
    head = (tmp_path / "curves.csv").read_text().partition("\n")[0]
    assert "u.a[0] (m/s^2)" in head


def test_a_data_frame(solution, tmp_path):
    pandas = pytest.importorskip("pandas")
    frame = solution.trajectory.to_frame()
    assert frame.shape[0] == len(solution.trajectory.time)
    np.testing.assert_array_equal(frame["u.a[1]"], solution.trajectory["u.a"][:, 1])
    assert frame["u.a[0]"].iloc[-1] == pytest.approx(solution["a"][0])
    assert frame.attrs["units"]["u.a[0]"] == "m/s^2"
    assert frame.attrs["units"]["time"] == "unit time constants"
    solution.trajectory.to_csv(tmp_path / "curves.csv")
    read = pandas.read_csv(tmp_path / "curves.csv")
    np.testing.assert_allclose(read.to_numpy(), frame.to_numpy(), rtol=1e-14)
    assert [name.partition(" (")[0] for name in read.columns] == [*frame.columns]


def test_without_pandas_a_sentence_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(PandasMissing, match=r"pip install 'ann-dc\[pandas\]'; to_csv"):
        TRAJECTORY.to_frame()
    with pytest.raises(ImportError):
        TRAJECTORY.to_frame()


@pytest.mark.parametrize("name", ["curves.xlsx", "curves", ".csv", "csv", "a.csv.gz", ""])
def test_a_name_that_does_not_say_how_is_refused(name, tmp_path):
    with pytest.raises(OutputError, match=r"ends in \.csv, \.npz or \.parquet"):
        write_curves(TRAJECTORY, tmp_path / "x" / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["curves.csv", "curves.npz", "CURVES.CSV"])
def test_a_file_that_cannot_be_written_is_told(name, tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_curves(TRAJECTORY, tmp_path / "no" / name)
    write_curves(TRAJECTORY, tmp_path / name)
    assert (tmp_path / name).stat().st_size > 100


def test_curves_without_a_unit_have_plain_names():
    curves = Curves(
        time=np.zeros(1), time_unit="s", neurons={"x": np.ones((1, 1))}, units={},
        live={"x": np.array([True])}, residual_time=np.zeros(1), residuals=np.zeros((1, 2)),
    )  # fmt: skip
    assert curves.curves is curves
    assert curves.column_units() == {"time": "s"}
