"""Numbers of texts, against Python's float and repr."""

import numpy as np
import pytest

from sshade.files.numbers_in_text import Text, rows_of

RNG = np.random.default_rng(0)
DOUBLES = np.concatenate(
    [
        RNG.integers(0, 2**64, 5000, dtype=np.uint64).view(np.float64),
        np.round(100 * RNG.standard_normal(1000), 4),
        [0.0, -0.0, 5e-324, 1.7976931348623157e308, 1e16, 1e-4, np.inf, -np.inf, np.nan],
    ]
)
#: Half way between two doubles, and next to it; the least and greatest; numbers that become zero or infinite.
EDGES = """9007199254740993 9007199254740992.5 9007199254740993.0000000000001 4503599627370496.5
1.7976931348623159e308 2.4703282292062327e-324 2.4703282292062328e-324 1e400 1e-400 .5 5. 0e999
00000000000000000000000000000000000000007 1e00000000000000000000005 -Infinity inf nan"""


@pytest.mark.parametrize("text", [rows_of("", DOUBLES[:, None]).decode(), EDGES, EDGES + " 1_0"])
def test_numbers_are_read_as_by_float(text):
    expected = np.array([float(word) for word in text.split()])
    found = Text(text.encode()).numbers(slice(None)).value
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.array_equal(np.signbit(found), np.signbit(expected))


def test_numbers_are_written_as_by_repr():
    assert rows_of("v ", DOUBLES[:, None]).decode() == "".join(f"v {x!r}\n" for x in DOUBLES.tolist())


@pytest.mark.parametrize("word", [".", "e5", "1e+", "1.2.3", "1-2", "--1", "0x10", "1f", "nan(1)", "1\0"])
def test_words_that_are_no_numbers_are_refused(word):
    with pytest.raises(ValueError, match="is no number"):
        Text(f"7 {word} 8".encode()).numbers(slice(None))


def test_whole_numbers():
    text = Text(b"0 -1 +12 007 123456789012345678 -123456789012345678")
    assert text.integers(text.begin, text.end).tolist() == [int(word) for word in text.data.split()]
    for word in (b"1.0", b"x", b"-", b"- 7", b"1_0", b"1-2", b"1234567890123456789"):
        text = Text(b"5 " + word)
        with pytest.raises(ValueError, match="is no whole number"):
            text.integers(text.begin, text.end)
