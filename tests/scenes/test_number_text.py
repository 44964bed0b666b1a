"""Laws of numbers in files: what is read is what every reader of the format reads, and anything else is refused."""

import numpy as np
import pytest

from hdplan.scenes.number_text import read_number, read_numbers, read_whole


def test_printed_numbers_read_back_bit_for_bit() -> None:
    rng = np.random.default_rng(0)
    for value in rng.normal(size=200) * 10.0 ** rng.integers(-300, 300, size=200):
        assert read_number(repr(float(value))) == value
        assert read_number(f"{value:+.17E}") == value
    assert read_numbers(["1.", ".5", "-2e3", "007"]) == (1.0, 0.5, -2000.0, 7.0)
    assert [read_whole(word) for word in ("0", "-3", "+12")] == [0, -3, 12]


NONE = ["1_0", "١٢", "１", "inf", "nan", "0x10", "1e", ".", "", " 1", "1 ", "1,5", "--1", "1f"]


@pytest.mark.parametrize("word", NONE)
def test_words_that_other_readers_refuse_are_refused(word: str) -> None:
    with pytest.raises(ValueError, match="is not a number"):
        read_number(word)
    with pytest.raises(ValueError, match="is not a whole number"):
        read_whole(word)


@pytest.mark.parametrize("word", ["1.0", "1e3", "9" * 19])
def test_a_whole_number_has_no_point_and_fits_in_memory(word: str) -> None:
    with pytest.raises(ValueError, match="is not a whole number"):
        read_whole(word)
