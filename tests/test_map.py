"""ann_dc/README.md says what is there."""

import gallery
import rooms


def test_the_map_is_up_to_date():
    """`python tests/rooms.py --write` renews it."""
    assert rooms.README.read_text(encoding="utf-8") == rooms.readme()


def test_every_room_is_on_the_map():
    places = {file.parent for file in rooms.PACKAGE.glob("*/__init__.py")}
    places |= {*rooms.PACKAGE.glob("[a-z]*.py")}
    assert places == {*rooms.rooms()}


def test_the_gallery_is_up_to_date():
    """`python tests/gallery.py --write` renews it."""
    assert gallery.README.read_text(encoding="utf-8") == gallery.readme()
