"""Hints that are kept: what a checked call takes, what it refuses, and in which words."""

import importlib
import inspect
import pickle
import re
import timeit
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Protocol, get_type_hints

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import (
    AnnDcError,
    ArgumentError,
    ArgumentTypeError,
    ArgumentValueError,
    DesignError,
    require_positive,
    such_as,
)
from ann_dc.validation import (
    Count,
    FloatOrNan,
    NotEmpty,
    Own,
    PositiveFinite,
    Shape,
    check_of,
    checked,
)

PROBLEM = ann_dc.plants.double_integrator(N=3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: ann_dc.solve("car"),
            "problem: expected an OptimalControlProblem such as ann_dc.plants.car(), got the text "
            "'car'",
        ),
        (
            lambda: ann_dc.solve(PROBLEM, backend=3),
            "backend: expected a Backend such as ann_dc.OdeBackend() or text, got 3",
        ),
        (
            lambda: ann_dc.solve(PROBLEM, initial_guess=3),
            "initial_guess: expected an InitialGuess such as ann_dc.interpolated_guess(problem) or "
            "a function or text, got 3",
        ),
        (
            lambda: ann_dc.SpiceBackend(level=3),
            "level: expected a Level such as ann_dc.levels.macro(), got 3",
        ),
        (lambda: ann_dc.OdeBackend(limit=-1), "limit: expected a positive number, got -1"),
        (
            lambda: ann_dc.solve(PROBLEM, backend=ann_dc.OdeBackend),
            "got the class OdeBackend; make one: OdeBackend(...)",
        ),
        (lambda: ann_dc.solve(ann_dc.plants.car), "got the function car; call it: car(...)"),
        (
            lambda: ann_dc.OdeBackend().run(ann_dc.solve(PROBLEM)),
            "network: expected a Network such as ann_dc.design(problem).network, got a Solution; "
            "pass its .network",
        ),
        (
            lambda: ann_dc.design(PROBLEM, preconditioner=[3]),
            "preconditioner[0]: expected one of PreconditionerKind.DIAG",
        ),
        (lambda: ann_dc.SpiceBackend(seed=-1), "seed: expected a whole number, 0 or more, got -1"),
        (lambda: ann_dc.levels.Level(name="x", models="mine"), "models: expected one of 'ideal'"),
    ],
)
def test_what_a_user_gets_wrong_is_told(call, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        call()


def test_gains_of_another_network():
    gains = ann_dc.manual_gains(ann_dc.synthesize(ann_dc.plants.double_integrator(N=6)))
    with pytest.raises(DesignError, match=re.escape("rate of shape (9, 3), got (9,) and (9, 6)")):
        ann_dc.solve(PROBLEM, gains=gains)


def test_errors_are_what_a_user_expects():
    assert issubclass(ArgumentTypeError, AnnDcError)
    assert issubclass(ArgumentTypeError, TypeError)
    assert issubclass(ArgumentValueError, AnnDcError)
    assert issubclass(ArgumentValueError, ValueError)


# ---- hints -------------------------------------------------------------------------------------


class Speaks(Protocol):
    @property
    def loud(self) -> bool: ...

    def speak(self) -> str: ...


class Dog:
    loud = True

    def speak(self) -> str:
        return "wuff"


def one(hint, value, default=inspect.Parameter.empty):
    """A checked function of one argument of that hint, called."""

    def function(given):
        return given

    function.__annotations__ = {"given": hint}
    if default is not inspect.Parameter.empty:
        function.__defaults__ = (default,)
    return checked(function)(value)


TAKEN = [
    (float, 1), (float, np.float32(0.5)), (float, float("inf")), (int, np.int64(3)),
    (bool, np.bool_(True)), (str, ""), (float | None, None), (FloatOrNan, float("nan")),
    (tuple[int, ...], ()), (tuple[int, str], (1, "a")), (Sequence[float], [1, 2.0]),
    (Sequence[float], np.zeros(2)), (Iterable[int], {1, 2}), (Mapping[str, float], {"a": 1}),
    (dict, {}), (Callable[[int], int], len), (type[Dog], Dog), (Speaks, Dog()),
    (Literal["a", 1], 1), (np.ndarray, np.zeros(3, bool)), (complex, 1), (None, None),
    (int | str, "x"), (Annotated[list, NotEmpty()], [0]), (Annotated[int, Own()], "anything"),
]  # fmt: skip

REFUSED = [
    (float, True, "expected a number, got True"),
    (float, float("nan"), "expected a number, got nan"),
    (float, "1", "expected a number, got the text '1'"),
    (int, 1.0, "expected a whole number, got 1.0"),
    (int, False, "expected a whole number, got False"),
    (bool, 1, "expected True or False, got 1"),
    (str, b"x", "expected text, got the bytes b'x'"),
    (str, None, "expected text, got None"),
    (tuple[int, ...], "12", "expected a tuple, got the text '12'"),
    (tuple[int, str], (1,), "expected a tuple of 2, got a tuple of 1"),
    (Sequence[float], [1, "x"], "given[1]: expected a number, got the text 'x'"),
    (Sequence[Dog], Dog, "expected a sequence of Dog, got the class Dog"),
    (Sequence[float], np.array(1.0), "expected a sequence, got array(1.)"),
    (Mapping[str, float], {1: 1.0}, "expected text for a key, got 1"),
    (Mapping[str, float], {"a": {}}, "given[a]: expected a number, got an empty dict"),
    (Callable[[int], int], dict, "expected a function, got the class dict"),
    (type[Dog], int, "expected a subclass of Dog, got the class int"),
    (Speaks, object(), "expected a Speaks, got an object"),
    (Literal["a", "b"], "c", "expected one of 'a', 'b', got the text 'c'"),
    (np.ndarray, np.array(["x"]), "expected a NumPy array of numbers, got an array of <U1"),
    (Annotated[np.ndarray, Shape(2)], np.zeros(3), "expected an array of shape (2,), got an"),
    (Annotated[np.ndarray, Shape("n")], [np.nan], "expected numbers, none of them nan"),
    (Annotated[np.ndarray, Shape("n")], np.zeros(0), "expected an array of shape (n,)"),
    (Annotated[list, NotEmpty()], [], "expected one at least, got an empty list"),
    (Count, 0, "expected a whole number, 1 or more, got 0"),
    (PositiveFinite, float("inf"), "expected a positive finite number, got inf"),
    (int | str, 1.5, "expected a whole number or text, got 1.5"),
    (int | None, 1.5, "expected a whole number, got 1.5"),
]


@pytest.mark.parametrize(("hint", "value"), TAKEN, ids=range(len(TAKEN)))
def test_a_value_that_fits_is_taken(hint, value):
    assert one(hint, value) is value


@pytest.mark.parametrize(("hint", "value", "message"), REFUSED, ids=range(len(REFUSED)))
def test_a_value_that_does_not_is_told(hint, value, message):
    with pytest.raises(ArgumentError, match=re.escape(message)) as refusal:
        one(hint, value)
    assert str(refusal.value).startswith("given")


def test_a_default_is_always_taken():
    assert one(int, None, default=None) is None
    assert np.isnan(one(float, float("nan"), default=float("nan")))


def test_without_a_hint_a_number_is_as_its_default():
    @checked
    def function(*, size=1.0, count=3, other=None):
        return size, count, other

    assert function(size=2, other="anything") == (2, 3, "anything")
    for wrong in ({"size": "x"}, {"size": float("inf")}, {"count": 2.5}):
        with pytest.raises(ArgumentError):
            function(**wrong)


def test_what_can_be_read_once_is_kept():
    assert one(Iterable[int], iter([1, 2])) == (1, 2)
    with pytest.raises(ArgumentTypeError, match=re.escape("given[1]")):
        one(Iterable[int], iter([1, "x"]))


def test_lists_stand_for_tuples_and_arrays():
    assert one(tuple[int, ...], [1, 2]) == (1, 2)
    assert one(np.ndarray, [[1, 2], [3, 4]]).shape == (2, 2)


def test_shapes_agree_with_each_other_and_with_other_arguments():
    @checked
    def function(
        problem: ann_dc.OptimalControlProblem,
        a: Annotated[np.ndarray, Shape("...", "problem.n", "N")],
        b: Annotated[np.ndarray, Shape("N+1")],
    ) -> None: ...

    function(PROBLEM, np.zeros((7, 2, 4)), b=np.zeros(5))
    with pytest.raises(ArgumentValueError, match=r"b: expected an array of shape \(N\+1,\) = \(5,"):
        function(PROBLEM, np.zeros((2, 4)), np.zeros(4))
    with pytest.raises(ArgumentValueError, match=re.escape("(..., problem.n, N) = (..., 2, N)")):
        function(PROBLEM, np.zeros(4), np.zeros(4))


def test_every_argument_is_checked_wherever_it_stands():
    @checked
    def function(a: int, /, b: int, *more: int, c: int = 0, **named: int) -> None: ...

    function(1, 2, 3, 4, c=5, d=6)
    wrong = [
        ("a", ("x", 2), {}), ("b", (1, "x"), {}), ("more", (1, 2, 3, "x"), {}),
        ("c", (1, 2), {"c": "x"}), ("d", (1, 2), {"d": "x"}),
    ]  # fmt: skip
    for name, args, kwargs in wrong:
        with pytest.raises(ArgumentTypeError, match=f"^{name}: expected a whole number"):
            function(*args, **kwargs)


def test_a_type_is_told_before_a_value():
    @checked
    def function(a: float, b: str) -> None: ...

    with pytest.raises(ArgumentTypeError, match="b: expected text"):
        function(float("nan"), 3)


# ---- records -----------------------------------------------------------------------------------


@such_as("Settings(tolerance=1)")
@checked
@dataclass(frozen=True, kw_only=True)
class Settings:
    """One."""

    tolerance: float
    count: int = 3

    def __post_init__(self) -> None:
        require_positive(DesignError, tolerance=self.tolerance)


class Pair(NamedTuple):
    left: float = 0.0


def test_records_are_checked_where_they_are_made():
    assert replace(Settings(tolerance=1), count=4).count == 4
    with pytest.raises(ArgumentTypeError, match=r"count: expected a whole number, got 2\.5"):
        replace(Settings(tolerance=1), count=2.5)
    assert checked(Pair)(2.0).left == 2.0
    with pytest.raises(ArgumentTypeError, match="left: expected a number"):
        Pair("x")


def test_a_record_has_the_first_word_on_its_values():
    with pytest.raises(DesignError, match="tolerance: expected a positive number, got nan"):
        Settings(tolerance=float("nan"))


def test_a_checked_thing_is_the_same_to_everybody_else():
    assert str(inspect.signature(Settings)) == "(*, tolerance: float, count: int = 3) -> None"
    assert Settings.__doc__ == "One."
    assert list(inspect.signature(ann_dc.solve).parameters)[:2] == ["problem", "form"]
    assert pickle.loads(pickle.dumps(ann_dc.solve)) is ann_dc.solve
    assert pickle.loads(pickle.dumps(Settings(tolerance=1))) == Settings(tolerance=1)


def test_a_check_costs_microseconds():
    @checked
    def function(a: float, *, b: float = 1.0, c: str | None = None) -> None: ...

    call = lambda: function(1.0, b=2.0, c="x")  # noqa: E731
    call()
    seconds = min(timeit.repeat(call, number=1000, repeat=20)) / 1000
    assert seconds < 20e-6  # 2.5e-6 on an idle machine


def rooms():
    root = Path(ann_dc.__file__).parent
    for face in sorted(root.rglob("__init__.pyi")):
        yield importlib.import_module(".".join(face.parent.relative_to(root.parent).parts))


def test_every_hint_of_a_public_name_can_be_read():
    """A hint that cannot be resolved would be found at the first call only."""
    for room in rooms():
        for name in room.__all__:
            thing = getattr(room, name)
            if inspect.isclass(thing) or inspect.isfunction(thing):
                hints = get_type_hints(inspect.unwrap(thing), include_extras=True)
                assert all(check_of(hint) is None or hint for hint in hints.values()), name
