"""Raw files: written and read alike, and refused when they are damaged."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from raw_files import binary, header, ramp, text

from ann_dc.backends.spice.ngspice.raw import Raw, read_raw
from ann_dc.errors import (
    EndedEarlyError,
    FileFormatError,
    RawFileError,
    SpiceError,
    UnknownNameError,
)

NAMES = st.lists(st.text("abxyz019_.#[]()@:", min_size=1, max_size=9), min_size=1, max_size=5)


@st.composite
def tables(draw):
    names = draw(NAMES)
    shape = (draw(st.integers(1, 6)), len(names))
    return names, draw(arrays(draw(st.sampled_from([float, complex])), shape))


@given(st.lists(tables(), min_size=1, max_size=3), st.sampled_from([binary, text]))
@settings(max_examples=60, deadline=None)
def test_write_and_read_is_the_identity(plots, write):
    raws = read_raw(b"".join(write(names, values) for names, values in plots))
    assert len(raws) == len(plots)
    for raw, (names, values) in zip(raws, plots):
        assert raw.names == tuple(names)
        assert raw.values.dtype == values.dtype
        np.testing.assert_array_equal(raw.values, values)


@given(tables(), st.sampled_from([binary, text]), st.data())
@settings(max_examples=60, deadline=None)
def test_a_file_that_is_cut_off_is_refused(table, write, data):
    content = write(*table)
    end = len(content.rstrip()) if write is text else len(content)
    words = content[: data.draw(st.integers(0, end - 1))]
    if write is text and len(words.split()) == len(content.split()):
        return  # the last number lost digits, which no reader can see
    with pytest.raises(SpiceError):
        read_raw(words)


@given(st.binary(max_size=60), st.data())
@settings(max_examples=200, deadline=None)
def test_damage_is_refused_or_read(noise, data):
    content = data.draw(st.sampled_from([binary, text]))(["time", "v(x)"], np.ones((2, 2)))
    begin = data.draw(st.integers(0, len(content)))
    damaged = content[:begin] + noise + content[begin + data.draw(st.integers(0, 60)) :]
    try:
        raws = read_raw(damaged)
    except SpiceError as error:
        assert len(str(error)) < 500  # noqa: PT017
    else:
        assert raws


@pytest.mark.parametrize(
    ("content", "meaning"),
    [
        (b"", "it is empty"),
        (b" \n\n", "it is empty"),
        (b"\x00" * 100, "a plot begins with .* instead of 'Title:'"),
        (ramp() + b"rest", "a plot begins with b'rest'"),
        (b"Title: x\nPlotname: y\n", "neither 'Binary:' nor 'Values:'"),
        (b"Title: " + b"x" * 10**6, "neither 'Binary:' nor 'Values:'"),
        (header(["time"], 0), r"plot 'Transient Analysis' has no points"),
        (header(["time"], 0) + ramp(), r"has no points"),
        (header(["time"], 10**15), r"cut off or damaged: 1000000000000000 points of 1"),
        (header(["time"], 10**15, kind="Values:"), "1000000000000000 points"),
        (header(["time"], 10**30), r"'No. Points' is '1000000000000000000000000000000'; exp"),
        (ramp().replace(b"Points: 5", b"Points: -5"), "'No. Points' is '-5'"),
        (ramp().replace(b"Points: 5", "Points: ٣".encode()), "'No. Points' is"),
        (ramp().replace(b"No. Points", b"No Points"), "'No. Points' is ''"),
        (ramp().replace(b"Variables: 2", b"Variables: 999999999999"), "variables, got 2 names"),
        (header([], 1), "expected 0 variables"),
        (ramp().replace(b"real", b"imaginary"), "'Flags' is 'imaginary'; expected 'real' or"),
        (ramp().replace(b"\tv(x)\tvoltage", b""), r"declared as '\\t1', without a name"),
        (ramp().replace(b"\tvoltage", b"\tvoltage dims=3"), "'time' is shorter than its plot"),
        (
            text(["x"], np.ones((2, 1))).replace(b"1.0", b"one"),
            "contains an entry that is not a number: could not",
        ),
        (text(["x"], np.ones((2, 1))) + b"5", "2 points of 1 variables are 4 words, and 5 follow"),
    ],
)
def test_files_that_are_refused(content, meaning):
    with pytest.raises(RawFileError, match=f"^the raw data: .*{meaning}"):
        read_raw(content)
    assert issubclass(RawFileError, FileFormatError)


def test_an_analysis_that_was_given_up():
    content = ramp(end=2.0).replace(b"Points: 5", b"Points: 0")
    for cut in (0, 3):
        with pytest.raises(EndedEarlyError, match=rf"aborted at time {'1.5' if cut else '2'}$"):
            read_raw(content[: len(content) - cut])
    content = text(["time"], np.ones((9, 1))).replace(b"Points: 9", b"Points: 0")
    with pytest.raises(EndedEarlyError, match=r"'Transient Analysis' was aborted$"):
        read_raw(content)


def test_files_and_bytes(tmp_path):
    (tmp_path / "x.raw").write_bytes(ramp())
    for source in (tmp_path / "x.raw", str(tmp_path / "x.raw"), ramp()):
        (raw,) = read_raw(source)
        assert raw.time[-1] == 1.0
    (tmp_path / "x.raw").write_bytes(ramp()[:-1])
    with pytest.raises(RawFileError, match=r"raw file '.*x\.raw': plot"):
        read_raw(tmp_path / "x.raw")
    with pytest.raises(RawFileError, match="does not exist"):
        read_raw(tmp_path / "none.raw")


def test_flags_and_lines_of_other_writers():
    values = np.array([[0.0, 1.0]])
    content = binary(["time", "v(x)"], values, flags="real unpadded")
    content = content.replace(b"Variables:\n", b"Command: ngspice-46, Build today\nVariables:\n", 1)
    content = content.replace(b"\ttime\tvoltage", b"\ttime\ttime\tgrid=3")
    np.testing.assert_array_equal(read_raw(content)[0].values, values)
    content = text(["time", "v(x)"], values).replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(read_raw(content)[0].values, values)


def test_names():
    names, values = ("Time", "v(X)", "x", "V(y)", "v(y)"), np.arange(5.0)[None]
    raw = Raw(title="", plot="", names=names, values=values)
    assert raw.names == ("time", "v(x)", "x", "v(y)", "v(y)")
    found = [raw[name][0] for name in ("TIME", "V(X)", "X", "Y", "v(y)")]
    assert found == [0.0, 1.0, 2.0, 3.0, 3.0]
    with pytest.raises(UnknownNameError, match=r"variable 'z' does not exist.*: time, v\(x\), x"):
        raw["z"]
    with pytest.raises(ValueError, match="read-only"):
        raw.values[0, 0] = 1.0
    values[0, 0] = 7.0  # the caller's own stays writable
