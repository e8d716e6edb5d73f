"""Pictures to bytes and back."""

import numpy as np
import pytest

from database.errors import DatabaseError
from database.pictures import CODECS, decode, encode


@pytest.fixture(scope="module")
def face(portrait):
    return portrait[100:180, 200:290].copy()


def test_png_gives_back_the_very_picture(face):
    assert CODECS["png"].lossless
    assert np.array_equal(decode(encode(face)), face)


def test_png_takes_pictures_that_are_not_contiguous(face):
    assert np.array_equal(decode(encode(face[::2, ::-1])), face[::2, ::-1])


def test_webp_is_near_and_keeps_the_order_of_colours(face):
    data = encode(face, "webp")
    back = decode(data, "webp")
    assert back.shape == face.shape and back.dtype == np.uint8
    error = np.mean((back.astype(float) - face) ** 2)
    assert 10 * np.log10(255**2 / error) > 36
    swapped = np.mean((back[..., ::-1].astype(float) - face) ** 2)
    assert swapped > 10 * error
    assert len(data) < len(encode(face)) / 2


def test_encoding_is_repeatable(face):
    for codec in CODECS:
        assert encode(face, codec) == encode(face, codec)


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((4, 5), np.uint8),
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((4, 5, 3), np.float32),
        np.zeros((0, 5, 3), np.uint8),
    ],
)
def test_what_is_no_rgb_picture_is_refused(picture):
    with pytest.raises(DatabaseError, match="must be \\(height, width, 3\\) uint8"):
        encode(picture)


@pytest.mark.parametrize("call", [lambda: encode(np.zeros((2, 2, 3), np.uint8), "bmp"),
                                  lambda: decode(b"BM", "bmp")])  # fmt: skip
def test_an_unknown_codec_is_named_with_the_known_ones(call):
    with pytest.raises(DatabaseError, match="'bmp'; choose one of: png, webp"):
        call()


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("data", [b"", b"\0" * 100, b"GIF89a" + b"\0" * 40, b"\x89PNG\r\n\x1a\n"])
def test_other_data_is_refused(codec, data):
    with pytest.raises(DatabaseError, match=codec):
        decode(data, codec)


def test_one_codec_does_not_decode_the_other(face):
    with pytest.raises(DatabaseError):
        decode(encode(face, "webp"), "png")
    with pytest.raises(DatabaseError):
        decode(encode(face, "png"), "webp")


@pytest.mark.parametrize("codec", CODECS)
def test_a_picture_cut_short_is_refused(face, codec):
    data = encode(face, codec)
    for length in np.linspace(1, len(data) - 1, 25).astype(int):
        with pytest.raises(DatabaseError):
            decode(data[:length], codec)


def test_a_damaged_png_is_refused_or_right(face):
    data = encode(face)
    rng = np.random.default_rng(0)
    refused = 0
    for byte in rng.integers(len(data), size=200):
        damaged = bytearray(data)
        damaged[byte] ^= 1 << rng.integers(8)
        try:
            assert np.array_equal(decode(bytes(damaged)), face)
        except DatabaseError:
            refused += 1
    assert refused > 190
