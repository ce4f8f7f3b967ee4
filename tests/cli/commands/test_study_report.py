"""The page of a study from the command line."""

import json
import sys

import pytest
from command_line import ROOT, refused, run
from study_pages import IDENTITY, curve, frame

from ann_dc.study.records import Finished
from ann_dc.study.store import Store
from ann_dc.study.stored_trajectories import packed


@pytest.fixture
def study(tmp_path):
    """The folder of a study of 30 points, every other one with curves."""
    table = frame(30)
    rows = [
        {name: None if value != value else value for name, value in row.items()}
        for row in json.loads(table.to_json(orient="records", double_precision=15))
    ]
    with Store.begin(tmp_path / "study", IDENTITY, [*table.columns]) as store:
        for row in rows:
            curves = packed(curve(row["point"])) if row["point"] % 2 else b""
            store.append([Finished(row, curves)])
    return tmp_path / "study"


def test_the_page_of_a_study_lies_in_its_folder_or_where_it_is_asked_for(study, tmp_path):
    code, text = run("report", study)
    assert code == 0
    assert "30 points" in text
    assert f"wrote {study / 'report.html'}" in text
    page = (study / "report.html").read_text(encoding="utf-8")
    assert "Settling of the car on drawn parts" in page
    assert f"ann-dc study {study} --point" in page
    assert "residuals over time" in page
    code, text = run("report", study, "--output", tmp_path / "new" / "page.html", "--quiet")
    assert (code, text) == (0, "")
    assert (tmp_path / "new" / "page.html").read_text(encoding="utf-8") == page


def test_what_is_no_study_is_told(tmp_path, study):
    refused(["report", tmp_path / "nowhere"], "nowhere")
    refused(["report", tmp_path], str(tmp_path))
    refused(["report", study, "--output", ROOT], "is a folder")
    assert not (study / "report.html").exists()


def test_a_missing_package_is_told(study, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    refused(["report", study], "pip install 'ann-dc[study]'")
    assert not (study / "report.html").exists()


def test_a_study_that_is_being_written_has_a_page(study):
    with Store.begin(study, IDENTITY, [*frame(1).columns]):
        assert run("report", study)[0] == 0
