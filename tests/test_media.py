"""Video and sound in: times, rates, colours, damage."""

import os
import wave
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from database.errors import MediaError
from database.media import probe, probe_sound_duration, read_sound, read_video, snap_rate
from database.planes import Colour, Planes, planes_to_rgb, rgb_to_planes
from database.video_writer import VideoWriter

BESIDE = Path(__file__).parents[2] / "shared" / "corpus" / "grid-s1" / "build"
CORPUS = Path(os.environ.get("UNITSEL_CORPUS") or BESIDE)

STEP = 5
"""Levels of luma from one numbered frame to the next."""


def numbered(i, width=64, height=48):
    """Flat planes whose luma tells the frame's number."""
    half = (height // 2, width // 2)
    y = np.full((height, width), 30 + STEP * i, np.uint8)
    return Planes(y, np.full(half, 128, np.uint8), np.full(half, 128, np.uint8))


def number(frame):
    return round((float(frame.planes.y.mean()) - 30) / STEP)


def write_numbered(path, n, fps=25, sound=None):
    with VideoWriter(path, 64, 48, fps, sound) as video:
        for i in range(n):
            video.write_planes(numbered(i))
    return path


def write_raw(
    path, stamps, *, codec="mpeg4", pix_fmt="yuv420p", size=(64, 48), pixels=None, tags=()
):
    """Frames at given times in milliseconds, through PyAV alone."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = *size, pix_fmt
        stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        for name, value in tags:
            setattr(stream, name, value)
        for i, stamp in enumerate(stamps):
            if pixels is None:
                frame = av.VideoFrame.from_ndarray(numbered(i, *size).packed(), format="yuv420p")
            else:
                frame = av.VideoFrame.from_ndarray(pixels, format=pix_fmt)
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_wav(path, samples, rate):
    pcm = (np.atleast_2d(samples) * 32767).astype("<i2").T
    with wave.open(str(path), "wb") as file:
        file.setnchannels(pcm.shape[1])
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes(np.ascontiguousarray(pcm).tobytes())
    return path


def click(rate, at, length):
    samples = np.zeros(int(length * rate), np.float32)
    samples[int(at * rate) : int((at + 0.01) * rate)] = 0.9
    return samples


def onset(sound):
    return float(np.argmax(np.abs(sound.samples) > 0.3)) / sound.rate


def test_frames_come_in_order_with_times(tmp_path):
    frames = list(read_video(write_numbered(tmp_path / "a.mp4", 20)))
    assert [number(f) for f in frames] == list(range(20))
    assert [f.index for f in frames] == list(range(20))
    assert [f.time for f in frames] == pytest.approx([i / 25 for i in range(20)])
    assert frames[0].rgb.shape == (48, 64, 3)
    assert frames[0].rgb.dtype == np.uint8


def test_probe_tells_what_is_there(tmp_path):
    path = write_numbered(tmp_path / "a.mp4", 20, 29.97)
    info = probe(path)
    assert (info.width, info.height, info.frames) == (64, 48, 20)
    assert info.fps == 30000 / 1001
    assert info.duration == pytest.approx(20 * 1001 / 30000)
    assert not info.has_sound
    assert info.sound_rate is None


@pytest.mark.parametrize(
    ("own", "asked", "shown"),
    [
        (25, 50, [0, 0, 1, 1, 2, 2, 3, 3]),
        (50, 25, [0, 2]),
        (25, 25, [0, 1, 2, 3]),
        (30, 25, [0, 1, 2]),
        (25, 30, [0, 1, 2, 2, 3]),
    ],
)
def test_other_rates_take_the_nearest_frame(tmp_path, own, asked, shown):
    path = write_numbered(tmp_path / "a.mp4", 4, own)
    frames = list(read_video(path, asked))
    assert [number(f) for f in frames] == shown
    assert [f.time for f in frames] == pytest.approx([i / asked for i in range(len(shown))])


def test_variable_rate_is_conformed(tmp_path):
    # The frames of 120 and 160 ms are missing, and the rest is a few milliseconds off.
    path = write_raw(tmp_path / "a.mkv", [0, 43, 78, 201, 239, 280, 321, 362, 400])
    frames = list(read_video(path, 25))
    assert [number(f) for f in frames] == [0, 1, 2, 2, 3, 3, 4, 5, 6, 7, 8]


def test_times_count_from_the_first_frame(tmp_path):
    path = write_raw(tmp_path / "a.mkv", [500, 540, 580, 620])
    assert [number(f) for f in read_video(path)] == [0, 1, 2, 3]


def test_a_leaping_clock_does_not_repeat_a_frame_for_hours(tmp_path):
    path = write_raw(tmp_path / "a.mkv", [0, 40, 80, 7_200_000, 7_200_040])
    assert [number(f) for f in read_video(path, 25)] == [0, 1, 2, 3, 4]


def test_odd_sizes_lose_a_row_and_a_column(tmp_path):
    pixels = np.full((47, 63, 3), 200, np.uint8)
    path = write_raw(
        tmp_path / "a.mkv",
        [0, 40],
        codec="ffv1",
        pix_fmt="bgra",
        size=(63, 47),
        pixels=np.dstack([pixels, pixels[..., :1]]),
    )
    info = probe(path)
    frame = next(read_video(path))
    assert (info.width, info.height) == (62, 46)
    assert frame.rgb.shape == (46, 62, 3)
    assert np.abs(frame.rgb.astype(int) - 200).max() <= 1


SKIN = (200, 140, 110)


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
@pytest.mark.parametrize("full", [False, True])
def test_colour_tags_are_written_and_heeded(tmp_path, matrix, full):
    colour = Colour(matrix, full, 1, 1)
    path = tmp_path / "a.mp4"
    with VideoWriter(path, 64, 48, 25, colour=colour, crf=1) as video:
        video.write_rgb(np.full((48, 64, 3), SKIN, np.uint8))
    assert probe(path).colour == colour
    seen = next(read_video(path)).rgb.reshape(-1, 3).mean(axis=0)
    assert seen == pytest.approx(SKIN, abs=2)


@pytest.mark.parametrize(
    ("pix_fmt", "codec", "scale"),
    [
        ("yuv422p", "ffv1", 1),
        ("yuv444p", "ffv1", 1),
        ("yuv420p10le", "ffv1", 4),
        ("yuvj422p", "mjpeg", 1),
    ],
)
def test_other_formats_become_planes_of_the_same_colour(tmp_path, pix_fmt, codec, scale):
    full = pix_fmt.startswith("yuvj")
    colour = Colour("bt601", full)
    yuv = colour.from_rgb @ np.array(SKIN, np.float32) + colour.offset
    frame = av.VideoFrame(64, 48, pix_fmt)
    dtype = np.uint16 if scale > 1 else np.uint8
    for plane, level in zip(frame.planes, yuv, strict=True):
        size = plane.buffer_size // np.dtype(dtype).itemsize
        plane.update(np.full(size, round(float(level) * scale), dtype).tobytes())
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pix_fmt
        stream.color_range = 2 if full else 1
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    assert probe(path).colour.full_range is full
    read = next(read_video(path))
    for plane, level in zip((read.planes.y, read.planes.u, read.planes.v), yuv, strict=True):
        assert float(plane.mean()) == pytest.approx(float(level), abs=1.2)
    assert read.rgb.reshape(-1, 3).mean(axis=0) == pytest.approx(SKIN, abs=3)


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
@pytest.mark.parametrize("full", [False, True])
def test_planes_and_rgb_are_each_others_inverse(matrix, full):
    colour = Colour(matrix, full)
    rng = np.random.default_rng(1)
    blocks = rng.integers(40, 216, (24, 32, 3)).astype(np.uint8).repeat(2, 0).repeat(2, 1)
    planes = rgb_to_planes(blocks, colour)
    again = planes_to_rgb(planes, colour)
    assert np.abs(again.astype(int) - blocks).max() <= 3
    assert abs((again.astype(int) - blocks).mean()) < 0.1
    back = rgb_to_planes(again, colour)
    for a, b in ((planes.y, back.y), (planes.u, back.u), (planes.v, back.v)):
        assert np.abs(a.astype(int) - b).max() <= 1


def test_grey_stays_grey_in_planes():
    planes = rgb_to_planes(np.full((4, 4, 3), 255, np.uint8), Colour("bt709"))
    assert (planes.y[0, 0], planes.u[0, 0], planes.v[0, 0]) == (235, 128, 128)


def test_a_truncated_file_gives_what_decodes(tmp_path):
    whole = write_raw(tmp_path / "whole.mkv", range(0, 1600, 40)).read_bytes()
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    frames = list(read_video(cut))
    assert 5 < len(frames) < 40
    assert [number(f) for f in frames][:5] == [0, 1, 2, 3, 4]


def test_damage_in_the_middle_keeps_later_frames_in_time(tmp_path):
    path = write_raw(tmp_path / "a.mkv", range(0, 1600, 40), codec="ffv1", tags=[("gop_size", 1)])
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle - 30 : middle + 30] = bytes(60)
    path.write_bytes(data)
    frames = list(read_video(path, 25))
    shown = [number(f) for f in frames]
    assert shown != list(range(40))
    assert len(frames) == 40
    assert shown[:10] == list(range(10))
    assert shown[-10:] == list(range(30, 40))


@pytest.mark.parametrize("read", [probe, read_sound, lambda p: next(read_video(p))])
def test_what_is_no_media_file_is_named(tmp_path, read):
    text = tmp_path / "words.txt"
    text.write_text("bin blue at f two now\n")
    noise = tmp_path / "noise.mp4"
    noise.write_bytes(np.random.default_rng(0).bytes(5000))
    empty = tmp_path / "empty.mpg"
    empty.touch()
    half = tmp_path / "half.mp4"
    half.write_bytes(write_numbered(tmp_path / "a.mp4", 20).read_bytes()[:400])
    for path in (text, noise, empty, half, tmp_path, tmp_path / "missing.mp4"):
        with pytest.raises(MediaError) as caught:
            read(path)
        message = str(caught.value)
        assert str(path) in message
        assert "\n" not in message


def test_video_without_sound_and_sound_without_video(tmp_path):
    silent = write_numbered(tmp_path / "a.mp4", 3)
    with pytest.raises(MediaError, match="holds no sound"):
        read_sound(silent)
    voice = write_wav(tmp_path / "a.wav", click(16000, 0.5, 1), 16000)
    with pytest.raises(MediaError, match="holds no video"):
        probe(voice)
    with pytest.raises(MediaError, match="holds no video"):
        next(read_video(voice))


@pytest.mark.parametrize("rate", [8000, 16000, 44100, 48000])
def test_wav_is_read_at_the_rate_asked_for(tmp_path, rate):
    path = write_wav(tmp_path / "a.wav", click(rate, 0.5, 1.25), rate)
    sound = read_sound(path)
    assert sound.rate == 16000
    assert sound.samples.dtype == np.float32
    assert sound.duration == pytest.approx(1.25, abs=0.002)
    assert onset(sound) == pytest.approx(0.5, abs=0.001)
    assert read_sound(path, None).rate == rate
    assert probe_sound_duration(path) == pytest.approx(1.25, abs=1e-3)


def test_channels_are_mixed(tmp_path):
    one = click(16000, 0.25, 1)
    path = write_wav(tmp_path / "a.wav", np.stack([one, 0 * one]), 16000)
    assert float(read_sound(path).samples.max()) == pytest.approx(0.45, abs=0.02)


@pytest.mark.parametrize("start", [0, 200, -120])
def test_sound_counts_from_the_first_frame(tmp_path, start):
    """Sound whose stream starts later or earlier than the picture's."""
    rate = 48000
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        audio = container.add_stream("pcm_s16le", rate=rate)
        audio.codec_context.layout = "mono"
        for i in range(25):
            frame = av.VideoFrame.from_ndarray(numbered(i).packed(), format="yuv420p")
            frame.pts, frame.time_base = i * 40 + 200, Fraction(1, 1000)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        pcm = (click(rate, 0.5, 1) * 32767).astype(np.int16)
        for place in range(0, rate, 1200):
            chunk = pcm[None, place : place + 1200]
            frame = av.AudioFrame.from_ndarray(chunk, format="s16", layout="mono")
            frame.sample_rate = rate
            frame.pts = place + (200 + start) * rate // 1000
            frame.time_base = Fraction(1, rate)
            container.mux(audio.encode(frame))
        container.mux(audio.encode(None))
    assert onset(read_sound(path)) == pytest.approx(0.5 + start / 1000, abs=0.002)
    assert read_sound(path).duration == pytest.approx(1 + start / 1000, abs=0.003)


def test_rates_are_snapped():
    assert snap_rate(29.97) == Fraction(30000, 1001)
    assert snap_rate(59.94) == Fraction(60000, 1001)
    assert snap_rate(23.976) == Fraction(24000, 1001)
    assert snap_rate(30) == 30
    assert snap_rate(12.5) == Fraction(25, 2)
    for bad in (0, -25, float("nan"), float("inf"), 1e6):
        with pytest.raises(MediaError, match="frame rate"):
            snap_rate(bad)


@pytest.mark.skipif(not (CORPUS / "bbaf2n.mpg").is_file(), reason=f"no GRID clips in {CORPUS}")
def test_mpeg1_that_contradicts_itself_about_its_rate():
    info = probe(CORPUS / "bbaf2n.mpg")  # Its mean rate is stated as 50.
    assert (info.fps, info.frames, info.duration) == (25.0, 75, 3.0)
    assert (info.width, info.height, info.sound_rate) == (360, 288, 44100)
    assert sum(1 for _ in read_video(CORPUS / "bbaf2n.mpg")) == 75
    assert 2.9 < read_sound(CORPUS / "bbaf2n.mpg").duration < 3.05
