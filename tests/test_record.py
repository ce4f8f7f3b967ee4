"""Writer of tests/bench/README.md, and the form of what it wrote."""

import re

import pytest
from bench.figure import Figure
from bench.record import BENCHES, HEAD, README, content_of, measured, patched, renewed, section

WRITTEN = {name: content_of(README.read_text("utf-8"), name) for name in BENCHES}
WRITTEN = {name: content for name, content in WRITTEN.items() if content}


@pytest.mark.parametrize("name", WRITTEN)
def test_section_has_a_title_a_line_of_its_run_and_one_table(name):
    title, line, table = WRITTEN[name].split("\n\n")
    assert re.fullmatch(r"### .{1,97}", title)
    when, _, command = line.partition(": ")
    assert re.fullmatch(r"Measured \d{4}-\d\d-\d\d at \w{7}( with changes)? on .+ s", when)
    assert re.fullmatch(rf"`make bench BENCHES={name}`\.( Renewed .+\.)?", command)
    head, rows = table[: len(HEAD)], table[len(HEAD) + 1 :].splitlines()
    assert head == HEAD
    assert all(row.startswith("| ") and row.count(" | ") == 2 for row in rows)
    names = [row.split(" | ")[0] for row in rows]
    assert len({*names}) == len(names) > 0


def test_every_bench_is_in_the_first_table():
    head = README.read_text("utf-8").partition("## Results")[0]
    assert [name for name in BENCHES if f"[`{name}`]({name}.py)" not in head] == []


def test_line_of_a_second_partial_renewal_replaces_that_of_the_first():
    figure = Figure(name="car", value="1 s")
    text = renewed("", "kernel", section("Kernel", [figure], measured("kernel", "today, in 3 s")))
    for day in ("a", "b"):
        text = patched(text, "kernel", [figure], f"Renewed car: {day}.")
    assert text.count("Renewed") == 1
    assert "`make bench BENCHES=kernel`. Renewed car: b." in text
