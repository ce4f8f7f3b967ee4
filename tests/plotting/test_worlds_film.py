"""A film is a GIF with a frame a control period."""

import pytest
from journeys import a_journey
from PIL import Image

from ann_dc.errors import OutputError
from ann_dc.plotting.worlds import film


def test_a_frame_a_period(tmp_path):
    driven = a_journey()
    film(driven, tmp_path / "way.gif")
    with Image.open(tmp_path / "way.gif") as image:
        assert image.format == "GIF"
        assert image.n_frames == driven.u.shape[1]


def test_a_file_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OutputError):
        film(a_journey(), tmp_path)
