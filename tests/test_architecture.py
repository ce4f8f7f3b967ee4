"""The walls of the house, read off the source and off a fresh interpreter."""

import ast
import graphlib
import importlib
import inspect
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from each_file import of_every_file
from rooms import ORDER

import ann_dc

ROOT = Path(ann_dc.__file__).parent
HOUSE = ROOT.parent
MODULES = sorted(path for path in ROOT.rglob("*.py"))
ROOMS = sorted({path.parent for path in MODULES} - {ROOT})

LONGEST_CHAIN = 30
"""Modules of which each imports the next."""
MOST_NAMES = 20
"""Names on the face of a room; tests import modules."""
RANK = {room: rank for rank, rooms in enumerate(ORDER) for room in rooms.split()}
SYMBOLIC = ("problem", "decomposition", "synthesis")
"""The only rooms that know SymPy."""

HEAVY = ("torch", "matplotlib", "numba", "sympy", "casadi", "onnx", "pandas", "pyarrow", "jinja2",
         "distributed", "plotly", "onnxruntime", "safetensors", "nir", "schemdraw")  # fmt: skip
MONOTONIC = {"monotonic", "perf_counter", "process_time", "sleep"}


def name_of(path: Path) -> str:
    parts = path.relative_to(HOUSE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def folder_of(path: Path) -> str:
    """Return the folder that a module stands in; its own name where that is the package itself."""
    inside = path.relative_to(ROOT)
    return ".".join(inside.parent.parts) or inside.stem


def room_of(path: Path) -> str:
    """Return the room that a module belongs to: the first part of its place."""
    return folder_of(path).partition(".")[0]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


@cache
def imports(path: Path) -> set[str]:
    """Absolute names of all that a file imports: in functions and for type checkers too."""
    found: set[str] = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@cache
def file_of(name: str) -> Path | None:
    """The file of the longest part of a dotted name that is one of ours."""
    while name.partition(".")[0] == "ann_dc":
        path = HOUSE / name.replace(".", "/")
        for file in (path.with_suffix(".py"), path / "__init__.py"):
            if file in MODULES:
                return file
        name = name.rpartition(".")[0]
    return None


def ours(path: Path) -> set[Path]:
    """The files of the package that a file imports."""
    return {file for name in imports(path) if (file := file_of(name)) is not None}


def within(names: set[str], package: str) -> set[str]:
    return {name for name in names if name == package or name.startswith(f"{package}.")}


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has after a statement."""
    script = f"import sys\n{statement}\nprint(*{{m.partition('.')[0] for m in sys.modules}})"
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=HOUSE
    )
    return set(run.stdout.split())


# ---- rooms -------------------------------------------------------------------------------------


def test_every_room_has_its_place():
    found = {room_of(path) for path in MODULES} - {"__init__"}
    assert {room for room in found if room not in RANK} == set()


@of_every_file(MODULES)
def test_imports_go_one_way(path):
    if path == ROOT / "__init__.py":  # names modules as text only
        assert not ours(path)
        return
    for file in ours(path) - {ROOT / "__init__.py"}:
        own, other = room_of(path), room_of(file)
        assert own == other or RANK[other] < RANK[own], f"{name_of(path)}: {name_of(file)}"


def graph_of(place) -> dict[str, set[str]]:
    """Return what every file, folder or room imports, by the name of its place."""
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        if path.name != "__init__.py":
            others = {place(file) for file in ours(path) if file.name != "__init__.py"}
            graph.setdefault(place(path), set()).update(others - {place(path)})
    return graph


@pytest.mark.parametrize("place", [name_of, folder_of], ids=["files", "folders"])
def test_no_circle(place):
    graph = graph_of(place)
    assert len([*graphlib.TopologicalSorter(graph).static_order()]) == len(graph)


def test_chains_of_imports_are_short():
    graph, depth = graph_of(name_of), {}
    for name in graphlib.TopologicalSorter(graph).static_order():
        depth[name] = 1 + max((depth[other] for other in graph[name]), default=0)
    assert max(depth.values()) <= LONGEST_CHAIN


@of_every_file(MODULES)
def test_only_three_rooms_know_symbols(path):
    if room_of(path) in SYMBOLIC:
        return
    assert not within(imports(path), "sympy")


REALISATIONS = ("network", "evaluation", "analysis", "gain_design", "hardware", "backends",
                "fidelity", "export")  # fmt: skip


@of_every_file(MODULES)
def test_realisations_see_networks_only(path):
    if room_of(path) in REALISATIONS:
        for room in SYMBOLIC:
            assert not within(imports(path), f"ann_dc.{room}")


# ---- faces -------------------------------------------------------------------------------------


def stub_of(room: Path) -> ast.Module:
    return tree_of(room / "__init__.pyi")


def handed_on(room: Path) -> dict[str, str | None]:
    """What a room hands on: the module that every public name is from; None if it is one itself."""
    return {
        alias.name: node.module
        for node in stub_of(room).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@pytest.mark.parametrize("room", [ROOT, *ROOMS], ids=lambda path: path.name)
def test_a_room_hands_on_its_names(room):
    face = importlib.import_module(name_of(room / "__init__.py"))
    sentence = (ast.get_docstring(tree_of(room / "__init__.py")) or "").splitlines()[0]
    assert sentence.endswith("."), "a face opens with one sentence"
    names = handed_on(room)
    assert set(face.__all__) - {"__version__"} == set(names)
    for name in names:
        assert getattr(face, name) is not None


@pytest.mark.parametrize("room", ROOMS, ids=lambda path: name_of(path / "__init__.py"))
def test_a_face_hands_on_what_users_need(room):
    assert len(handed_on(room)) <= MOST_NAMES


def is_module(room: Path, name: str, home: str | None) -> bool:
    """Whether what a face hands on is meant to be a module."""
    if home is None:
        return True
    lower = room / home.replace(".", "/")
    return lower.is_dir() and is_module(lower, name, handed_on(lower)[name])


def test_no_module_hides_a_public_name():
    """Importing ``ann_dc.solve`` would put a module where ``ann_dc.solve`` is the function."""
    for path in MODULES:
        if path.stem != "__main__":
            importlib.import_module(name_of(path))
    for room in [ROOT, *ROOMS]:
        face = importlib.import_module(name_of(room / "__init__.py"))
        for name, home in handed_on(room).items():
            assert inspect.ismodule(getattr(face, name)) == is_module(room, name, home), name


DEMOS = sorted((HOUSE / "demos").rglob("*.py"))


@of_every_file(DEMOS)
def test_demos_enter_by_the_door(path):
    alone = {name_of(path) for path in ROOT.glob("*.py")}  # modules of no room
    doors = {name_of(room / "__init__.py") for room in ROOMS} | alone
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "ann_dc":
            assert node.module in doors, f"{path}: {node.module} is no room"


def test_tests_mirror_the_package():
    """Tests of `room/module.py` are in `tests/room/test_module.py` or `test_module_subject.py`."""
    lost = []
    for path in sorted((HOUSE / "tests").rglob("test_*.py")):
        inside = path.relative_to(HOUSE / "tests")
        if inside.parent.parts and (ROOT / inside.parent).is_dir():
            words = inside.stem.removeprefix("test_").split("_")
            names = ("_".join(words[:count]) for count in range(1, len(words) + 1))
            tested = any((ROOT / inside.parent / f"{name}.py").is_file() for name in names)
            lost += [] if tested else [str(inside)]
    assert lost == [], "tests of no module"


# ---- what is loaded ----------------------------------------------------------------------------


def test_the_package_loads_nothing_heavy():
    assert not loaded_by("import ann_dc") & set(HEAVY)


@pytest.mark.parametrize(
    "names",
    ["backends import OdeBackend", "gain_design.procedure import design", "weights import load"],
)
def test_networks_run_without_symbols(names):
    assert not loaded_by(f"from ann_dc.{names}") & {"sympy", "torch", "matplotlib", "casadi"}


def test_the_solver_loads_no_methods_that_few_need():
    """Half a second of imports, for families of inputs, for refinement and SciPy's integrators."""
    script = "import sys, ann_dc.solver; print(*(m for m in sys.modules if 'scipy.' in m))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, cwd=HOUSE, text=True)
    few = {"scipy.stats", "scipy.integrate", "scipy.optimize", "scipy.special", "scipy.fft"}
    assert "scipy.linalg" in run.stdout.split()
    assert not few & set(run.stdout.split())


def test_descriptions_and_files_need_no_compiler():
    script = "from ann_dc.weights import load\nfrom ann_dc.network import Network"
    assert "numba" not in loaded_by(script)


# ---- habits ------------------------------------------------------------------------------------


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    defined = (ast.FunctionDef, ast.AsyncFunctionDef)
    yield from (node for node in nodes_of(path) if isinstance(node, defined))


def length_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without its docstring."""
    first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
    return (node.end_lineno or 0) - first.lineno + 1 + (node.body[0].lineno - node.lineno)


@of_every_file(MODULES)
def test_a_module_is_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 500
    for node in functions(path):
        assert length_of(node) <= 60, f"{node.name}: {length_of(node)} lines"


def test_hardly_a_function_is_long():
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES)
    long = [f.name for path in MODULES for f in functions(path) if length_of(f) > 30]
    assert len(long) <= lines / 1000, long


@of_every_file(MODULES)
def test_a_function_takes_few_arguments(path):
    words = folder_of(path).startswith("cli.commands") or name_of(path) == "ann_dc.problem.plants"
    most = 16 if words else 8  # options, and what --set sets: a word of the user's each
    for node in functions(path):
        given = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        assert len([name for name in given if name != "self"]) <= most, node.name


@of_every_file(MODULES)
def test_randomness_is_an_argument(path):
    assert "random" not in imports(path)
    for node in nodes_of(path):
        text = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
        if text.startswith(("np.random.", "numpy.random.")):
            kind = text.split(".")[2].partition("(")[0]
            assert kind in ("default_rng", "Generator", "SeedSequence"), f"{path}: {text}"
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("default_rng"):
            assert node.args or node.keywords, f"{path}: default_rng() without a seed"


@of_every_file(MODULES)
def test_no_clock_gets_into_a_file(path):
    """A clock may only measure how long something takes."""
    assert not within(imports(path), "datetime")
    aliases = {
        alias.asname or alias.name
        for node in nodes_of(path)
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name == "time"
    }
    assert within(imports(path), "time") <= {"time"}, f"{path}: write time.monotonic()"
    for node in nodes_of(path):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in aliases:
            assert node.attr in MONOTONIC, f"{path}: time.{node.attr}"


def test_spice_stays_in_its_rooms():
    for path in MODULES:
        if folder_of(path).startswith(("backends.spice", "export.netlists")):
            continue
        for node in nodes_of(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for line in node.value.splitlines():
                    assert not line.strip().lower().startswith((".subckt", ".tran", ".ends")), path


def test_every_module_opens_with_its_idea():
    for path in MODULES:
        assert ast.get_docstring(tree_of(path)), path
