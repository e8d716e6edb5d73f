"""Pictures to bytes and back."""

import itertools
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from database.errors import DatabaseError
from database.pictures import CODECS, DEFAULT_CODEC, codec_for, decode, encode, find_codec
from database.reader import open_database

SMALL = {"sequences": 2, "frames": 30, "crop": (20, 22)}


@pytest.fixture(scope="module")
def face(portrait):
    return portrait[100:180, 200:290].copy()


def test_png_gives_back_the_very_picture(face):
    assert CODECS["png"].lossless
    assert np.array_equal(decode(encode(face)), face)


def test_png_takes_pictures_that_are_not_contiguous(face):
    assert np.array_equal(decode(encode(face[::2, ::-1])), face[::2, ::-1])


LOSSY = [name for name, codec in CODECS.items() if not codec.lossless]


@pytest.mark.parametrize("codec", LOSSY)
def test_a_lossy_codec_is_near_and_keeps_the_order_of_colours(face, codec):
    data = encode(face, codec)
    back = decode(data, codec)
    assert back.shape == face.shape and back.dtype == np.uint8
    assert psnr(back, face) > 36
    assert psnr(back[..., ::-1], face) < psnr(back, face) - 10
    assert len(data) < len(encode(face)) / 2


def psnr(a, b):
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2))


@pytest.mark.parametrize("codec", LOSSY)
def test_quality_trades_bytes_for_likeness(face, codec):
    sizes, likeness = [], []
    for quality in (30, 60, 98):
        data = encode(face, f"{codec}:{quality}")
        sizes.append(len(data))
        likeness.append(psnr(decode(data, codec), face))
    assert sizes == sorted(sizes) and sizes[-1] > 2 * sizes[0]
    assert likeness == sorted(likeness) and likeness[-1] > 40
    usual = CODECS[codec].quality
    assert encode(face, codec) == encode(face, f"{codec}:{usual}")
    # Decoding asks for no quality: it is in the data.
    assert np.array_equal(decode(data, codec), decode(data, f"{codec}:7"))


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (93, 88), (31, 64)])
@pytest.mark.parametrize("codec", CODECS)
def test_pictures_of_any_size_come_back_at_their_size(face, codec, size):
    picture = np.resize(face, (*size, 3))
    assert decode(encode(picture, codec), codec).shape == picture.shape


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("png:3", "'png:3': png loses nothing and has no quality; write png"),
        ("avif:0", "'avif:0': the quality must be 1 to 100, as in avif:85"),
        ("avif:", "the quality must be 1 to 100"),
        ("jpeg:101", "the quality must be 1 to 100"),
        ("webp:9.5", "the quality must be 1 to 100"),
        ("webp:-1", "the quality must be 1 to 100"),
        ("jpeg:٣", "the quality must be 1 to 100"),
        (":85", "no codec is named ':85'"),
        ("", "no codec is named ''"),
    ],
)
def test_a_codec_that_cannot_be_is_refused(name, said):
    with pytest.raises(DatabaseError, match=re.escape(said)):
        find_codec(name)


def test_the_default_is_one_of_them():
    assert find_codec(DEFAULT_CODEC).name in CODECS


@pytest.mark.parametrize("codec", CODECS)
def test_threads_do_not_change_a_byte(face, codec):
    pictures = [np.roll(face, k, axis=1) for k in range(12)]
    alone = [encode(p, codec) for p in pictures]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda p: encode(p, codec), pictures)) == alone


@pytest.mark.parametrize("codec", ["avif:60", "jpeg:80", "webp"])
def test_a_database_of_a_codec_is_read_back_or_refused(makedb, tmp_path, codec):
    """Decoders accept much that is damaged; the file's own checksums do not."""
    path = makedb.make_database(tmp_path / "a.h5", codec=codec, **SMALL)
    with open_database(path) as db:
        assert db.codec == codec
        right = db.pictures(slice(None))
    data = path.read_bytes()
    begin = data.index(find_codec(codec).signature[0][1])
    rng = np.random.default_rng(0)
    refused = 0
    for place in rng.integers(begin, begin + 2000, 12).tolist():
        damaged = bytearray(data)
        damaged[place] ^= 1 << rng.integers(8)
        (tmp_path / "b.h5").write_bytes(damaged)
        try:
            with open_database(tmp_path / "b.h5") as db:
                assert np.array_equal(db.pictures(slice(None)), right)
        except DatabaseError:
            refused += 1
    assert refused >= 10


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
    with pytest.raises(DatabaseError, match="'bmp'; choose one of: avif, jpeg, png, webp"):
        call()


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("data", [b"", b"\0" * 100, b"GIF89a" + b"\0" * 40, b"\x89PNG\r\n\x1a\n"])
def test_other_data_is_refused(codec, data):
    with pytest.raises(DatabaseError, match=codec):
        decode(data, codec)


def test_one_codec_does_not_decode_the_other(face):
    for one, other in itertools.permutations(CODECS, 2):
        with pytest.raises(DatabaseError, match=f"do not begin as a {other} picture"):
            decode(encode(face, one), other)


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


def test_small_mouths_lose_nothing_and_large_ones_little():
    assert codec_for(88, 93) == "png"
    assert codec_for(288, 304) == DEFAULT_CODEC
