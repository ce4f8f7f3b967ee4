"""Inputs that words are chosen for; of others integers say saturated, and never settled."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fixed_points import in_integers, needs, said, walked, written

import ann_dc
from ann_dc.errors import ExportError, ProblemError, UnknownNameError
from ann_dc.export.fixed_point import golden, machine as machines, sampling, widths
from ann_dc.export.fixed_point.c99 import c99_check, c99_files
from ann_dc.export.fixed_point.golden import FixedPoint, Measured
from ann_dc.export.fixed_point.hdl import hdl_files
from ann_dc.export.fixed_point.machine import Integers
from ann_dc.export.fixed_point.widths import fixed_point
from ann_dc.export.reference.vector import reference_vector

FAR = {"q_d.x": (0.5, 40.0)}
OVER = "q_d.x=0.5:40"


def loaded(model: FixedPoint, **values: float) -> dict[str, np.ndarray]:
    """Inputs at all stages, in network units."""
    ports = {port.name: port for port in model.inputs}
    return {
        name: np.full((len(ports[name].words), 1), ports[name].scale.network(value))
        for name, value in values.items()
    }


@cache
def far(bits: int = 16) -> FixedPoint:
    return fixed_point(*walked("double_integrator"), bits=bits, over=OVER)


def test_ranges_of_a_network_are_those_of_its_words():
    network, vector = walked("double_integrator")
    found = fixed_point(replace(network, ranges=FAR), vector, bits=16)
    assert found.ranges == far().ranges == FAR
    assert np.array_equal(found.machine.edges, far().machine.edges)


@pytest.mark.parametrize("bits", [16, 32])
def test_held_out_inputs_in_the_ranges_settle_right(bits):
    """Forty times the target of the network's own walk."""
    network, _ = walked("double_integrator")
    model = far(bits)
    assert model.measured.right == model.measured.inputs == model.measured.floats == 256
    machine = model.model(loaded(model, **{"q_d.x": 37.0}))
    run = machine.settle(model.limit)
    assert run.settled.all()
    expected = reference_vector(network.with_inputs({"q_d.x": 37.0}))
    assert model.control_error(run.states[:, 0], expected) < 5e-3


def test_targets_around_zero_are_judged_by_the_largest_control_of_all():
    """Where all controls vanish, no number of some bits has any relative accuracy."""
    model = fixed_point(*walked("double_integrator"), bits=16, over="q_d.x=-2:2")
    assert model.measured.right == model.measured.inputs == 256


def test_ranges_that_are_none_are_refused():
    network, vector = walked("double_integrator")
    for over, error in (("q_d.x=2:1", ExportError), ("q_d.z=0:1", UnknownNameError),
                        ("q_d.x", ProblemError), ("q_d.x=0:inf", ExportError)):  # fmt: skip
        with pytest.raises(error, match="over"):
            fixed_point(network, vector, over=over)


def test_an_open_range_ends_at_the_own_value():
    network, vector = walked("double_integrator")
    found = fixed_point(replace(network, ranges={"q_d.x": (0.5, np.inf)}), vector, bits=16)
    assert found.ranges == {"q_d.x": (0.5, 1.0)}


@pytest.mark.parametrize("value", [1.9, 1e6])
def test_an_input_out_of_range_saturates_and_never_settles(value):
    """On the way, or already where it is loaded."""
    model = in_integers("double_integrator", 16)
    machine = model.model(loaded(model, **{"q_d.x": value}))
    assert machine.saturated[0] == (value == 1e6)
    run = machine.settle(model.limit)
    assert machine.saturated[0]
    assert not run.settled[0]


def test_a_car_to_the_other_side_is_not_called_settled():
    """It was, at a cost of 340.1; the optimum costs 140.59."""
    model = in_integers("car", 16)
    machine = model.model(loaded(model, **{"q_d.x": -3.0, "q_d.y": 2.0}))
    assert not machine.settle(model.limit).settled[0]
    assert machine.saturated[0]


def test_saturation_stays_until_the_next_start():
    model = in_integers("double_integrator", 16)
    machine = model.model(loaded(model, **{"q_d.x": 1.9}))
    machine.run(40)
    target = next(port for port in model.inputs if port.name == "q_d.x")
    machine.lanes[target.words] = model.machine.words[target.words][:, None]
    assert not machine.settle(10 * model.limit).settled[0]
    assert machine.saturated[0]
    assert not model.model({}).saturated[0]


def test_lanes_do_not_see_each_other():
    model = far()
    values = np.linspace(0.5, 40.0, 70)
    network = walked("double_integrator")[0]
    scale = network.input_scale("q_d.x")
    together = model.model({"q_d.x": np.ones((4, 1)) * scale.network(values)})
    together.run(100)
    for lane in (0, 31, 32, 69):
        alone = model.model(loaded(model, **{"q_d.x": values[lane]}))
        alone.run(100)
        assert np.array_equal(alone.lanes[:, 0], together.lanes[:, lane])


def test_a_walk_far_from_rest_is_not_settled():
    """Still words are not enough: a drive beyond its threshold keeps a lane running."""
    model = far()
    neurons = model.machine.neurons.copy()
    neurons[:, 4] = 2**30  # everything is still
    machine = replace(model, machine=model.machine._replace(neurons=neurons)).model({})
    run = machine.settle(model.limit)
    assert run.settled[0]
    assert run.steps[0] > 2 * model.machine.period
    assert model.control_error(run.states[:, 0], walked("double_integrator")[1]) < 2e-2


def test_what_words_are_worth_is_written_down():
    files = c99_files(*walked("double_integrator"), bits=16, over=OVER)
    reported = (
        "q_d.x from 0.5 to 40; held out, "
        "256 of 256 inputs settle at the optimum (100.0%; float64 256)"
    )
    assert reported in c99_check(files)
    assert reported in files["README.md"].decode()
    assert "q_d.x from 0.5 to 40" in files["ann_dc_network.h"].decode()
    table = json.loads(files["fixed_point.json"])
    assert table["ranges"] == {"q_d.x": [0.5, 40.0]}
    assert table["measured"]["right"] == 256
    alone = c99_files(*walked("double_integrator"), bits=16)
    assert "the network only" in c99_check(alone)
    assert "settle at the optimum" not in c99_check(alone)
    table = json.loads(alone["fixed_point.json"])
    assert set(table["measured"].values()) == {0}
    assert str(Measured(**table["measured"])) == "no held-out inputs"


def unsettled(sample: sampling.Sample, lanes: slice) -> sampling.Sample:
    """A sample of which float64 does not settle some lanes, whose ends it does not know."""
    steps, ends = sample.steps.copy(), sample.ends.copy()
    steps[lanes], ends[:, lanes] = -1, np.nan
    return replace(sample, steps=steps, ends=ends)


def test_answers_that_float64_settles_with_shorter_steps_are_confirmed():
    network, vector = walked("double_integrator")
    model = far()
    sample = sampling.held_out(network, vector, model.ranges, model.step)
    run = model.model(sample.loaded).settle(model.limit)
    answers = model.values(run.states)
    given = unsettled(sample, slice(7, 10)), run.settled, answers
    again = sampling.confirmed(network, vector, *given)
    assert again.settled.all()
    assert np.abs(again.ends - sample.ends).max() < 1e-5 * np.abs(sample.ends).max()
    assert model.judged(run, again, 1e-2) == model.measured


def test_confirming_walks_take_half_the_step_for_twice_as_long(monkeypatch):
    """Also where walks are cut short by the most steps that they may take."""
    network, vector = walked("double_integrator")
    model = far()
    monkeypatch.setattr(sampling, "LIMIT", 2 * sampling._steps_of(vector, model.step))
    lengths, run = [], sampling.Walks.run

    def walk(walks, steps, lanes):
        lengths.append(steps)
        run(walks, steps, lanes)

    monkeypatch.setattr(sampling.Walks, "run", walk)
    monkeypatch.setattr(sampling, "_residuals", lambda network, walks, lanes: np.ones(len(lanes)))
    sample = sampling.held_out(network, vector, model.ranges, model.step)
    steps, answers = sum(lengths), np.zeros_like(sample.ends)
    lengths.clear()
    sampling.confirmed(network, vector, sample, np.ones(256, np.bool_), answers)
    assert sum(lengths) == 2 * 4 * steps  # from the start, then from the answers


@pytest.mark.parametrize("factor", [1, 2])
def test_answers_at_which_float64_rests_are_confirmed(monkeypatch, factor):
    """Also if it does not settle from the start; a wrong answer is one that it leaves."""
    network, vector = walked("double_integrator")
    model = far()
    sample = sampling.held_out(network, vector, model.ranges, model.step)
    run = model.model(sample.loaded).settle(model.limit)
    run.states[:, 7:10] *= factor
    walk = sampling._walked

    def lost(*given):
        return walk(*given) if given[-1] is not None else unsettled(walk(*given), slice(None))

    monkeypatch.setattr(sampling, "_walked", lost)
    answers = model.values(run.states)
    given = unsettled(sample, slice(7, 10)), run.settled, answers
    again = sampling.confirmed(network, vector, *given)
    wrong = 3 * (factor > 1)
    expected = model.measured._replace(right=256 - wrong, wrong=wrong)
    assert model.judged(run, again, 1e-2) == expected


@pytest.mark.parametrize(("bits", "advice"), [(0, "no word of up to 32 bits"), (16, "no width")])
def test_answers_that_float64_does_not_settle_are_refused(monkeypatch, bits, advice):
    """A settled answer is not excluded from the count because nothing confirms it."""
    monkeypatch.setattr(
        widths, "confirmed", lambda network, vector, sample, *given: unsettled(sample, slice(7, 8))
    )
    with pytest.raises(ExportError, match=advice) as refusal:
        fixed_point(*walked("double_integrator"), bits=bits, over=OVER)
    assert ", 0 wrong, 1 unconfirmed, " in str(refusal.value)
    assert "(wanted 0.001), but in the ranges" in str(refusal.value)
    assert "(expected none unconfirmed)" in str(refusal.value)
    assert "or design the network for them first (--range)" in str(refusal.value)
    assert "accuracy" not in str(refusal.value)


@pytest.mark.parametrize("bits", [0, 16])
def test_words_that_settle_fewer_inputs_than_float64_are_refused(monkeypatch, bits):
    """One answer right and most inputs silent is not good enough."""
    settle = Integers.settle

    def sparse(model: Integers, limit: int) -> machines.Settled:
        run = settle(model, limit)
        kept = np.arange(len(run.settled)) < 0.97 * len(run.settled)
        return run._replace(settled=run.settled & kept)

    monkeypatch.setattr(Integers, "settle", sparse)
    with pytest.raises(ExportError, match="settle at the optimum") as refusal:
        fixed_point(*walked("double_integrator"), bits=bits, over=OVER)
    assert ", 0 wrong, 0 unconfirmed, " in str(refusal.value)
    assert "as many correct as in float64 less 2%" in str(refusal.value)


def test_errors_do_not_relate_to_controls_of_walks_that_are_lost():
    found, wanted = np.array([[1.0], [0.0]]), np.array([[1.1], [1e9]])
    errors = golden.control_errors(found, wanted, np.array([True, False]))
    assert errors[0] == pytest.approx(1 / 11)


def test_the_same_network_gives_the_same_bytes():
    given = {"bits": 16, "over": OVER}
    first = c99_files(*walked("double_integrator"), **given)
    assert first == c99_files(*walked("double_integrator"), **given)


STATUS = """
#include "ann_dc_network.h"
#include <stdio.h>
#include <stdlib.h>
static ann_dc_network network;
int main(int count, char **words) {
    (void)count;
    ann_dc_start(&network);
    ann_dc_load_all(&network, atoi(words[1]), atol(words[2]));
    printf("%d ", ann_dc_status(&network));
    (void)ann_dc_settle(&network, (uint32_t)atol(words[3]));
    printf("%d %lu ", ann_dc_status(&network), (unsigned long)network.steps);
    ann_dc_load_all(&network, atoi(words[1]), atol(words[4]));
    printf("%d ", ann_dc_status(&network));
    (void)ann_dc_settle(&network, (uint32_t)atol(words[3]));
    printf("%d %lu\\n", ann_dc_status(&network), (unsigned long)network.steps);
    return 0;
}
"""


@pytest.mark.sampled(4)
@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize(
    ("value", "limit", "expected"),
    [
        (1.0, 0, (0, 1, 0, 1)),
        (1.0, 16, (0, 3, 0, 3)),
        (1.9, 0, (0, 2, 2, 2)),
        (1e4, 0, (2, 2, 2, 2)),
    ],
)
def test_c_tells_its_status_like_the_golden_model(value, limit, expected, bits, tmp_path):
    """Running before; settled, limit or saturated after; then the same with a second target."""
    needs("gcc")
    model = in_integers("double_integrator", bits)
    written(c99_files(*walked("double_integrator"), bits=bits), tmp_path)
    (tmp_path / "status.c").write_text(STATUS)
    command = ("gcc", "-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion")
    assert said(tmp_path, *command, "-o", "status", "status.c", "ann_dc_network.c") == (0, "")
    index = next(i for i, port in enumerate(model.inputs) if port.name == "q_d.x")
    target = model.inputs[index]
    number = round(target.scale.network(value) * 2 ** int(model.fraction[target.words[0]]))
    limit = limit or model.limit
    second = round(number * 0.8)
    given = map(str, (index, number, limit, second))
    words = [int(word) for word in said(tmp_path, "./status", *given)[1].split()]
    assert (words[0], words[1], words[3], words[4]) == expected
    machine = model.model(loaded(model, **{"q_d.x": value}))
    run = machine.settle(limit)
    assert words[2] == run.steps[0]
    assert run.settled[0] == (expected[1] == 1)
    machine.load(target.words, np.full(len(target.words), second))
    run = machine.settle(machine.steps + limit)
    assert run.settled[0] == (expected[3] == 1)
    if not machine.saturated[0]:  # else the golden model has nothing to walk for
        assert words[5] == run.steps[0]


BENCH = """
module bench;
    logic clock = 0, reset = 1, restart = 0, run = 0, load = 0, busy, settled, saturated;
    logic [31:0] steps;
    logic stop = 1;
    logic [31:0] most = LIMIT;
    logic [1:0] status;
    logic [AT-1:0] address = 0;
    logic signed [15:0] data = 0, word;
    logic signed [27:0] fine;
    int n;
    ann_dc_network network (.clock(clock), .reset(reset), .restart(restart), .run(run),
        .limit(most), .until_settled(stop), .busy(busy), .settled(settled),
        .saturated(saturated), .status(status), .steps(steps), .load(load), .address(address),
        .data(data), .word(word), .fine(fine));
    always #5 clock = !clock;
    initial begin
        repeat (2) @(negedge clock);
        reset = 0; restart = 1; @(negedge clock); restart = 0;
        while (busy) @(negedge clock);
        load = 1; data = DATA;
        for (n = FIRST; n <= LAST; n = n + 1) begin address = n; @(negedge clock); end
        load = 0; run = 1; @(negedge clock); run = 0;
        while (busy) @(negedge clock);
        $display("%0d %0d", status, steps);
        for (n = 0; n < WORDS; n = n + 1) begin
            address = n; @(negedge clock); $display("%0d %0d", fine, word);
        end
        address = FIRST; load = 1; @(negedge clock); load = 0;
        $display("loaded %0d %0d", status, settled);
        run = 1; @(negedge clock); run = 0;
        while (busy) @(negedge clock);
        $display("again %0d", status);
        stop = 0; most = 1; run = 1; @(negedge clock); run = 0;
        while (busy) @(negedge clock);
        $display("stepped %0d %0d", status, settled);
        stop = 0; most = PERIOD; run = 1; @(negedge clock); run = 0;
        while (busy) @(negedge clock);
        $display("marked %0d %0d", status, settled);
        $finish;
    end
endmodule
"""


@pytest.mark.parametrize(("value", "limit", "status"), [(1.0, 0, 1), (1.9, 24, 2), (1.0, 16, 3)])
def test_hardware_tells_its_status_and_saturates_bit_for_bit(value, limit, status, tmp_path):
    needs("iverilog")
    model = in_integers("double_integrator", 16)
    written(hdl_files(*walked("double_integrator"), bits=16), tmp_path)
    target = next(port for port in model.inputs if port.name == "q_d.x")
    number = round(target.scale.network(value) * 2 ** int(model.fraction[target.words[0]]))
    given = loaded(model, **{"q_d.x": value})
    run, machine = model.model(given).settle(limit or model.limit), model.model(given)
    machine.run(run.steps[0])
    words = {"AT-1": f"{(len(machine.words) - 1).bit_length()}-1", "LIMIT": f"32'd{limit}",
             "DATA": number, "FIRST": target.words[0], "LAST": target.words[-1],
             "WORDS": len(machine.words), "PERIOD": 2 * model.machine.period + 1}  # fmt: skip
    text = BENCH
    for name, word in words.items():
        text = text.replace(name, str(word))
    (tmp_path / "bench.sv").write_text(text)
    command = ("iverilog", "-g2012", "-o", "simulation", "bench.sv", "ann_dc_network.sv")
    assert said(tmp_path, *command) == (0, "")
    lines = said(tmp_path, "vvp", "-n", "simulation")[1].splitlines()
    idle = 2 if status == 2 else 0
    assert f"loaded {idle} 0" in lines
    assert f"again {status}" in lines
    assert f"stepped {idle} 0" in lines
    assert f"marked {idle} 0" in lines
    rows = [[int(word) for word in line.split()] for line in lines if re.match(r"-?\d+ ", line)]
    assert rows[0] == [status, run.steps[0]]
    assert run.settled[0] == (status == 1)
    fine = np.array(rows[1:])
    top = 2**15 - 1
    assert fine[:, 0].tolist() == machine.words.tolist()
    assert fine[:, 1].tolist() == np.minimum((machine.words + 2**11) >> 12, top).tolist()


TWO = """
#include "one_network.h"
#include "two_network.h"
#include <cstdio>
static one_network first;
static two_network second;
int main() {
    one_start(&first);
    two_start(&second);
    one_settle(&first, ONE_LIMIT);
    two_settle(&second, TWO_LIMIT);
    std::printf("%d %d\\n", one_status(&first) == ONE_SETTLED, two_status(&second) == TWO_SETTLED);
}
"""


def test_two_networks_in_one_c_plus_plus_program(tmp_path):
    """A header says extern "C", and a prefix keeps names apart."""
    needs("g++")
    for name, prefix in (("double_integrator", "one"), ("bounds", "two")):
        files = c99_files(*walked(name), bits=16, prefix=prefix)
        assert c99_check(files)
        written(files, tmp_path)
        source = f"{prefix}_network.c"
        strict = ("-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion")
        assert said(tmp_path, "gcc", "-std=c99", *strict, "-c", source) == (0, "")
    (tmp_path / "two.cpp").write_text(TWO)
    command = ("g++", "-Wall", "-Wextra", "-Werror", "-o", "two", "two.cpp")
    assert said(tmp_path, *command, "one_network.o", "two_network.o") == (0, "")
    assert said(tmp_path, "./two") == (0, "1 1\n")


@pytest.mark.parametrize("prefix", ["", "1st", "a-b", 'x"; evil', "_a"])
def test_a_prefix_that_is_no_identifier_is_refused(prefix):
    with pytest.raises(ExportError, match="prefix"):
        c99_files(*walked("double_integrator"), bits=16, prefix=prefix)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unicycle", "van_der_pol"])
def test_families_settle_right_in_compiled_code(name):
    """A thousand inputs, at 16 and at 32 bits; the bench has ten times as many."""
    from bench.integers import figures

    needs("cc")
    assert [figure.name for figure in figures([name], 1000) if not figure.good] == []


@pytest.mark.slow
def test_a_car_to_many_targets_is_right_or_not_called_settled():
    """A network without ranges: whatever it calls settled is where float64 settles."""
    network, vector = walked("car")
    model = fixed_point(network, vector, bits=16)
    rng = np.random.default_rng(0)
    values = {"q_d.x": rng.uniform(2, 8, 200), "q_d.y": rng.uniform(2, 8, 200)}
    given = {
        name: np.ones((network.stages, 1)) * network.input_scale(name).network(value)
        for name, value in values.items()
    }
    run = model.model(given).settle(model.limit)
    batch = ann_dc.OdeBackend().run_batch(network, values)
    errors = model.errors(run.states, batch.states.T)
    assert errors[run.settled & batch.settled].max(initial=0.0) < 1e-2
