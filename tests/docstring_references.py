"""References in docstrings to names of the package that do not exist.

A docstring that names what was renamed long ago misleads. A name looks like one of
the package if it has a dot, and begins with ``ann_dc`` or a module's last name or contains a class:
``ann_dc.solve``, ``loops.residuals``, ``Network.state_index``. ``problem.states`` is good too (a
class of `problem` has them), and ``mu.phi`` does not look like one: it is a neuron.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from types import ModuleType

import ann_dc

REFERENCE = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)+)(?:\(\))?`")
ROLE = re.compile(r":\w+:`~?([\w.]+)`")


def modules() -> list[ModuleType]:
    """Every module of the package, outer ones first; lazily handed-on names are loaded."""
    names = [m.name for m in pkgutil.walk_packages(ann_dc.__path__, "ann_dc.")]
    found = [importlib.import_module(n) for n in ("ann_dc", *names) if not n.endswith("__main__")]
    for module in found:
        for name in getattr(module, "__all__", ()):
            setattr(module, name, getattr(module, name))
    return found


def docstrings(module: ModuleType) -> Iterator[tuple[str, str]]:
    """(Where, text) of a module, and of what it defines."""
    yield module.__name__, module.__doc__ or ""
    for name, value in vars(module).items():
        defined = inspect.isclass(value) or inspect.isfunction(value)
        if defined and value.__module__ == module.__name__:
            yield f"{module.__name__}.{name}", value.__doc__ or ""
            for inner, member in vars(value).items() if inspect.isclass(value) else ():
                text = inspect.getdoc(member) if callable(member) else member.__doc__
                if not inner.startswith("__") and isinstance(member, _DOCUMENTED):
                    yield f"{module.__name__}.{name}.{inner}", text or ""


_DOCUMENTED = (type(docstrings), property, classmethod, staticmethod)


class Names:
    """What a reference may mean.

    Parameters
    ----------
    known : list of module
        The modules of the package.
    """

    def __init__(self, known: list[ModuleType]) -> None:
        self.roots: dict[str, list[object]] = {"ann_dc": [ann_dc]}
        for module in known:
            self.roots.setdefault(module.__name__.rpartition(".")[2], []).append(module)
            for name, value in vars(module).items():
                if inspect.isclass(value) and value.__module__.startswith("ann_dc"):
                    self.roots.setdefault(name, []).append(value)

    def broken(self, reference: str, module: ModuleType) -> bool:
        """Whether a dotted name looks like one of the package and is none."""
        first, *rest = reference.split(".")
        if first in vars(module):
            roots = [vars(module)[first]]
        elif first in self.roots:
            roots = self.roots[first]
        else:
            capital = any(part[0].isupper() for part in (first, *rest))
            return capital and importlib.util.find_spec(first) is None
        return not any(_reaches(each, rest) for root in roots for each in (root, *_classes(root)))


def _classes(value: object) -> list[type]:
    """Classes that a module or a room defines: its name may stand for an instance of one."""
    if not inspect.ismodule(value):
        return []
    inside = f"{value.__name__}."
    found = [c for c in vars(value).values() if inspect.isclass(c)]
    return [c for c in found if f"{c.__module__}.".startswith(inside)]


def _reaches(value: object, path: list[str]) -> bool:
    for name in path:
        if is_dataclass(value) and name in value.__dataclass_fields__:
            return True  # an instance's attribute: what it has is not known here
        if name in _annotated(value):
            return True
        if not hasattr(value, name):
            return False
        value = getattr(value, name)
    return True


def _annotated(value: object) -> set[str]:
    """Attributes of a class that only instances have: annotated, or set on ``self``."""
    if not inspect.isclass(value):
        return set()
    own = [base for base in value.__mro__ if base.__module__.startswith("ann_dc")]
    text = "".join(inspect.getsource(base) for base in own)
    return set(re.findall(r"self\.(\w+)(?:: [^=\n]+)? =", text))


def broken_references(known: list[ModuleType]) -> list[str]:
    """A line for every reference to what does not exist."""
    names = Names(known)
    found = []
    for module in known:
        for where, text in docstrings(module):
            for reference in (*REFERENCE.findall(text), *ROLE.findall(text)):
                if names.broken(reference, module):
                    found.append(f"{where}: `{reference}` does not exist")
    return found
