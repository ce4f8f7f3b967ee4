"""The walls of the house, read off the source and off a fresh interpreter."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import ann_dc

ROOT = Path(ann_dc.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

FRONT_END = {"ann_dc.synthesis.synthesis", "ann_dc.synthesis.wiring"}
"""What turns expressions into a network: the only part of ``network`` that knows SymPy."""

ORDER = (
    ("errors", "resources", "whole_files"),
    ("problem",),
    ("decomposition", "certificate"),
    ("network",),
    ("backends",),
    ("solution", "solver", "cpu"),
    ("study", "export", "navigation"),
    ("plotting", "cli"),
)
"""Imports go from a later room to an earlier one, or stay in it."""

RANK = {room: rank for rank, rooms in enumerate(ORDER) for room in rooms}
HEAVY = ("torch", "matplotlib", "numba", "sympy", "casadi", "onnx")
MONOTONIC = {"monotonic", "perf_counter", "process_time", "sleep"}


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def for_types_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def running(node: ast.AST) -> Iterator[ast.AST]:
    """Every node that runs, in functions too, but not what is there for type checkers."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not for_types_only(child):
            yield from running(child)


def imports(path: Path) -> set[str]:
    """Absolute names of all modules and names that a module imports."""
    found: set[str] = set()
    for node in running(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def within(names: set[str], package: str) -> set[str]:
    return {name for name in names if name == package or name.startswith(f"{package}.")}


def room(name: str) -> str:
    return name.split(".")[1] if "." in name else ""


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has after a statement."""
    script = f"import sys\n{statement}\nprint(*{{m.partition('.')[0] for m in sys.modules}})"
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT.parent
    )
    return set(run.stdout.split())


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_go_one_way(path):
    home = room(name_of(path))
    if not home:  # the package itself names modules as text
        assert not within(imports(path), "ann_dc")
        return
    for name in within(imports(path), "ann_dc"):
        if room(name) in RANK and home in RANK:
            assert RANK[room(name)] <= RANK[home], f"{name_of(path)} imports {name}"


def is_realisation(path: Path) -> bool:
    name = name_of(path)
    return room(name) in ("network", "backends", "study", "export") and name not in FRONT_END


@pytest.mark.parametrize("path", [*filter(is_realisation, MODULES)], ids=name_of)
def test_realisations_see_networks_only(path):
    found = imports(path)
    assert not within(found, "ann_dc.problem")
    assert not within(found, "ann_dc.decomposition")
    assert not within(found, "sympy")


def test_no_module_hides_a_public_name():
    """``import ann_dc.solve`` would put the module where ``ann_dc.solve`` is the function."""
    for name in set(ann_dc.__all__) - {"plotting", "errors"}:
        assert not (ROOT / f"{name}.py").exists()
        assert not (ROOT / name / "__init__.py").exists()


def test_the_package_loads_nothing_heavy():
    assert not loaded_by("import ann_dc") & set(HEAVY)


@pytest.mark.parametrize(
    "module",
    ["ann_dc.backends.ode", "ann_dc.gain_design.procedure", "ann_dc.export.weights.network_file"],
)
def test_networks_run_without_symbols(module):
    assert not loaded_by(f"import {module}") & {"sympy", "torch", "matplotlib", "casadi"}


def test_descriptions_and_files_need_no_compiler():
    assert "numba" not in loaded_by(
        "import ann_dc.export.weights.network_file, ann_dc.network.network"
    )


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_randomness_is_an_argument(path):
    assert "random" not in imports(path)
    for node in running(tree_of(path)):
        text = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
        if text.startswith(("np.random.", "numpy.random.")):
            kind = text.split(".")[2].partition("(")[0]
            assert kind in ("default_rng", "Generator", "SeedSequence"), f"{path}: {text}"
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("default_rng"):
            assert node.args or node.keywords, f"{path}: default_rng() without a seed"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_clock_gets_into_a_file(path):
    """A clock may only measure how long something takes."""
    assert not within(imports(path), "datetime")
    tree = tree_of(path)
    aliases = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name == "time"
    }
    assert within(imports(path), "time") <= {"time"}, f"{path}: write time.monotonic()"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in aliases:
            assert node.attr in MONOTONIC, f"{path}: time.{node.attr}"


def test_spice_stays_in_its_room():
    for path in MODULES:
        if name_of(path).startswith("ann_dc.backends.spice"):
            continue
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not line.strip().lower().startswith((".subckt", ".tran", ".ends")), path


def test_every_module_opens_with_its_idea():
    for path in MODULES:
        assert ast.get_docstring(tree_of(path)), path
