"""Inputs over time: samples, holds, files."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import ann_dc
from ann_dc.errors import FileFormatError, NetworkError, UnknownNameError
from ann_dc.network import Waveform
from ann_dc.weights.hashes import content_hash, frame_hash, wiring_hash

TIMES = st.lists(st.floats(0.01, 5.0), min_size=1, max_size=8).map(np.cumsum)


@given(TIMES, st.data())
def test_linear_samples_are_interpolated(times, data):
    number = st.floats(-10, 10)
    values = np.array(data.draw(st.lists(number, min_size=len(times), max_size=len(times))))
    time = data.draw(st.floats(-1, 50))
    waveform = Waveform(times=times, values=values)
    assert waveform.at(time) == pytest.approx(np.interp(time, times, values), abs=1e-9)


def test_held_samples_change_at_their_times():
    held = Waveform(times=[0.0, 1.0, 2.0], values=[5.0, 6.0, 7.0], hold="previous")
    assert [float(held.at(t)) for t in (-1, 0, 0.99, 1.0, 1.5, 2.0, 9.0)] == [5, 5, 5, 6, 6, 7, 7]


def test_stages_may_have_their_own_values():
    waveform = Waveform(times=[0.0, 2.0], values=[[0.0, 1.0], [2.0, 5.0]])
    np.testing.assert_allclose(waveform.at(1.0), [1.0, 3.0])


def test_a_column_of_a_file_is_a_waveform(tmp_path):
    file = tmp_path / "target.csv"
    file.write_text("time,x,y\n0,1,2\n10,3,four\n")
    waveform = Waveform.from_csv(file, "x")
    assert (waveform.times.tolist(), waveform.values.tolist()) == ([0, 10], [1, 3])
    with pytest.raises(NetworkError, match="column y"):
        Waveform.from_csv(file, "y")
    with pytest.raises(UnknownNameError, match="z"):
        Waveform.from_csv(file, "z")
    with pytest.raises(FileFormatError, match=r"none\.csv"):
        Waveform.from_csv(tmp_path / "none.csv", "x")


@pytest.mark.parametrize(
    ("times", "values", "named"),
    [
        ([], [], "increasing times"),
        ([0.0, 0.0], [1.0, 2.0], "increasing times"),
        ([0.0, 1.0], [1.0], "one per time"),
        ([0.0, np.nan], [1.0, 2.0], "increasing|finite"),
        ([0.0, 1.0], [1.0, np.inf], "finite"),
    ],
)
def test_what_is_no_waveform_is_refused(times, values, named):
    with pytest.raises(NetworkError, match=named):
        Waveform(times=np.array(times), values=np.array(values))


def test_a_network_has_the_inputs_of_a_time():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    moving = network.with_inputs({"q_d.x": Waveform(times=[0.0, 10.0], values=[1.0, 2.0])})
    assert moving.inputs["q_d.x"].tolist() == [1.0, 1.0, 1.0]
    still = moving.at_time(5.0)
    assert still.inputs["q_d.x"].tolist() == [1.5, 1.5, 1.5]
    assert not still.waveforms
    assert not moving.with_inputs({"q_d.x": 3.0}).waveforms
    with pytest.raises(UnknownNameError, match=r"q_d\.z"):
        network.with_inputs({"q_d.z": Waveform(times=[0.0], values=[1.0])})


def test_files_keep_waveforms(tmp_path):
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    waves = {
        "q_d.x": Waveform(times=[0.0, 10.0], values=[1.0, 2.0]),
        "q_0.x": Waveform(times=[0.0, 5.0, 6.0], values=[0.0, 0.1, 0.3], hold="previous"),
    }
    moving = network.with_inputs(waves)
    ann_dc.save(moving, tmp_path / "moving.npz")
    found = ann_dc.load(tmp_path / "moving.npz").waveforms
    for name, wave in waves.items():
        assert found[name].hold == wave.hold
        np.testing.assert_array_equal(found[name].times, wave.times)
        np.testing.assert_array_equal(found[name].values, wave.values)
    assert content_hash(moving) != content_hash(network)
    assert content_hash(moving) != content_hash(moving.with_inputs({"q_0.x": waves["q_d.x"]}))
    assert wiring_hash(moving) == wiring_hash(network)
    assert frame_hash(moving) == frame_hash(network)


def test_inputs_are_those_of_time_zero_whatever_is_replaced():
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    wave = Waveform(times=[0.0, 10.0], values=[1.0, 2.0])
    moving = network.with_inputs({"q_d.x": wave})
    assert replace(moving, inputs={**moving.inputs, "q_d.x": 7.0}).inputs["q_d.x"][0] == 1.0
    with pytest.raises(UnknownNameError, match="wind"):
        replace(network, waveforms={"wind": wave})
    with pytest.raises(NetworkError, match=r"waveforms\[q_d.x\]"):
        replace(network, waveforms={"q_d.x": Waveform(times=[0.0], values=[[1.0, 2.0]])})


def test_a_waveform_that_leaves_the_range_of_the_design_is_warned_of():
    problem = ann_dc.plants.double_integrator(N=3)
    network = replace(ann_dc.design(problem).network, ranges={"q_d.x": (0.5, 2.0)})
    with pytest.warns(ann_dc.errors.RangeWarning, match=r"q_d\.x = 9"):
        network.with_inputs({"q_d.x": Waveform(times=[0.0, 10.0], values=[1.0, 9.0])})


def test_files_that_are_no_csv_are_told(tmp_path):
    (tmp_path / "bytes.csv").write_bytes(b"time,x\n0,\xff\n")
    with pytest.raises(FileFormatError, match=r"bytes\.csv"):
        Waveform.from_csv(tmp_path / "bytes.csv", "x")
    (tmp_path / "excel.csv").write_bytes("\ufefftime,x\n0,1\n".encode())
    assert Waveform.from_csv(tmp_path / "excel.csv", "x").values.tolist() == [1.0]
