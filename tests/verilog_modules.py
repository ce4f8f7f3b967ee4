"""A reader of Verilog-A modules, which fails at text that is not well formed.

It covers the subset of the language that is exported.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ann_dc.export.netlists.verilog_a import KEYWORDS

NAME = r"[A-Za-z_]\w*+"
COMMENT = re.compile(r"//[^\n]*")
INCLUDE = re.compile(r"^[ \t]*`include[ \t]+\"[\w.]+\"", re.MULTILINE)
MODULE = re.compile(rf"\s*module\s+({NAME})\s*\(([^()]*)\)\s*;(.*?)\bendmodule\b", re.DOTALL)
ANALOG = re.compile(r"\banalog\s+begin\b")
END = re.compile(r"\bend\Z")
CONTRIBUTION = re.compile(r"([VI])\(([^()]*)\)\s*<\+\s*(.+)", re.DOTALL)
PARAMETER = re.compile(rf"parameter\s+real\s+({NAME})\s*=\s*(\S+)")
DECLARED = re.compile(r"(inout|input|output|electrical|ground)\s+(.+)", re.DOTALL)
BRANCH = re.compile(rf"branch\s*\(\s*({NAME})\s*\)\s*({NAME})")
INSTANCE = re.compile(rf"({NAME})\s*(?:#\((.*)\)\s*)?({NAME})\s*\(([^()]*)\)", re.DOTALL)
GIVEN = re.compile(r"\.(\w+)\(([^()]*)\)")


@dataclass(frozen=True, kw_only=True, eq=False)
class Instance:
    """Instance of a module within another module.

    Attributes
    ----------
    given : mapping of parameter name to expression
        Parameters of the instance.
    nets : tuple of str
        Nets in the order of the module's ports.
    """

    module: str
    name: str
    given: Mapping[str, str]
    nets: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Module:
    """Verilog-A module.

    Attributes
    ----------
    nodes : set of str
        All electrical nodes.
    grounds : set of str
        Reference nodes.
    branches : dict of name to node
        Branches to the reference.
    parameters : dict of name to text
        Default values.
    contributions : list of (access, names, expression)
        ``("V", ("out",), "...")`` for ``V(out) <+ ...;``.
    """

    name: str
    ports: tuple[str, ...]
    nodes: set[str] = field(default_factory=set)
    grounds: set[str] = field(default_factory=set)
    branches: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    contributions: list[tuple[str, tuple[str, ...], str]] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)


def modules_of(text: str) -> dict[str, Module]:
    """Parse the modules of a file, by name.

    Raises `ValueError` for text that is not such a module, an instance of an unknown module,
    unknown ports or parameters, or a contribution to an undeclared node.
    """
    plain = INCLUDE.sub("", COMMENT.sub("", text)).rstrip()
    modules: dict[str, Module] = {}
    place = 0
    while place < len(plain):
        found = MODULE.match(plain, place)
        if found is None:
            raise ValueError(
                f"Verilog-A: no module begins at {plain[place : place + 80].strip()[:40]!r}"
            )
        place, module = found.end(), _module(found[1], found[2], found[3])
        if module.name in modules:
            raise ValueError(f"Verilog-A: module {module.name} is there twice")
        modules[module.name] = module
    for module in modules.values():
        _check(module, modules)
    return modules


def _module(name: str, ports: str, body: str) -> Module:
    module = Module(name=name, ports=_names(ports))
    declarations, contributions = _halves(body.rstrip())
    for statement in _statements(declarations):
        _declare(module, statement)
    for statement in _statements(contributions):
        found = CONTRIBUTION.fullmatch(statement)
        if found is None or found[3].count("(") != found[3].count(")"):
            raise ValueError(f"Verilog-A: {name}: no contribution: {statement[:60]!r}")
        module.contributions.append((found[1], _names(found[2]), found[3]))
    return module


def _halves(body: str) -> tuple[str, str]:
    """Return the declarations of a module and the content of its analog block."""
    begins = ANALOG.search(body)
    ends = END.search(body, begins.end()) if begins else None
    if begins is None or ends is None:
        return body, ""
    return body[: begins.start()], body[begins.end() : ends.start()]


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",")) if text.strip() else ()


def _statements(text: str) -> list[str]:
    *whole, rest = [part.strip() for part in text.split(";")]
    if rest:
        raise ValueError(f"Verilog-A: no semicolon behind {rest[:60]!r}")
    return [part for part in whole if part]


def _declare(module: Module, statement: str) -> None:
    if found := DECLARED.fullmatch(statement):
        target = {"electrical": module.nodes, "ground": module.grounds}.get(found[1], set())
        target.update(_names(found[2]))
    elif found := PARAMETER.fullmatch(statement):
        module.parameters[found[1]] = found[2]
    elif found := BRANCH.fullmatch(statement):
        module.branches[found[2]] = found[1]
    elif found := INSTANCE.fullmatch(statement):
        given = dict(GIVEN.findall(found[2] or ""))
        instance = Instance(module=found[1], name=found[3], given=given, nets=_names(found[4]))
        module.instances.append(instance)
    else:
        raise ValueError(f"Verilog-A: {module.name}: not understood: {statement[:60]!r}")


def _check(module: Module, modules: Mapping[str, Module]) -> None:
    known = module.nodes | set(module.branches)
    used = [*module.ports, *module.branches.values(), *module.grounds]
    used += [name for _, names, _ in module.contributions for name in names]
    used += [net for instance in module.instances for net in instance.nets]
    for _, _, expression in module.contributions:
        accesses = re.findall(r"\b[VI]\(([^()]*)\)", expression)
        used += [name for access in accesses for name in _names(access)]
    for name in used:
        if name not in known or name in KEYWORDS:
            raise ValueError(f"Verilog-A: {module.name}: {name[:40]!r} is not declared")
    for instance in module.instances:
        inner = modules.get(instance.module)
        if inner is None or len(inner.ports) != len(instance.nets):
            raise ValueError(f"Verilog-A: {module.name}: {instance.name} fits no module")
        if not set(instance.given) <= set(inner.parameters):
            raise ValueError(f"Verilog-A: {module.name}: {instance.name} has other parameters")
