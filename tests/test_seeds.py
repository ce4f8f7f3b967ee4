"""Property tests: the same examples in every process, others in `make fuzz`."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import seeds
from hypothesis import given, settings, strategies as st


def collector(examples: int):
    """A property test, and the numbers that it was given."""
    numbers: list[int] = []

    @settings(max_examples=examples)
    @given(st.integers(0, 10**6))
    def collect(number):
        numbers.append(number)

    return collect, numbers


def drawn() -> list[int]:
    collect, numbers = collector(300)
    collect()
    return numbers


@pytest.mark.skipif(bool(seeds.SEED), reason="make fuzz draws other examples")
def test_examples_are_the_same_whatever_modules_are_loaded(tmp_path, monkeypatch):
    before = drawn()
    place = tmp_path / "local_constants.py"
    place.write_text("NUMBERS = 314159, 271828, 141421, 173205, 223606\n")
    spec = importlib.util.spec_from_file_location("local_constants", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "local_constants", module)
    assert drawn() == before


def test_fuzz_multiplies_examples_and_draws_others(monkeypatch):
    found = []
    for seed, times in ((0, 1), (5, 3), (5, 3), (6, 3)):
        collect, numbers = collector(40)
        monkeypatch.setattr(seeds, "SEED", seed)
        monkeypatch.setattr(seeds, "TIMES", times)
        marks: list = []
        seeds.mark_properties([SimpleNamespace(obj=collect, add_marker=marks.append)])
        collect()
        assert [mark.name for mark in marks] == ["property"]
        assert len(numbers) == 40 * times
        found.append(numbers)
    assert found[1] == found[2] != found[3]


def test_seeds_of_fuzz_begin_at_the_printed_one(monkeypatch):
    def chosen() -> list[tuple]:
        return [parameters.values for parameters in seeds.seeds(2, first=4).args[1]]

    monkeypatch.setattr(seeds, "SEED", 0)
    assert chosen() == [(4,), (5,)]
    monkeypatch.setattr(seeds, "SEED", 900)
    monkeypatch.setattr(seeds, "TIMES", 2)
    assert chosen() == [(900,), (901,), (902,), (903,)]


def test_hypothesis_without_a_private_name_is_told(monkeypatch):
    monkeypatch.delattr(seeds.providers, "_get_local_constants")
    with pytest.raises(AssertionError, match=r"has no _get_local_constants .* adapt tests/seeds"):
        seeds.load_profile()


SEEDED = ("default_rng", "Random")
TORCH = ("torch.rand", "torch.randn", "torch.randint", "torch.randperm")


def test_tests_draw_from_seeds():
    """Generators have a seed, and torch's functions a generator; modules' own have neither."""
    ambient = []
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                given = [*node.args, *node.keywords]
                bare = name.rpartition(".")[2] in SEEDED and not given
                torch = name in TORCH and "generator" not in [k.arg for k in node.keywords]
                if bare or torch or name.startswith(("random.r", "random.s", "np.random.r")):
                    ambient.append(f"{path.name}:{node.lineno} {name}")
    assert ambient == []
