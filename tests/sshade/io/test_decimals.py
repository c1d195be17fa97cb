"""Numbers of texts, against Python's float and repr."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from sshade.io import decimals as module
from sshade.io.decimals import numbers_of, rows_of
from sshade.io.words import array_of, integers_of, words_of

RNG = np.random.default_rng(0)
DOUBLES = {
    "any bits": RNG.integers(0, 2**64, 30000, dtype=np.uint64).view(np.float64),
    "near one": RNG.standard_normal(20000),
    "decimals": np.round(100 * RNG.standard_normal(20000), 4),
    "of all sizes": 10.0 ** RNG.uniform(-320, 308, 20000),
    "whole": RNG.integers(-(10**18), 10**18, 10000).astype(np.float64),
    "powers of two": 2.0 ** np.arange(-1074, 1024),
    "beside powers of two": np.nextafter(2.0 ** np.arange(-1000, 1000), 0.0),
    "powers of ten": np.array([float(f"1e{k}") for k in range(-323, 309)]),
    "subnormal": RNG.integers(1, 2**52, 10000, dtype=np.uint64).view(np.float64),
    "special": np.array([0.0, -0.0, 5e-324, 1.7976931348623157e308, 2.2250738585072014e-308, 1e16, 1e-4]),
    "not finite": np.array([np.inf, -np.inf, np.nan]),
}


def require_same_bits(found, expected) -> None:
    number = ~np.isnan(expected)
    np.testing.assert_array_equal(found[number].view(np.uint64), expected[number].view(np.uint64))
    assert np.isnan(found[~number]).all()


@pytest.mark.parametrize("name", DOUBLES)
def test_doubles_are_written_as_by_repr_and_read_back(name):
    x = DOUBLES[name]
    text = rows_of(b"", x[:, None])
    assert text.split() == [repr(value).encode() for value in x.tolist()]
    data = array_of(text)
    require_same_bits(numbers_of(data, *words_of(data)), x)


def random_decimals(count):
    """Texts of up to 24 digits, with or without a point, a sign and a power of ten."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        digits = "".join(map(str, rng.integers(0, 10, rng.integers(1, 25))))
        point = rng.integers(0, len(digits) + 1)
        word = ("", "-", "+")[rng.integers(3)] + digits[:point] + "." + digits[point:]
        power = f"{'eE'[rng.integers(2)]}{('', '-', '+')[rng.integers(3)]}{rng.integers(0, 340)}"
        yield word + power * int(rng.integers(2))


#: Half way between two doubles, and next to it; the least and greatest; numbers that become zero or infinite.
EDGES = """9007199254740993 9007199254740992.5 9007199254740993.0000000000001 4503599627370496.5
1.7976931348623159e308 2.4703282292062327e-324 2.4703282292062328e-324 1e400 1e-400 .5 5. 0e999
00000000000000000000000000000000000000007 1e00000000000000000000005 1_0 nan -Infinity inf"""


def test_decimals_are_read_as_by_float():
    words = [*random_decimals(20000), *EDGES.split()]
    data = array_of(" ".join(words).encode())
    require_same_bits(numbers_of(data, *words_of(data)), np.array([float(word) for word in words]))


@pytest.mark.parametrize("word", [".", "-", "+.", "e5", "1e", "1e+", "1.2.3", "--1", "0x10", "1f", "1e5.0"])
def test_words_that_are_no_numbers_are_refused(word):
    data = array_of(f"7 {word}".encode())
    with pytest.raises(ValueError, match="could not convert"):
        numbers_of(data, *words_of(data))


def test_whole_numbers():
    words = [b"0", b"-1", b"+12", b"007", b"123456789012345678"]
    data = array_of(b" ".join(words))
    assert integers_of(data, *words_of(data)).tolist() == [int(word) for word in words]
    for word in (b"1.0", b"x", b"-", b"1_0", b"1234567890123456789"):
        with pytest.raises(ValueError, match="is no whole number"):
            integers_of(array_of(word), *words_of(array_of(word)))


def test_the_table_of_powers_is_exact():
    """Each entry is the first 128 bits of the power, rounded down."""
    for e, (high, low) in zip(range(-348, 348), module._POWERS.tolist(), strict=True):
        entry, power = (high << 64) | low, Fraction(10) ** e
        assert entry >> 127 == 1
        size = power.numerator.bit_length() - power.denominator.bit_length()
        scaled = power * Fraction(2) ** (127 - size)
        assert entry == int(scaled if scaled >= 2**127 else 2 * scaled)
