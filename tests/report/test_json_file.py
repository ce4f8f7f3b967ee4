"""Strict JSON, the whole file or nothing, and room for it before a long run."""

import json

import numpy as np
import pytest

from ann_dc.errors import OutputError
from ann_dc.report.json_file import make_room, write_json


def test_numbers_that_json_does_not_know_become_null(tmp_path):
    file = tmp_path / "result.json"
    write_json(file, {"a": float("nan"), 2: [np.float64("inf"), np.int64(3)], "c": (1.5, None)})
    assert json.loads(file.read_text()) == {"a": None, "2": [None, 3], "c": [1.5, None]}


def test_room_is_made_in_a_new_folder_and_not_on_a_folder(tmp_path):
    make_room(None)
    make_room(tmp_path / "new" / "result.json")
    assert (tmp_path / "new").is_dir()
    with pytest.raises(OutputError, match="is a folder; use a file"):
        make_room(tmp_path)
