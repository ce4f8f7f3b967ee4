"""Numbers that a user types, right and wrong."""

import pytest
from command_line import refused

BAD = {
    "no value": (["solve", "car", "--set", "D"], "--set: expected NAME=VALUE"),
    "given twice": (["solve", "car", "-N", "3", "--set", "N=4"], "N: specified twice"),
    "code": (["solve", "car", "--set", "D=__import__('os')"], "D: expected a finite number"),
    "nan": (["solve", "car", "--set", "D=nan"], "D: expected a finite number"),
    "infinite": (["solve", "car", "--q-0", "inf,0,0,0"], "q_0: expected a finite number"),
    "too many": (["solve", "car", "--q-d", "1,2,3,4,5"], "q_d: expected 4 numbers"),
    "some start": (
        ["solve", "car", "--q-0", "any,0,0,0"],
        "q_0: expected a finite number, or free",
    ),
    "free speed": (["solve", "car", "--set", "D=free"], "D: expected a finite number, got 'free'"),
    "two steps": (["show", "car_free_time", "--set", "dt=1,2"], "dt: expected a finite number"),
    "half a stage": (["solve", "car", "--set", "N=2.5"], "N: expected a whole number"),
    "huge": (["solve", "car", "--q-d", "1e300,1,0,0"], "q_d: 1e300 is too large"),
    "huge wheel base": (["solve", "car", "--set", "D=-1e300"], "D: -1e300 is too large"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)
