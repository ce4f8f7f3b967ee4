"""The SPICE library is found, and BLAS uses one thread where the package computes."""

import importlib.util
import os
import shutil
import signal
import sys
import threading
import tomllib
from pathlib import Path

import pytest
import scipy.linalg  # noqa: F401  (loads the second BLAS)
from threadpoolctl import ThreadpoolController

import ann_dc
from ann_dc import plants, resources
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.resources import one_thread

ROOT = Path(ann_dc.__file__).parents[1]


def installed_at(site: Path):
    """The locator as it is in an installation under ``site``."""
    home = site / "ann_dc"
    home.mkdir(parents=True)
    shutil.copy(resources.__file__, home)
    spec = importlib.util.spec_from_file_location("located", home / "resources.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_in_a_checkout():
    assert (ann_dc.circuits_path() / "README.md").is_file()


def test_in_a_wheel(tmp_path):
    mapped = tomllib.loads((ROOT / "pyproject.toml").read_text())
    target = mapped["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]["circuits"]
    located = installed_at(tmp_path)
    (tmp_path / target).mkdir()
    assert located.circuits_path() == tmp_path / target


def test_an_incomplete_installation_says_so(tmp_path):
    with pytest.raises(FileNotFoundError, match="install ann_dc again"):
        installed_at(tmp_path).circuits_path()


@pytest.fixture
def threads():
    """Numbers of threads of all BLAS libraries, of which the caller asks for two."""
    libraries = ThreadpoolController().select(user_api="blas")
    with libraries.limit(limits=2):
        if not libraries.lib_controllers:
            pytest.skip("threadpoolctl controls no BLAS here")
        yield lambda: {library.num_threads for library in libraries.lib_controllers}


WAYS = {
    "solve": lambda problem, network: ann_dc.solve(problem),
    "design": lambda problem, network: ann_dc.design(problem),
    "family": lambda problem, network: ann_dc.design(problem, ranges=[{"q_d.x": 1.0}]),
    "run": lambda problem, network: ann_dc.OdeBackend().run(network),
    "batch": lambda problem, network: ann_dc.OdeBackend().run_batch(network, {"q_d.x": [1.0]}),
    "study": lambda problem, network: ann_dc.Study(subject=network).run(workers=0),
    "spectrum": lambda problem, network: ann_dc.analysis.spectrum(network, network.start_state),
}
"""Ways into the package."""


@pytest.fixture(scope="module")
def designed():
    problem = plants.double_integrator(N=3)
    return problem, ann_dc.design(problem).network


@pytest.mark.sampled(4)
@pytest.mark.parametrize("way", WAYS)
def test_blas_uses_one_thread_within_the_package_and_the_callers_number_afterwards(
    way, designed, threads, monkeypatch
):
    """Looked at where the evaluator of a network is chosen, which all ways come by."""
    seen = []

    def looked(*given):
        seen.append(threads())
        return fast_evaluator(*given)

    for module in [module for name, module in sys.modules.items() if name.startswith("ann_dc")]:
        if vars(module).get("fast_evaluator") is fast_evaluator:
            monkeypatch.setattr(module, "fast_evaluator", looked)
    WAYS[way](*designed)
    assert seen
    assert set().union(*seen) == {1}
    assert threads() == {2}


def test_blas_limit_of_two_threads_that_overlap_ends_with_the_last(threads):
    begun, first_done = threading.Event(), threading.Event()
    seen = []

    def second():
        with one_thread():
            begun.set()
            first_done.wait(10)
            seen.append(threads())

    other = threading.Thread(target=second)
    with one_thread():
        other.start()
        begun.wait(10)
    first_done.set()
    other.join()
    assert seen == [{1}]
    assert threads() == {2}


def test_blas_limit_of_the_caller_is_restored_after_an_error(threads):
    with pytest.raises(ann_dc.errors.AnnDcError):
        ann_dc.solve("no problem")
    with pytest.raises(ZeroDivisionError), one_thread():
        raise ZeroDivisionError
    assert threads() == {2}


def in_child(work) -> bool:
    """True if a forked process does some work, without an error, within 10 s."""
    child = os.fork()
    if not child:
        signal.alarm(10)
        try:
            work()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitpid(child, 0)[1] == 0


forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
quiet = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")


def beside_a_thread(hold, work) -> bool:
    """Fork while another thread is in a context; see `in_child`."""
    begun, done = threading.Event(), threading.Event()

    def other():
        with hold:
            begun.set()
            done.wait(20)

    thread = threading.Thread(target=other)
    thread.start()
    begun.wait(10)
    try:
        return in_child(work)
    finally:
        done.set()
        thread.join()


@forks
@quiet
def test_fork_while_another_thread_holds_the_lock_of_the_limit_does_not_block():
    def use():
        with one_thread():
            pass

    assert beside_a_thread(one_thread()._lock, use)


@forks
@quiet
def test_fork_within_another_threads_limit_gives_back_the_callers_number(threads):
    def use():
        with one_thread():
            assert threads() == {1}
        assert threads() == {2}

    assert beside_a_thread(one_thread(), use)


@forks
@quiet
def test_fork_within_the_own_limit_ends_it_in_both_processes(threads):
    def leave():
        one_thread().__exit__()
        assert threads() == {2}
        with one_thread():
            assert threads() == {1}
        assert threads() == {2}

    with one_thread():
        assert in_child(leave)
        assert threads() == {1}
    assert threads() == {2}


def test_blas_limit_that_cannot_be_set_does_not_stay(threads, monkeypatch):
    def refuse(library, number):
        raise OSError("no threads")

    with monkeypatch.context() as failing:
        failing.setattr(resources, "_set", refuse)
        with pytest.raises(OSError, match="no threads"):
            one_thread().__enter__()
    with one_thread():
        assert threads() == {1}
    assert threads() == {2}
