"""A network as a list of operations takes the steps of the network itself."""

import numpy as np
import pytest
from fixed_points import walked as designed

import ann_dc
from ann_dc.lowering.program import Program
from ann_dc.lowering.walk import Walks
from ann_dc.lowering.writing import program_of

CASES = [("double_integrator", kind) for kind in ann_dc.PreconditionerKind]
CASES += [(name, None) for name in ("car", "cstr", "bounds", "objectives")]


def walked(program: Program, steps: int) -> Walks:
    walks = Walks(program, {})
    walks.run(steps, np.arange(1))
    return walks


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_its_steps_are_those_of_the_reference_vector(name, kind):
    network, vector = designed(name, kind)
    program = program_of(network, vector.step)
    for count, states in vector.early.items():
        found = network.unpack(walked(program, count).words[program.states, 0])
        np.testing.assert_allclose(found, states, rtol=0, atol=1e-12)


def test_it_has_no_operation_that_nothing_reads():
    network, vector = designed("car")
    program = program_of(network, vector.step)
    sums = np.isin(program.operations[:, 0], (0, 4, 5))
    read = {word for _, _, a, b, _ in program.operations[sums] for word in program.sources[a:b]}
    read |= set(program.operations[~sums, 2:4].ravel().tolist())
    written = program.operations[np.isin(program.operations[:, 0], (0, 1, 2, 3)), 1]
    assert set(written.tolist()) <= read


def test_every_word_was_seen_in_its_range():
    network, vector = designed("car")
    program = program_of(network, vector.step)
    ranges = walked(program, vector.steps).ranges(np.arange(1))
    written = program.operations[program.operations[:, 0] != 5, 1]
    assert np.isfinite(ranges.low[written]).all()
    assert (ranges.low[written] <= ranges.high[written]).all()
    assert (ranges.low[program.states] <= network.pack(vector.end) + 1e-9).all()
    assert (ranges.high[program.states] >= network.pack(vector.end) - 1e-9).all()
