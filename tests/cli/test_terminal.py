"""What a person sees: warnings as notes, progress where there is a terminal."""

import warnings

import pytest

from ann_dc.cli.terminal import notes, progress_line


def test_what_the_library_warns_of_becomes_one_note_a_sentence(capsys):
    with notes():
        for _ in range(2):
            warnings.warn("too\nlong", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "note: too long\n"


def test_other_warnings_stay_what_they_are():
    with pytest.warns(RuntimeWarning, match="overflow"), notes():
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)


def test_where_nobody_reads_progress_is_silent(capsys):
    for quiet in (True, False):
        with progress_line(quiet) as progress:
            progress("a line")
    assert capsys.readouterr() == ("", "")
