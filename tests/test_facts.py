"""Extraction of figures from documents."""

import pytest
from facts import documentation_of, figures_of, lost


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("error 6.1e-4 relative", [6.1e-4]),
        ("settles after 51.2 us, 3 s", [51.2]),
        ("within 0.05 % or 12%", [12.0]),
        ("10 MHz op amps, 4e-7", [10e0, 4e-7]),
        ("215 op amps, equation (17), N = 36", [215.0]),
        ("version 1.2.0, name_12 s, x12 us", []),
        ("between 1.5 and 2.5 ms", [2.5]),
    ],
)
def test_figures_of_a_line_have_a_unit_or_an_exponent(line, found):
    assert [value for value, _ in figures_of(line)] == found


def test_a_figure_is_lost_if_no_document_has_its_value():
    old = [("a.md", "1.30e-4 and 42 us\n42 us again"), ("b.md", "7.5 %")]
    assert list(lost(old, "1.3e-4, 75")) == [
        ("a.md", "42 us", "1.30e-4 and 42 us"),
        ("b.md", "7.5 %", "7.5 %"),
    ]


def test_only_docstrings_of_a_module_are_read():
    text = '"""A 12 us."""\nx = "13 us"\n\ndef f():\n    """B 14 us."""\n'
    assert documentation_of("a.py", text) == "A 12 us.\nB 14 us."
    assert documentation_of("a.md", text) == text
