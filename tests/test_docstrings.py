"""Docstrings: plain technical English; complete sections on the public face only.

Ruff checks punctuation, sections and the imperative mood (D401).
"""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from each_file import of_every_file

import ann_dc

ROOT = Path(ann_dc.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

NEVER = re.compile(
    r"(What|How|Where|Whether|Who|Whose|Which|When|Why|Of|That|Those|As|From|Is|Are|Does)\b|\("
)
"""First words that name no subject: a docstring begins with a verb or a noun."""
VERBS = frozenset(
    [
        "Accept",
        "Add",
        "Adjust",
        "Allocate",
        "Append",
        "Apply",
        "Arrange",
        "Assemble",
        "Assign",
        "Average",
        "Block",
        "Branch",
        "Build",
        "Call",
        "Cast",
        "Change",
        "Check",
        "Choose",
        "Classify",
        "Clip",
        "Close",
        "Collect",
        "Combine",
        "Compare",
        "Compile",
        "Compute",
        "Concatenate",
        "Connect",
        "Construct",
        "Continue",
        "Convert",
        "Copy",
        "Correct",
        "Count",
        "Create",
        "Cut",
        "Declare",
        "Decode",
        "Decompose",
        "Decrease",
        "Delay",
        "Delete",
        "Derive",
        "Describe",
        "Design",
        "Determine",
        "Diagnose",
        "Divide",
        "Do",
        "Draw",
        "Drive",
        "Drop",
        "Eliminate",
        "Emulate",
        "Encode",
        "Enclose",
        "End",
        "Ensure",
        "Enter",
        "Escape",
        "Estimate",
        "Evaluate",
        "Exchange",
        "Execute",
        "Exit",
        "Expand",
        "Export",
        "Extend",
        "Fill",
        "Find",
        "Fit",
        "Flush",
        "Fold",
        "Form",
        "Format",
        "Fuse",
        "Generate",
        "Get",
        "Group",
        "Halve",
        "Ignore",
        "Initialise",
        "Insert",
        "Inspect",
        "Install",
        "Integrate",
        "Interleave",
        "Interpolate",
        "Invert",
        "Iterate",
        "Join",
        "Keep",
        "Limit",
        "Linearise",
        "List",
        "Load",
        "Locate",
        "Lock",
        "Loop",
        "Make",
        "Map",
        "Mark",
        "Match",
        "Measure",
        "Merge",
        "Minimise",
        "Mix",
        "Move",
        "Multiply",
        "Name",
        "Normalise",
        "Omit",
        "Open",
        "Pack",
        "Parse",
        "Perform",
        "Place",
        "Plan",
        "Plot",
        "Predict",
        "Prepare",
        "Print",
        "Project",
        "Propagate",
        "Put",
        "Raise",
        "Read",
        "Rebuild",
        "Receive",
        "Record",
        "Recreate",
        "Reduce",
        "Register",
        "Reject",
        "Release",
        "Remove",
        "Rename",
        "Render",
        "Repeat",
        "Replace",
        "Report",
        "Request",
        "Reset",
        "Reshape",
        "Resolve",
        "Restart",
        "Restore",
        "Restrict",
        "Return",
        "Rotate",
        "Round",
        "Run",
        "Sample",
        "Save",
        "Scale",
        "Search",
        "Select",
        "Send",
        "Serialise",
        "Set",
        "Settle",
        "Shade",
        "Shift",
        "Show",
        "Simulate",
        "Skip",
        "Solve",
        "Sort",
        "Split",
        "Stack",
        "Start",
        "Step",
        "Stop",
        "Store",
        "Submit",
        "Substitute",
        "Subtract",
        "Sum",
        "Synthesize",
        "Take",
        "Terminate",
        "Test",
        "Time",
        "Trace",
        "Transform",
        "Transpose",
        "Trim",
        "Truncate",
        "Try",
        "Turn",
        "Undo",
        "Unpack",
        "Update",
        "Validate",
        "Vary",
        "Verify",
        "Wait",
        "Warn",
        "Widen",
        "Wire",
        "Wrap",
        "Write",
        "Yield",
    ]
)
"""Verbs that a function's docstring may begin with; another one is a reviewed change."""

WORDS = {
    "what": (r"what", 5.0),
    "where": (r"where", 20.0),
    "say": (r"say|says|said", 1.0),
    "own": (r"own", 3.0),
    "who": (r"who|whoever|nobody|somebody", 2.0),
    "stand": (r"stands?", 0.5),
    "is no": (r"(?:is|are) no", 2.0),
    "share": (r"share", 2.0),
    "tell": (r"tell|tells|told", 0.5),
    "beside": (r"beside", 0.2),
}
"""Pattern, and limit of its occurrences per 10,000 words: rates of technical English."""


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def documented(path: Path) -> Iterator[tuple[str, str, str]]:
    """Kind, name and docstring of a module, its classes, functions and properties."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text:
                marks = [ast.unparse(mark) for mark in getattr(node, "decorator_list", [])]
                kind = type(node).__name__
                if any(mark.endswith(("property", ".setter")) for mark in marks):
                    kind = "property"
                yield kind, getattr(node, "name", path.stem), text


def prose(text: str) -> str:
    """A docstring without its examples, headings of entries and names in backticks."""
    text = re.sub(r"(?m)^\s*(>>>|\.\.\.).*$", "", text)
    text = re.sub(r"(?m)^\S[^\n]* : [^\n]*$", "", text)
    return re.sub(r"`+[^`]*`+", "", text)


@of_every_file(MODULES)
def test_docstrings_begin_with_a_verb_or_a_noun(path):
    for kind, name, text in documented(path):
        first = text.splitlines()[0]
        assert not NEVER.match(first), f"{name}: {first}"
        if "Function" in kind:
            assert first.split()[0].strip(".,:") in VERBS, f"{name}: begin with a verb: {first}"


@of_every_file(MODULES)
def test_no_entry_repeats_its_annotation(path):
    for _, name, text in documented(path):
        lines = text.splitlines()
        for at, line in enumerate(lines):
            if re.match(r"(Parameters|Attributes)$", line.strip()) and set(lines[at + 1]) == {"-"}:
                section = lines[at + 2 :]
                for entry, after in zip(section, [*section[1:], ""]):
                    if set(after) == {"-"}:
                        break
                    if re.match(r"\S.* : ", entry):
                        assert after.startswith("    "), f"{name}: {entry}"


def test_word_rates_are_those_of_technical_english():
    text = " ".join(prose(text) for path in MODULES for _, _, text in documented(path))
    count = len(text.split())
    rates = {
        word: 1e4 * len(re.findall(rf"\b(?:{pattern})\b", text, re.IGNORECASE)) / count
        for word, (pattern, _) in WORDS.items()
    }
    assert {word: rate for word, rate in rates.items() if rate > WORDS[word][1]} == {}


# ---- sections ------------------------------------------------------------------------------------


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
    """Fields of a dataclass and arguments of a constructor without a docstring of their own."""
    for statement, after in zip(node.body, [*node.body[1:], None]):
        described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if isinstance(statement, ast.AnnAssign):  # an option of the command line has its --help
            described |= any(
                word in ast.unparse(statement.annotation) for word in ("Option", "Argument")
            )
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            if not described and not statement.target.id.startswith("_"):
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
def test_public_functions_name_the_errors_that_they_raise(path):
    owed = []
    for name, node in public(tree_of(path)):
        if "overload" in [ast.unparse(mark) for mark in node.decorator_list]:
            continue  # the implementation describes all of them
        text = ast.get_docstring(node) or ""
        owed += [] if text else [f"{name}: no docstring"]
        if isinstance(node, ast.FunctionDef):
            owed += [f"{name}: raises {error}" for error in raised(node) if error not in text]
    assert owed == []


def met_first() -> dict[str, object]:
    """Names of the package's face, and classes and functions that the demos take from its rooms."""
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
    return {n: t for n, t in (found | face).items() if inspect.isclass(t) or inspect.isfunction(t)}


MET_FIRST = met_first()


def test_records_of_the_face_describe_every_field():
    owed = []
    for name, record in MET_FIRST.items():
        if inspect.isclass(record) and record.__module__.startswith("ann_dc."):
            path = Path(inspect.getfile(importlib.import_module(record.__module__)))
            nodes = (n for n in tree_of(path).body if isinstance(n, ast.ClassDef))
            node = next((n for n in nodes if n.name == record.__name__), None)
            text = inspect.getdoc(record) or ""
            owed += (
                [f"{name}: {field}" for field in fields(node) if field not in text] if node else []
            )
    assert owed == []


FACE = {name: getattr(ann_dc, name) for name in ann_dc.__all__}
TEACH = sorted(
    name
    for name, thing in MET_FIRST.items()
    if inspect.isfunction(thing) or thing is FACE.get(name)
)


@pytest.mark.parametrize("name", TEACH)
def test_the_face_has_examples(name):
    assert ">>> " in (inspect.getdoc(MET_FIRST[name]) or "")
