"""Compiled code on disk: whatever happens to it, a run goes on and is right, with one warning."""

import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

from ann_dc import jit_cache as object_cache
from ann_dc.jit_cache import FOLDER_VARIABLE

PROGRAM = textwrap.dedent(
    """
    import warnings
    import numpy as np
    from ann_dc import plants, synthesize
    from ann_dc.evaluation import evaluator
    from ann_dc.evaluation.codegen import GeneratedEvaluator

    network = synthesize(plants.double_integrator(N=5))
    x = np.linspace(0.1, 1.0, network.size)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = GeneratedEvaluator(network).rhs(x)
    assert np.allclose(found, evaluator(network).rhs(x), rtol=1e-12, atol=0)
    print(len(told), *(str(warning.message) for warning in told))
    """
)


def run(folder, count: int = 1) -> list[str]:
    """What so many fresh processes say that evaluate a network with this folder, at once."""
    started = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM],
            env=os.environ | {FOLDER_VARIABLE: str(folder)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(count)
    ]
    said = [process.communicate() for process in started]
    assert [process.returncode for process in started] == [0] * count, said
    return [out.strip() for out, _ in said]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with the code of one network."""
    folder = tmp_path_factory.mktemp("code") / "compiled"
    assert run(folder) == ["0"]
    return folder


def copied(written, tmp_path):
    """A copy of it, to be spoiled."""
    folder = tmp_path / "compiled"
    folder.mkdir(mode=0o700)
    for file in written.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
        (folder / file.name).chmod(0o600)
    (file,) = folder.glob("*.code")
    return folder, file


def test_it_is_written_for_the_user_alone(written):
    (file,) = written.glob("*.code")
    assert written.stat().st_mode & 0o077 == 0
    assert file.stat().st_mode & 0o077 == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda content: content[: len(content) // 2], marks=pytest.mark.slow),
        pytest.param(lambda content: b"", marks=pytest.mark.slow),
        pytest.param(lambda content: bytes(len(content)), marks=pytest.mark.slow),
        lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
        pytest.param(lambda content: content + b"more", marks=pytest.mark.slow),
    ],
    ids=["cut", "emptied", "zeroed", "a bit flipped", "longer"],
)
def test_a_damaged_file_is_compiled_anew(written, tmp_path, spoil):
    folder, file = copied(written, tmp_path)
    whole = file.read_bytes()
    file.write_bytes(spoil(whole))
    (said,) = run(folder)
    assert said.startswith("1 ")
    assert "damaged" in said
    assert file.read_bytes() == whole
    assert run(folder) == ["0"]


@pytest.mark.slow
def test_a_file_of_another_name_is_not_taken(written, tmp_path):
    """A checksum holds for one key only: code of another wiring never runs in its place."""
    folder, file = copied(written, tmp_path)
    other = b"\0" * 32
    file.write_bytes(object_cache._checksum("0" * 64, other) + other)
    assert "damaged" in run(folder)[0]


@pytest.mark.slow
def test_what_others_may_write_to_is_not_taken(written, tmp_path):
    folder, file = copied(written, tmp_path)
    file.chmod(0o666)
    assert "others" in run(folder)[0]
    folder.chmod(0o777)
    assert "in memory only" in run(folder)[0]


@pytest.mark.slow
def test_a_link_is_no_folder(written, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(written)
    assert "in memory only" in run(link)[0]


@pytest.mark.slow
def test_a_file_stands_where_the_folder_should(tmp_path):
    (tmp_path / "compiled").write_text("")
    assert "in memory only" in run(tmp_path / "compiled")[0]


def test_nobody_has_a_home(monkeypatch):
    """As in a container whose user has no name: in memory only, in silence."""

    def nobody() -> None:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv(FOLDER_VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(object_cache.Path, "home", nobody)
    assert object_cache.load("ab" * 32) is None
    object_cache.store("ab" * 32, b"code")
    assert object_cache.load("ab" * 32) is None


def test_files_of_others_stay(monkeypatch, tmp_path):
    folder = tmp_path / "compiled"
    folder.mkdir(mode=0o700)
    (folder / "mine.o").write_bytes(b"mine")
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    monkeypatch.setattr(object_cache, "MOST_FILES", 1)
    for key in ("aa" * 32, "bb" * 32):
        object_cache.store(key, b"code")
    assert (folder / "mine.o").read_bytes() == b"mine"
    assert len(list(folder.iterdir())) == 2


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_to(tmp_path):
    folder = tmp_path / "compiled"
    folder.mkdir(mode=0o500)
    assert "not stored" in run(folder)[0]


def test_a_full_disk(monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "compiled"))
    monkeypatch.setattr(object_cache.os, "replace", full)
    object_cache._warn.cache_clear()
    with pytest.warns(UserWarning, match="No space left"):
        object_cache.store("ab" * 32, b"code")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # once is enough
        object_cache.store("ab" * 32, b"code")
    assert object_cache.load("ab" * 32) is None


@pytest.mark.slow
def test_processes_that_compile_at_once(tmp_path):
    folder = tmp_path / "compiled"
    assert run(folder, count=3) == ["0"] * 3
    assert len(list(folder.iterdir())) == 1
    assert run(folder) == ["0"]


def test_the_oldest_files_go(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "compiled"))
    monkeypatch.setattr(object_cache, "MOST_FILES", 3)
    keys = [f"{i:064x}" for i in range(5)]
    for age, key in enumerate(keys):
        object_cache.store(key, key.encode())
        os.utime(tmp_path / "compiled" / f"{key}.code", (1e9 + age, 1e9 + age))
    kept = [object_cache.load(key) is not None for key in keys]
    assert np.count_nonzero(kept) == 3
    assert kept[-1]


def test_another_process_may_remove_files_at_the_same_time(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "compiled"))
    found, key = Path.glob, f"{1:064x}"
    gone = tmp_path / "compiled" / f"{2:064x}.code"
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: [*found(folder, pattern), gone])
    object_cache.store(key, b"code")  # a warning is an error in tests
    assert object_cache.load(key) == b"code"
