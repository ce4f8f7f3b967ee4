"""The shapes of reports fit into a terminal of 80 letters, and say everything in it."""

import numpy as np
import pytest
import sympy as sp
from rich.console import Console

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.tables import named_rows, printable, span, table, unit_list, verdict_text


def shown(thing):
    console = Console(width=80, record=True, file=None, quiet=False, color_system=None)
    with console.capture() as capture:
        console.print(thing)
    return capture.get()


def test_long_rows_are_folded_and_nothing_is_lost():
    text = shown(named_rows({"what": "x" * 200, "certified": verdict_text(True, "an optimum")}))
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("x") == 200
    assert "yes: an optimum" in text


@pytest.mark.parametrize("said", ["[red]x[/nope]", "[link=http://x]y[/link]", "\x1b[2J\x9bJ\u202e"])
def test_rows_are_no_markup_and_move_no_cursor(said):
    plain = "".join(sign if sign.isprintable() else "?" for sign in said)
    for value in (said, printable(said)):
        assert plain in shown(named_rows({"network": value}))


@pytest.mark.parametrize("dense", [True, False])
def test_a_table_has_its_columns(dense):
    listed = table("run", "objective", dense=dense)
    listed.add_row("first", "1.5")
    assert all(word in shown(listed) for word in ("run", "objective", "first", "1.5"))


@pytest.mark.parametrize(("good", "start"), [(True, "yes: "), (False, "no: ")])
def test_a_verdict_says_yes_or_no_first(good, start):
    assert verdict_text(good, "because").plain == f"{start}because"


def test_a_span_is_one_number_where_all_are_the_same():
    assert span(np.full(3, 0.1)) == "0.1"
    assert span(np.array([3.0, -1.0])) == "(-1 .. 3)"


def test_units_are_listed_where_they_were_declared():
    x, u, dt = sp.symbols("x u dt")
    problem = OptimalControlProblem(
        states=(x, dt), controls=(u,), map=(x + u, dt + u), cost=u**2, horizon=3, q_0=(0, 0),
        units={x: "K", dt: "m", "cost": "EUR", "time": "day"},
    )  # fmt: skip
    assert unit_list(problem) == "x (K), dt (m), time (day), cost (EUR)"
