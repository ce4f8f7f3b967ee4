"""What public names owe their readers: fields, errors, and an example where one teaches."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest
from each_file import of_every_file

import ann_dc

ROOT = Path(ann_dc.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))


def public(tree: ast.Module) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef]]:
    """Public classes, functions and methods of a module."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
            yield node.name, node
            inside = node.body if isinstance(node, ast.ClassDef) else []
            for method in inside:
                if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                    yield f"{node.name}.{method.name}", method


def fields(node: ast.ClassDef) -> Iterator[str]:
    """Fields of a dataclass and arguments of a constructor; one with words of its own is told."""
    for statement, after in zip(node.body, [*node.body[1:], None]):
        told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if isinstance(statement, ast.AnnAssign):  # an option of the command line has its --help
            told |= any(
                word in ast.unparse(statement.annotation) for word in ("Option", "Argument")
            )
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            if not told and not statement.target.id.startswith("_"):
                yield statement.target.id
        elif isinstance(statement, ast.FunctionDef) and statement.name == "__init__":
            given = (*statement.args.args[1:], *statement.args.kwonlyargs)
            yield from (argument.arg for argument in given)


def raised(node: ast.FunctionDef) -> set[str]:
    """Names of the classes that a function raises itself."""
    found = set()
    for inner in ast.walk(node):
        if isinstance(inner, ast.Raise) and inner.exc is not None:
            call = inner.exc.func if isinstance(inner.exc, ast.Call) else inner.exc
            name = ast.unparse(call).partition(".")[0]
            found |= {name} if name[0].isupper() else set()
    return found


@of_every_file(MODULES)
def test_fields_and_errors_are_told(path):
    owed = []
    for name, node in public(ast.parse(path.read_text(encoding="utf-8"))):
        if "overload" in [ast.unparse(mark) for mark in node.decorator_list]:
            continue  # the implementation tells of all of them
        text = ast.get_docstring(node) or ""
        owed += [] if text else [f"{name}: no docstring"]
        if isinstance(node, ast.ClassDef):
            owed += [f"{name}: {field}" for field in fields(node) if field not in text]
        else:
            owed += [f"{name}: raises {error}" for error in raised(node) if error not in text]
    assert owed == []


def met_first() -> dict[str, object]:
    """What the package's face hands on, and functions that the demos take from its rooms."""
    face = {name: getattr(ann_dc, name) for name in ann_dc.__all__}
    found = {}
    for demo in sorted((ROOT.parent / "demos").glob("*.py")):
        for node in ast.walk(ast.parse(demo.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ann_dc."):
                room = __import__(node.module, fromlist=["*"])
                found |= {alias.name: getattr(room, alias.name) for alias in node.names}
    found |= {name: getattr(ann_dc.nonidealities, name) for name in ann_dc.nonidealities.__all__}
    for module in (ann_dc.levels, ann_dc.presets, ann_dc.ode):
        found |= {n: t for n, t in vars(module).items() if getattr(t, "__module__", "") ==
                  module.__name__ and not n.startswith("_")}  # fmt: skip
    functions = {name: thing for name, thing in found.items() if inspect.isfunction(thing)}
    return functions | {
        n: t for n, t in face.items() if inspect.isclass(t) or inspect.isfunction(t)
    }


MET_FIRST = met_first()


@pytest.mark.parametrize("name", sorted(MET_FIRST))
def test_what_is_met_first_has_an_example(name):
    assert ">>> " in (inspect.getdoc(MET_FIRST[name]) or "")
