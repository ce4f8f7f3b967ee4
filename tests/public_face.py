"""What ``ann_dc/__init__.pyi`` names, down to every argument that a user can give."""

import dataclasses
import enum
import inspect
from collections.abc import Callable, Iterator

import ann_dc


def things() -> Iterator[tuple[str, Callable]]:
    """Functions and classes of the face, and of the modules that it hands on."""
    for name in ann_dc.__all__:
        thing = getattr(ann_dc, name)
        if inspect.ismodule(thing) and thing is not ann_dc.errors:
            inside = getattr(thing, "__all__", None) or [
                n for n, t in vars(thing).items()
                if not n.startswith("_") and (getattr(t, "__module__", "") == thing.__name__
                                              or (name == "plants" and inspect.isfunction(t)))
            ]  # fmt: skip
            yield from ((f"{name}.{n}", getattr(thing, n)) for n in inside)
        else:
            yield name, thing


def of_ours(thing: object) -> bool:
    module = getattr(thing, "__module__", "")
    return module.startswith("ann_dc") and not module.startswith("ann_dc.validation")


def callables() -> dict[str, Callable]:
    """Everything of the face that is called with arguments, by its name under ``ann_dc``."""
    found = {}
    for name, thing in things():
        if not of_ours(thing):
            continue
        if inspect.isfunction(thing):
            found[name] = thing
        elif inspect.isclass(thing) and is_made_by_users(thing):
            found[name] = thing
            found |= {f"{name}.{n}": m for n, m in methods(thing)}
    unique = {id(thing): name for name, thing in reversed(found.items())}
    taken = {name: found[name] for name in sorted(unique.values())}
    return {name: thing for name, thing in taken.items() if arguments(thing)}


def is_made_by_users(kind: type) -> bool:
    return not (issubclass(kind, enum.Enum) or inspect.isabstract(kind))


def methods(kind: type) -> Iterator[tuple[str, Callable]]:
    for owner in kind.__mro__:
        if owner.__module__.startswith("ann_dc"):
            for name, method in vars(owner).items():
                is_field = name in getattr(kind, "__dataclass_fields__", ())
                if inspect.isfunction(method) and not (name.startswith("_") or is_field):
                    yield name, getattr(kind, name)


def arguments(thing: Callable) -> tuple[str, ...]:
    """Names of what a call can be given; ``self`` and what takes any name left out."""
    rest = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    parameters = inspect.signature(thing).parameters.values()
    return tuple(p.name for p in parameters if p.name != "self" and p.kind not in rest)


def default_of(thing: Callable, argument: str) -> object:
    """What an argument is where it is not given."""
    if dataclasses.is_dataclass(thing):
        field = thing.__dataclass_fields__[argument]
        if field.default_factory is not dataclasses.MISSING:
            return field.default_factory()
    return inspect.signature(thing).parameters[argument].default
