"""How a network is to run: options of a backend, and what belongs to another."""

import pytest
from command_line import RECURRENT, refused

from ann_dc.cli.arguments.backends import BACKENDS, RunOptions, backend_of

SHARED = {"ode": ("method", "verify"), "recurrent": ("order", "step", "acceleration")}

"""Fields of a backend that options of the command line set."""


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_options_the_library_decides_how_it_runs(backend):
    built = backend_of(backend, RunOptions())
    expected = type(built)()
    assert all(getattr(built, f) == getattr(expected, f) for f in ("limit", *SHARED[backend]))


BAD = {
    "unknown backend": (["solve", "car", "--backend", "spice"], "ode"),
    "unknown method": (
        ["solve", "car", "--method", "Euler"],
        "compiled, RK23, RK45, DOP853, Radau, BDF",
    ),
    "recurrent method": (["solve", *RECURRENT, "--method", "RK45"], "--method: belongs to"),
    "recurrent verify": (["solve", *RECURRENT, "--verify"], "--verify: belongs to --backend ode"),
    "recurrent no verify": (["solve", *RECURRENT, "--no-verify"], "--no-verify: belongs to"),
    "ode order": (["solve", "car", "--order", "two-phase"], "--order: belongs to"),
    "ode step": (["solve", "car", "--step", "adaptive"], "--step: belongs to"),
    "ode accelerate": (["solve", "car", "--accelerate"], "or add --backend recurrent"),
    "unknown order": (["solve", *RECURRENT, "--order", "x"], "two-phase, stage-by-stage"),
    "step of no time": (["solve", *RECURRENT, "--step", "0"], "--step: expected a positive number"),
    "step that is nan": (["solve", *RECURRENT, "--step", "nan"], "--step: expected a positive"),
    "unknown step": (["solve", *RECURRENT, "--step", "long"], "or adaptive, got 'long'"),
    "half a step": (["solve", *RECURRENT, "--max-steps", "2.5"], "--max-steps"),
    "no steps": (["solve", *RECURRENT, "--max-steps", "0"], "--max-steps"),
    "unknown form": (["solve", "car", "--form", "S99"], "printed-example, S1"),
    "unknown start": (["solve", "car", "--initial-guess", "here"], "line, zero, random"),
    "no limit": (["solve", "car", "--max-settling", "nan"], "--max-settling: expected a positive"),
    "limit of steps": (
        ["solve", "car", "--max-steps", "9"],
        "--max-steps: belongs to --backend rec",
    ),
    "limit of time": (["solve", *RECURRENT, "--max-settling", "9"], "--max-settling: belongs to"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)
