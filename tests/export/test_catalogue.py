"""The catalogue of formats, and the page that lists them."""

import formats_page


def test_the_page_lists_every_format():
    """`python tests/formats_page.py --write` renews it."""
    assert formats_page.written() == formats_page.table()
