"""The kinds of item."""

from pipeline.world.symbols import SYMBOLS


def test_the_four_kinds_of_the_paper_keep_their_order():
    assert SYMBOLS[:4] == ("bowl", "plate", "cutlery", "glass")
