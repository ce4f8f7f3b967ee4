"""Numbers of netlists, as SPICE reads them."""

import pytest

from ann_dc.backends.spice.ngspice.expressions import value_of
from ann_dc.errors import FileFormatError


@pytest.mark.parametrize(
    ("text", "known", "value"),
    [
        ("10k", {}, 1e4),
        ("2.5meg", {}, 2.5e6),
        ("0.1p", {}, 1e-13),
        ("-1e-3", {}, -1e-3),
        ("5m", {}, 5e-3),
        ("{r*(1+e)}", {"r": 10.0, "e": 0.5}, 15.0),
        ("{50/(6.283185307*gbw*c)}", {"gbw": 1e7, "c": 1e-11}, 50 / (6.283185307e-4)),
        ("{max(abs(lo),abs(hi))**2}", {"lo": -3.0, "hi": 2.0}, 9.0),
        ("{1m*2k}", {}, 2.0),
        ("{ln(1)+sqrt(4)-min(1,2)}", {}, 1.0),
    ],
)
def test_a_number(text, known, value):
    assert value_of(text, known) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        *("abc", "{", "{}", "{1", "{a}", "{__import__('os')}", "{(1).real}", "{[1][0]}", "{1/0}"),
        *(
            "{10**10**10}",
            "{ln(-1)}",
            "{f(1)}",
            "{'a'*9}",
            "{" + "(" * 500 + "}",
            "{" + "1+" * 2000,
        ),
        *("{" + "-" * 1500 + "1}", "{max(x=1)}", "{lambda: 1}", "{2<3}"),
    ],
)
def test_what_is_none_is_refused(text):
    with pytest.raises(FileFormatError, match="netlist: "):
        value_of(text, {})
