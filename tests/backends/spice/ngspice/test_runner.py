"""ngspice as a function: closed forms come out, and whatever goes wrong is told and cleaned up."""

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ann_dc.backends.spice.ngspice import outcome as verdict
from ann_dc.backends.spice.ngspice import process as processes
from ann_dc.backends.spice.ngspice import runner
from ann_dc.backends.spice.ngspice.process import find_ngspice, version
from ann_dc.backends.spice.ngspice.raw import Raw, read_raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    AnnDcError,
    EndedEarlyError,
    FileFormatError,
    NgspiceMissing,
    NotFiniteError,
    OutputError,
    RawFileError,
    SpiceCrashError,
    SpiceError,
    SpiceInputError,
    SpiceTimeoutError,
    UnknownNameError,
)

R, C = 1e3, 1e-9
TAU = R * C

DISCHARGE = """RC from 1 V
R1 Out 0 1k
C1 Out 0 1n ic=1
.options reltol=1e-6
.tran 10n 5u uic
.end
"""
LOWPASS = """RC low-pass
V1 in 0 dc 2 ac 1 pulse(0 1 0 1n 1n 1 2)
R1 in out 1k
C1 out 0 1n
"""
DIVIDER = "divider\nV1 in 0 {}\nR1 in x 1k\nR2 x 0 1k\n.op\n.end\n"
ENDLESS = "no end\nV1 in 0 sin(0 1 1k)\nR1 in x 1k\nC1 x 0 1n\n.tran 1n 1000\n.end\n"
BLOW_UP = "v' = v^2\nC1 x 0 1\n.ic v(x)=1\nB1 0 x I=v(x)*v(x)\n.tran 1m 10 uic\n.end\n"

on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


@pytest.fixture
def ngspice():
    """A runner of the ngspice that is installed; CI must have one."""
    try:
        find_ngspice()
    except NgspiceMissing as error:
        if "CI" in os.environ:
            pytest.fail(f"CI without ngspice: {error}")
        pytest.skip(str(error))
    return Ngspice(timeout=60.0)


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Puts a shell script in ngspice's place; the raw files it may copy lie beside it."""
    home = tmp_path / "stand-in"
    home.mkdir()

    def install(script: str, **raws: bytes) -> Ngspice:
        for name, content in raws.items():
            (home / f"{name}.raw").write_bytes(content)
        program = home / "ngspice"
        program.write_text(f"#!/bin/sh\nhere={home}\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv(processes.VARIABLE, str(program))
        return Ngspice(timeout=20.0, keep=tmp_path / "kept", workers=2)

    return install


def header(names, points, flags="real", kind="Binary:", plot="Transient Analysis"):
    lines = ["Title: test", "Date: today", f"Plotname: {plot}", f"Flags: {flags}"]
    lines += [f"No. Variables: {len(names)}", f"No. Points: {points:<8}", "Variables:"]
    lines += [f"\t{i}\t{name}\tvoltage" for i, name in enumerate(names)]
    return "\n".join([*lines, kind, ""]).encode()


def binary(names, values, flags=None, **words):
    flags = flags or ("complex" if np.iscomplexobj(values) else "real")
    return header(names, len(values), flags, **words) + values.tobytes()


def text(names, values):
    flags = "complex" if np.iscomplexobj(values) else "real"
    number = (lambda v: f"{v.real!r},{v.imag!r}") if flags == "complex" else repr
    rows = ["\n\t".join([f"{i}", *map(number, row)]) for i, row in enumerate(values.tolist())]
    return header(names, len(values), flags, kind="Values:") + "\n".join([*rows, ""]).encode()


def ramp(end=1.0, points=5):
    time = np.linspace(0.0, end, points)
    return binary(["time", "v(x)"], np.stack([time, time**2], axis=1))


def working_in(folder: Path) -> list[str]:
    """Processes whose folder is this one or below it."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            place = os.readlink(process / "cwd").removesuffix(" (deleted)")
        except OSError:
            continue
        if Path(place).is_relative_to(folder):
            found.append(process.name)
    return found


def wait_for(condition):
    for _ in range(500):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("waited in vain")


# -- Closed forms ----------------------------------------------------------------------------------


def test_a_capacitor_discharges(ngspice):
    raw = ngspice.run(DISCHARGE, end_time=5e-6)
    np.testing.assert_allclose(raw["out"], np.exp(-raw.time / TAU), atol=1e-3)
    np.testing.assert_allclose(raw.time[-1], 5e-6, rtol=1e-9)
    assert raw.plot == "Transient Analysis"
    assert raw.title.lower() == "rc from 1 v"  # ngspice 39 gives it in lower case
    assert raw.names == ("time", "v(out)")


def test_an_operating_point(ngspice):
    raw = ngspice.run(DIVIDER.format(2.0))
    assert raw.values.shape == (1, 3)
    np.testing.assert_allclose([raw["x"][0], raw["i(v1)"][0]], [1.0, -1e-3], rtol=1e-6)


def test_several_plots(ngspice):
    deck = LOWPASS + ".op\n.ac dec 3 1k 1meg\n.tran 1u 10u\n.end\n"
    plots = {raw.plot: raw for raw in ngspice.plots(deck, end_time=1e-5)}
    assert {*plots} == {"Operating Point", "AC Analysis", "Transient Analysis"}
    response = plots["AC Analysis"]
    assert response["out"].dtype == complex
    np.testing.assert_allclose(
        response["out"], 1.0 / (1.0 + 2j * np.pi * response.frequency * TAU), rtol=1e-6
    )
    np.testing.assert_allclose(response.frequency, np.geomspace(1e3, 1e6, 10), rtol=1e-9)
    assert (response["frequency"].imag == 0.0).all()  # ngspice leaves noise there
    with pytest.raises(SpiceInputError, match=r"3 analyses \(AC Analysis, Op.*call `plots`"):
        ngspice.run(deck)


def test_included_files(ngspice):
    deck = "two files\n.include half.lib\nV1 in 0 1\nX1 in x half\n.op\n.end\n"
    half = ".subckt half a b\nR1 a b 1k\nR2 b 0 1k\n.ends\n"
    np.testing.assert_allclose(ngspice.run(deck, files={"half.lib": half})["x"], 0.5)


def test_the_users_settings_do_not_matter(ngspice, tmp_path, monkeypatch):
    (tmp_path / ".spiceinit").write_text("quit 7\n")
    (tmp_path / "spinit").write_text("quit 8\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SPICE_SCRIPTS", str(tmp_path))
    monkeypatch.setenv("SPICE_ASCIIRAWFILE", "1")
    np.testing.assert_allclose(ngspice.run(DIVIDER.format(1.0))["x"], 0.5)


def test_runs_are_equal_to_the_bit(ngspice):
    deck = LOWPASS + ".ac dec 3 1k 1meg\n.end\n"
    np.testing.assert_array_equal(ngspice.run(deck).values, ngspice.run(deck).values)


def test_nothing_is_left_of_a_run(ngspice, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ngspice.run(DIVIDER.format(1.0))
    assert not [*tmp_path.iterdir()]


# -- Which ngspice ---------------------------------------------------------------------------------


def test_version(ngspice, stand_in):
    assert re.fullmatch(r"\d+[\w.+-]*", version())
    stand_in("echo '** ngspice-46+ : a later one'")
    assert version() == "46+"
    for strange in ("echo 'SPICE 3f5'", "exit 2"):
        stand_in(strange)
        assert version() == "unknown"


def test_no_ngspice(monkeypatch, tmp_path):
    monkeypatch.delenv(processes.VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    for call in (find_ngspice, version, lambda: Ngspice().run(""), lambda: Ngspice().run_many([])):
        with pytest.raises(NgspiceMissing, match=r"`apt-get install ngspice`.*`brew install.*page"):
            call()
    (tmp_path / "plain").write_text("")
    for name in ("nowhere", "plain"):
        monkeypatch.setenv(processes.VARIABLE, str(tmp_path / name))
        with pytest.raises(NgspiceMissing, match=rf"ANN_DC_NGSPICE is .*{name}.*or unset it"):
            find_ngspice()
    assert issubclass(NgspiceMissing, RuntimeError)


def test_a_program_that_cannot_be_started(stand_in, tmp_path):
    ngspice = stand_in("")
    (tmp_path / "stand-in/ngspice").write_bytes(b"\x7fELF and then nothing")
    with pytest.raises(SpiceCrashError, match=r"cannot be started \(.+\); set ANN"):
        ngspice.run("")


# -- Runs that fail --------------------------------------------------------------------------------


def test_a_syntax_error(ngspice, tmp_path):
    deck = "wrong\nX1 a b nosuch\n.op\n.end\n"
    with pytest.raises(SpiceCrashError, match="exit code 1; what it printed") as caught:
        runner.Ngspice(keep=tmp_path / "made" / "kept").run(deck, files={"a.lib": "*"})
    message = str(caught.value)
    assert re.search(r"\n  \| .*unknown subckt: x1 a b nosuch", message)
    kept = Path(re.search(r"kept as '(.*)'; ngspice printed last:\n", message)[1])
    assert kept.read_text() == deck
    assert kept.is_relative_to(tmp_path / "made" / "kept")
    assert {file.name for file in kept.parent.iterdir()} == {"deck.cir", "ngspice.log", "a.lib"}


def test_a_failed_run_is_kept_among_temporary_files(ngspice, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(RawFileError, match=r"no raw file; check that the deck has an analysis"):
        ngspice.run("no analysis\nR1 a 0 1\nV1 a 0 1\n.end\n")
    assert [file.name for file in tmp_path.glob("*/*.cir")] == ["deck.cir"]


def test_an_abandoned_transient_tells_its_time(ngspice, tmp_path):
    """v' = v^2 from 1 is 1 / (1 - t), so nothing is there from t = 1 on."""
    with pytest.raises(EndedEarlyError, match=r"often the circuit is unstable.*\n.*kept as") as it:
        Ngspice(keep=tmp_path).run(BLOW_UP)
    stopped = float(re.search(r"given up at time ([\d.]+);", str(it.value))[1])
    np.testing.assert_allclose(stopped, 1.0, atol=1e-2)
    assert not [*tmp_path.glob("*/out.raw")]


def test_ends_early(stand_in):
    ngspice = stand_in("cp $here/half.raw out.raw", half=ramp(0.5))
    assert ngspice.run("", end_time=0.5 * (1 + 0.9e-6)).time[-1] == 0.5
    with pytest.raises(EndedEarlyError, match=r"ended at 0\.5 s, and 1 s is expected; often"):
        ngspice.run("", end_time=1.0)
    ngspice = stand_in("cp $here/op.raw out.raw", op=binary(["v(x)"], np.ones((1, 1))))
    with pytest.raises(EndedEarlyError, match=r"no transient, and one until 1 s .* add a \.tran"):
        ngspice.run("", end_time=1.0)


def test_values_that_are_no_numbers(stand_in):
    values = np.array([[0.0, 1.0], [0.5, -np.inf], [1.0, np.nan]])
    raw = binary(["time", "V(Y)"], values)
    ngspice = stand_in("cp $here/raw.raw out.raw", raw=raw)
    with pytest.raises(NotFiniteError, match=r"v\(y\) is -inf at point 1 of .*\(time 0\.5\)"):
        ngspice.run("", end_time=1.0)


@pytest.mark.parametrize(
    ("script", "kind", "meaning"),
    [
        ("kill -9 $$", SpiceCrashError, r"killed by signal 9 \(SIGKILL\); if the memory"),
        ("kill -SEGV $$", SpiceCrashError, r"signal 11 \(SIGSEGV\)"),
        ("cp $here/whole.raw out.raw; exit 3", SpiceCrashError, "exit code 3"),
        (": > out.raw", RawFileError, "the raw data: it is empty"),
        ("cp $here/cut.raw out.raw", RawFileError, r"cut off or damaged: 5 points of 2 variables"),
        ("cp $here/cut.raw out.raw; exit 3", SpiceCrashError, "exit code 3"),
        ("mkdir out.raw", RawFileError, "'.*out.raw' is a folder"),
        ("mkfifo out.raw", RawFileError, "not a plain file"),
        ("exit 0", RawFileError, "ngspice wrote no raw file"),
    ],
)
def test_what_a_simulator_may_do(stand_in, script, kind, meaning):
    ngspice = stand_in(f"echo last words\n{script}", whole=ramp(), cut=ramp()[:-1])
    with pytest.raises(kind, match=meaning) as caught:
        ngspice.run("title")
    assert str(caught.value).endswith("ngspice printed last:\n  | last words")
    assert type(caught.value) is kind


def test_a_run_that_removes_its_folder(stand_in):
    with pytest.raises(RawFileError, match="no raw file"):
        stand_in('rm -r "$PWD"').run("")


def test_a_long_log_is_told_by_its_end(stand_in):
    ngspice = stand_in("yes 'a long line' | head -c 3000000; seq 40; echo; exit 1")
    with pytest.raises(SpiceCrashError) as caught:
        ngspice.run("")
    assert str(caught.value).split("last:\n")[1].split() == [
        word for i in range(26, 41) for word in ("|", str(i))
    ]


def test_what_is_no_text_is_shown_nevertheless(stand_in):
    ngspice = stand_in(r"printf 'caf\351 1%%\r caf\351 2%%\n'; exit 1")
    with pytest.raises(SpiceCrashError, match=r"last:\n  \|  caf\ufffd 2%$"):
        ngspice.run("")


@on_linux
def test_a_timeout_ends_the_process(ngspice, tmp_path):
    begin = time.monotonic()
    with pytest.raises(SpiceTimeoutError, match=r"ended after 0\.5 s; often.*longer `timeout`"):
        Ngspice(timeout=0.5, keep=tmp_path).run(ENDLESS)
    assert time.monotonic() - begin < 5.0
    assert not working_in(tmp_path)
    assert not [*tmp_path.glob("*/out.raw")]
    assert issubclass(SpiceTimeoutError, TimeoutError)


@on_linux
def test_a_timeout_ends_the_children(stand_in, tmp_path):
    ngspice = stand_in("sleep 600 & sleep 600")
    with pytest.raises(SpiceTimeoutError):
        Ngspice(timeout=0.5, keep=ngspice.keep).run("")
    wait_for(lambda: not working_in(tmp_path))


@on_linux
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("many", [False, True])
def test_an_interrupt_ends_the_processes(stand_in, tmp_path, many):
    ngspice = stand_in("sleep 600 & sleep 600")

    def interrupt():
        wait_for(lambda: len(working_in(ngspice.keep)) >= (6 if many else 3))
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        ngspice.run_many(["deck"] * 5) if many else ngspice.run("deck")
    thread.join()
    wait_for(lambda: not working_in(tmp_path))
    assert not [*ngspice.keep.iterdir()]


@on_linux
def test_ngspice_killed_in_the_middle_of_a_run(ngspice, tmp_path):
    """By somebody else, say for want of memory, with half of its answer written."""
    answers = lambda: [*tmp_path.glob("*/out.raw")]  # noqa: E731

    def kill():
        wait_for(lambda: working_in(tmp_path) and answers() and answers()[0].stat().st_size > 1e5)
        for process in working_in(tmp_path):
            os.kill(int(process), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    with pytest.raises(SpiceCrashError, match=r"killed by signal 9 \(SIGKILL\)"):
        Ngspice(keep=tmp_path, timeout=20.0).run(ENDLESS)
    thread.join()
    assert not answers()
    (deck,) = tmp_path.glob("*/deck.cir")
    assert deck.read_text() == ENDLESS


@on_linux
@pytest.mark.skipif(not shutil.which("setpriv"), reason="needs util-linux")
def test_ngspice_ends_with_a_python_that_is_killed(ngspice, tmp_path):
    """A process that gets no chance to clean up: its circuit must not run on for hours."""
    script = (
        "from pathlib import Path; from ann_dc.backends.spice.ngspice.runner import Ngspice; "
        "print(flush=True); "
        f"Ngspice(keep=Path({str(tmp_path)!r}), timeout=60).run({ENDLESS!r})"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as python:
        assert python.stdout is not None
        assert python.stdout.readline() == b"\n"  # imported
        wait_for(lambda: [*tmp_path.glob("*/out.raw")])
        assert working_in(tmp_path)
        python.kill()
    wait_for(lambda: not working_in(tmp_path))


@on_linux
def test_a_run_that_fills_the_disk_is_ended(ngspice, tmp_path, monkeypatch):
    for module in (processes, verdict):
        monkeypatch.setattr(module, "MAX_BYTES", 200_000)
    with pytest.raises(SpiceCrashError, match=r"wrote more than 200000 bytes; save fewer nodes"):
        Ngspice(keep=tmp_path, timeout=20.0).run(ENDLESS)
    assert not working_in(tmp_path)


# -- What is given ---------------------------------------------------------------------------------


HOSTILE = ["", ".", "..", "../up", "/etc/passwd", "a/b", "a\\b", ".spiceinit", "a b", "a\0b", "a\n"]
OTHER = ["-r", "Deck.CIR", "out.raw", "ngspice.log", "é.lib", "x" * 200]


@pytest.mark.parametrize("name", [*HOSTILE, *OTHER])
def test_hostile_file_names(stand_in, tmp_path, name):
    ngspice = stand_in("touch $here/started")
    with pytest.raises(SpiceInputError, match="cannot lie beside a deck; give a plain name"):
        ngspice.run("deck", files={name: "text"})
    assert not (tmp_path / "stand-in" / "started").exists()
    assert not (tmp_path / "kept").exists()


def test_what_is_no_deck(stand_in):
    ngspice = stand_in("")
    with pytest.raises(SpiceInputError, match=r"no text: .*surrogates"):
        ngspice.run("\ud800")
    with pytest.raises(SpiceInputError, match="got one text; call `run`"):
        ngspice.run_many("deck")


@pytest.mark.parametrize("wrong", [{"timeout": 0.0}, {"timeout": np.nan}, {"workers": 0}])
def test_settings_are_checked(wrong):
    (name,) = wrong
    with pytest.raises(SpiceInputError, match=f"{name}: expected"):
        Ngspice(**wrong)
    assert issubclass(SpiceInputError, ValueError)


# -- Disks -----------------------------------------------------------------------------------------


def test_a_folder_that_cannot_be_written_to(stand_in, tmp_path, monkeypatch):
    stand_in("cp $here/raw.raw out.raw", raw=ramp())
    taken = tmp_path / "taken"
    taken.write_text("")
    with pytest.raises(OutputError, match=r"taken'.*a file stands where a folder is needed"):
        Ngspice(keep=taken).run("")
    monkeypatch.setattr("tempfile.tempdir", str(taken))
    with pytest.raises(OutputError, match=r"'the folder of temporary files' \(Not a dir.*TMPDIR"):
        Ngspice().run("")


def test_a_disk_that_fills_up_costs_no_earlier_result(stand_in, monkeypatch):
    write = Path.write_bytes

    def full(path, content):
        if content == b"late":
            raise OSError(28, "No space left on device")
        return write(path, content)

    ngspice = stand_in("cp $here/raw.raw out.raw", raw=ramp())
    monkeypatch.setattr(Path, "write_bytes", full)
    first, second, third, last = ngspice.run_many(["a", "b", "late", "c"])
    assert {type(result) for result in (first, second, last)} == {Raw}
    assert isinstance(third, OutputError)
    assert re.search(r"a deck cannot be written .*\(No space left on device\); free", str(third))
    assert not [*ngspice.keep.iterdir()]


@on_linux
def test_folders_that_nobody_can_write_to(stand_in):
    """Not even root, whom permissions do not stop."""
    ngspice = stand_in("cp $here/raw.raw out.raw", raw=ramp())
    for folder in ("/proc/here", "/dev/null", "/dev/null/below", "a\0b"):
        with pytest.raises(OutputError, match=r"cannot be written.*; (give|free)"):
            Ngspice(keep=Path(folder), timeout=20.0).run("")
    assert ngspice.run("").time[-1] == 1.0


def test_a_disk_without_room_is_told_from_a_bad_answer(stand_in, monkeypatch):
    """Where nothing may be mounted: ngspice wrote half a file, and there is no room for more."""
    ngspice = stand_in("cp $here/cut.raw out.raw", cut=ramp()[:-1])
    usage = shutil.disk_usage(ngspice.keep.parent)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=4096))
    with pytest.raises(OutputError, match=r"\(the disk is full\); free space"):
        ngspice.run("")
    assert not [*ngspice.keep.iterdir()]
    monkeypatch.undo()


@on_linux
def test_what_is_kept_of_earlier_runs_stays(stand_in, tmp_path):
    """Whatever goes wrong next: evidence of other failures, and the user's own files."""
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "notes.txt").write_text("mine")
    scripts = ["exit 1", "kill -9 $$", ": > out.raw", "cp $here/cut.raw out.raw", 'rm -r "$PWD"']
    for count, script in enumerate(scripts):
        ngspice = stand_in(script, cut=ramp()[:-1])
        before = {file: file.read_bytes() for file in kept.rglob("*") if file.is_file()}
        with pytest.raises(SpiceError):
            ngspice.run(f"deck {count}")
        assert all(file.read_bytes() == content for file, content in before.items())
    decks = [file.read_text() for file in kept.rglob("deck.cir")]
    assert sorted(decks) == [f"deck {i}" for i in range(4)]  # the last one removed its own
    assert (kept / "notes.txt").read_text() == "mine"


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "none", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("file systems may not be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_ngspice_on_a_full_disk(ngspice, small_disk):
    """ngspice itself ends with exit code 0 then."""
    small = Ngspice(keep=small_disk, timeout=20.0)
    ends, fills = small.run_many([DIVIDER.format(1.0), ENDLESS])
    np.testing.assert_allclose(ends["x"], 0.5)
    assert isinstance(fills, OutputError)
    assert re.search(r"could not write .*\(the disk is full\); free space", str(fills))
    assert not [*small_disk.iterdir()]


# -- Many decks ------------------------------------------------------------------------------------


def test_many_decks_in_order(ngspice, tmp_path):
    meaning = []
    decks = [DIVIDER.format(v) for v in range(2, 22)]
    decks[3] = "wrong\nX1 a b nosuch\n.op\n.end\n"
    results = Ngspice(keep=tmp_path, workers=3, progress=meaning.append).run_many(iter(decks))
    failed = results.pop(3)
    assert isinstance(failed, SpiceCrashError)
    np.testing.assert_allclose(
        [raw["x"][0] for raw in results], [1, 1.5, 2, *np.arange(3, 11, 0.5)]
    )
    assert meaning[2] == "3 of 20 decks"
    assert len(meaning) == 20


def test_slow_decks_first(stand_in):
    ngspice = stand_in("sleep 0.$(cat deck.cir); cp $here/$(cat deck.cir).raw out.raw", **{
        str(i): ramp(float(i)) for i in range(1, 6)
    })  # fmt: skip
    ends = [raw.time[-1] for raw in ngspice.run_many(["5", "4", "3", "2", "1"])]
    assert ends == [5.0, 4.0, 3.0, 2.0, 1.0]


@on_linux
def test_a_stream_takes_decks_as_needed(stand_in):
    ngspice = stand_in(
        "if grep -q slow deck.cir; then sleep 600; fi; cp $here/raw.raw out.raw", raw=ramp()
    )
    taken, meaning = [], []

    def decks():
        for i in itertools.count():
            taken.append(i)
            yield "slow" if i == 1 else "quick"

    stream = Ngspice(keep=ngspice.keep, workers=2, progress=meaning.append).stream(decks())
    assert not taken
    assert next(stream).time[-1] == 1.0
    wait_for(lambda: working_in(ngspice.keep))
    assert len(taken) == 2 * runner.AHEAD + 1
    stream.close()
    assert not working_in(ngspice.keep)
    assert not [*ngspice.keep.iterdir()]
    assert meaning == ["1 decks"]


# -- Raw files -------------------------------------------------------------------------------------

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
        (ramp().replace(b"Variables: 2", b"Variables: 999999999999"), "announced and 2 are named"),
        (header([], 1), "0 variables are announced"),
        (ramp().replace(b"real", b"imaginary"), "'Flags' is 'imaginary'; expected 'real' or"),
        (ramp().replace(b"\tv(x)\tvoltage", b""), r"declared as '\\t1', without a name"),
        (ramp().replace(b"\tvoltage", b"\tvoltage dims=3"), "'time' is shorter than its plot"),
        (text(["x"], np.ones((2, 1))).replace(b"1.0", b"one"), "has no number: could not"),
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
        with pytest.raises(EndedEarlyError, match=rf"given up at time {'1.5' if cut else '2'}$"):
            read_raw(content[: len(content) - cut])
    content = text(["time"], np.ones((9, 1))).replace(b"Points: 9", b"Points: 0")
    with pytest.raises(EndedEarlyError, match=r"'Transient Analysis' was given up$"):
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
    with pytest.raises(RawFileError, match=r"expected shape \(points, 5\).*got \(3,\)"):
        Raw(title="", plot="", names=names, values=np.ones(3))


def test_every_error_is_the_librarys():
    for kind in (SpiceError, NgspiceMissing, OutputError):
        assert issubclass(kind, AnnDcError)
