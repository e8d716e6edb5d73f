"""Pieces of media files: the same pictures and samples as of the whole, from zero on."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from database.errors import MediaError
from database.media import Piece, probe, read_sound, read_video
from database.piece import piece_of

FPS = 25
FRAMES = 400
RATE = 44100


def picture(i):
    """Planes of frame `i`: a moving pattern."""
    y, x = np.mgrid[:64, :96]
    out = np.full((96, 96), 128, np.uint8)
    out[:64] = 128 + 100 * np.sin(x / 9 + i * 0.2) * np.cos(y / 7 - i * 0.13)
    return out


def write(path, video, sound):
    """A long recording with key frames far apart, and a tone that rises."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(video, rate=FPS)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        stream.codec_context.gop_size = 60
        stream.codec_context.max_b_frames = 2
        audio = container.add_stream(sound, rate=RATE, layout="mono")
        step = RATE // FPS
        for i in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(picture(i), format="yuv420p")
            frame.pts, frame.time_base = i, Fraction(1, FPS)
            container.mux(stream.encode(frame))
            t = (np.arange(step) + i * step) / RATE
            samples = (9000 * np.sin(2 * np.pi * (200 * t + 8 * t * t))).astype(np.int16)[None]
            piece = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
            piece.sample_rate, piece.pts = RATE, i * step
            container.mux(audio.encode(piece))
        container.mux(stream.encode(None))
        container.mux(audio.encode(None))
    return path


@pytest.fixture(scope="module", params=["mp4", "mpg", "mkv", "avi"])
def recording(request, tmp_path_factory):
    """Give a file of each kind, all its frames, and its sound."""
    codecs = {"mp4": ("libx264", "aac"), "mpg": ("mpeg1video", "mp2"), "mkv": ("libx264", "aac")}
    path = tmp_path_factory.mktemp("pieces") / f"a.{request.param}"
    write(path, *codecs.get(request.param, ("mpeg4", "mp2")))
    return path, [f.planes.y for f in read_video(path)], read_sound(path).samples


@pytest.mark.parametrize(("start", "end"), [(0, 2), (0.2, 1), (3.36, 5.0), (9, 9.04), (12, None)])
def test_frames_and_samples_of_a_piece(recording, start, end):
    path, frames, samples = recording
    piece = Piece(path, start, end)
    stop = FRAMES / FPS if end is None else end
    got = list(read_video(piece))
    assert [f.index for f in got] == list(range(round((stop - start) * FPS)))
    assert got[0].time == 0
    for i, frame in enumerate(got):
        np.testing.assert_array_equal(frame.planes.y, frames[round(start * FPS) + i])
    heard = read_sound(piece).samples
    wanted = samples[round(start * 16000) : None if end is None else round(end * 16000)]
    assert abs(len(heard) - len(wanted)) <= 16
    n = min(len(heard), len(wanted)) - 400
    if n > 0:
        # Matroska's time stamps are rounded to milliseconds.
        shifts = [np.abs(heard[k : k + n] - wanted[:n]).max() for k in range(16)]
        shifts += [np.abs(heard[:n] - wanted[k : k + n]).max() for k in range(16)]
        assert min(shifts) < (0.05 if path.suffix == ".mkv" else 0.01)


def test_what_a_piece_is(recording):
    path, _, _ = recording
    info = probe(Piece(path, 3.0, 5.0))
    assert info.duration == pytest.approx(2)
    assert info.frames == 50
    assert info.fps == FPS and info.has_sound
    assert probe(Piece(path, 3.0)).duration == pytest.approx(13)


def test_other_rates_count_from_the_start(recording):
    path, frames, _ = recording
    got = list(read_video(Piece(path, 4.0, 5.0), 50))
    assert len(got) == 50
    for frame in got:
        shown = [round(100 + frame.index / 2 + d) for d in (-0.5, 0, 0.5)]
        assert any((frame.planes.y == frames[k]).all() for k in shown)


def test_pieces_that_are_not_there(recording):
    path, _, _ = recording
    with pytest.raises(MediaError, match=r"ends at 16\.00 s, before the piece that starts at 20"):
        probe(Piece(path, 20))
    with pytest.raises(MediaError, match=r"ends at 16\.00 s, before the end of the piece at 17"):
        next(read_video(Piece(path, 2, 17)))
    for start, end in ((-1, None), (2, 2), (3, 1), (float("nan"), 2), (0, float("nan"))):
        with pytest.raises(MediaError, match="must not be negative") as caught:
            Piece(path, start, end)
        assert "\n" not in str(caught.value)


def test_a_path_is_all_of_a_file():
    assert piece_of("a.mp4") == Piece(Path("a.mp4"))
    assert str(piece_of("a.mp4")) == "a.mp4"
    assert str(Piece(Path("a.mp4"), 1.5, 3)) == "a.mp4 from 1.50 to 3.00 s"
