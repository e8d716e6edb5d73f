"""Codecs, containers, transparency, sound that is taken over, tags, and disks that fill up."""

from __future__ import annotations

import json
import resource
import signal
import wave
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from database.errors import MediaError
from database.media import probe, read_sound, read_video
from database.planes import Planes
from database.sound import Sound, sound_format
from database.sound_out import SoundQueue
from database.video_codecs import CONTAINERS
from database.video_writer import VideoWriter

FPS = 25
CHOICES = [(suffix, codec) for suffix, kind in CONTAINERS.items() for codec in kind.codecs]
CLEAR = [(suffix, codec) for suffix, kind in CONTAINERS.items() for codec in kind.alpha]


def picture(i: int, width: int = 64, height: int = 48) -> Planes:
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    luma = (120 + 60 * np.sin(x / 7 + i / 3) * np.cos(y / 9)).astype(np.uint8)
    chroma = np.full((height // 2, width // 2), 110, np.uint8)
    return Planes(luma, chroma, chroma + 30)


def clicks(times: list[float], length: float, rate: int = 48000) -> Sound:
    samples = np.zeros(int(length * rate), np.float32)
    for time in times:
        samples[int(time * rate) : int((time + 0.004) * rate)] = 0.9
    return Sound(samples, rate)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    error = np.mean((a.astype(np.float64) - b) ** 2)
    return float(10 * np.log10(255**2 / max(error, 1e-9)))


@pytest.mark.parametrize(("suffix", "codec"), CHOICES)
def test_every_codec_keeps_picture_and_time(tmp_path: Path, suffix: str, codec: str) -> None:
    path = tmp_path / f"a{suffix}"
    with VideoWriter(path, 64, 48, 29.97, clicks([0.2, 0.8], 1.0), codec=codec) as video:
        for i in range(30):
            video.write_planes(picture(i))
    back = list(read_video(path))
    assert len(back) == 30
    assert probe(path).fps == pytest.approx(30000 / 1001, rel=1e-4)
    assert min(psnr(f.planes.y, picture(i).y) for i, f in enumerate(back)) > 36
    heard = read_sound(path, 48000).samples
    loud = np.flatnonzero(np.abs(heard) > 0.3) / 48000
    assert loud[0] == pytest.approx(0.2, abs=0.004)
    assert loud[loud > 0.5][0] == pytest.approx(0.8, abs=0.004)


def test_quality_is_what_is_asked_for(tmp_path: Path) -> None:
    sizes = []
    for crf in (10, 30):
        with VideoWriter(tmp_path / "a.webm", 64, 48, 25, crf=crf) as video:
            for i in range(10):
                video.write_planes(picture(i))
        sizes.append((tmp_path / "a.webm").stat().st_size)
    assert sizes[0] > 1.3 * sizes[1]


@pytest.mark.parametrize(("suffix", "codec"), CLEAR)
def test_alpha_and_colour_come_back(tmp_path: Path, suffix: str, codec: str) -> None:
    path = tmp_path / f"a{suffix}"
    rgba = np.zeros((48, 64, 4), np.uint8)
    rgba[..., :3] = (200, 120, 90)
    rgba[12:36, 16:48, 3] = 255
    with VideoWriter(path, 64, 48, 25, alpha=True, codec=codec) as video:
        for _ in range(5):
            video.write_rgba(rgba)
    decoder = "libvpx-vp9" if codec == "vp9" else None  # FFmpeg's own knows no alpha.
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        if decoder is None:
            frames = list(container.decode(stream))
        else:
            context = av.CodecContext.create(decoder, "r")
            frames = [f for p in container.demux(stream) if p.size for f in context.decode(p)]
    assert len(frames) == 5
    back = frames[-1].to_ndarray(format="rgba").astype(int)
    assert np.abs(back[..., 3] - rgba[..., 3])[:, ::2].mean() < 2
    assert np.abs(back[16:32, 20:44, :3] - rgba[16:32, 20:44, :3]).max() <= 6


def packets(path: Path) -> list[bytes]:
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        return [bytes(p) for p in container.demux(stream) if p.size]


def recorded(path: Path, encoder: str, length: float) -> Path:
    """Write a sound file, compressed."""
    sound = clicks([0.2, 1.2, 2.2], length)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(encoder, rate=48000)
        stream.codec_context.layout = "mono"
        step = 960
        for i in range(0, len(sound.samples) // step * step, step):
            frame = av.AudioFrame.from_ndarray(
                sound.samples[None, i : i + step], format="fltp", layout="mono"
            )
            frame.sample_rate, frame.pts = 48000, i
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("name", "encoder", "suffix"),
    [
        ("s.m4a", "aac", ".mp4"),
        ("s.mp3", "libmp3lame", ".mp4"),
        ("s.opus", "libopus", ".mp4"),
        ("s.opus", "libopus", ".webm"),
        ("s.flac", "flac", ".mkv"),
    ],
)
def test_sound_is_muxed_untouched(tmp_path: Path, name: str, encoder: str, suffix: str) -> None:
    source = recorded(tmp_path / name, encoder, 3.0)
    path = tmp_path / f"a{suffix}"
    with VideoWriter(path, 64, 48, 59.94, source) as video:
        assert video.copies_sound
        for i in range(120):
            video.write_planes(picture(i))
    kept, given = packets(path), packets(source)
    n = len(kept)
    assert 0.6 * len(given) < n < 0.75 * len(given)  # The video ends after 2 of 3 seconds.
    first = next(i for i, p in enumerate(given) if p == kept[0])
    assert first <= 1
    assert kept == given[first : first + n]
    loud = np.flatnonzero(np.abs(read_sound(path, 48000).samples) > 0.3) / 48000
    assert loud[0] == pytest.approx(0.2, abs=0.5 / 59.94)
    assert loud[loud > 1][0] == pytest.approx(1.2, abs=0.5 / 59.94)


def test_sound_that_the_container_does_not_take_is_encoded(tmp_path: Path) -> None:
    source = recorded(tmp_path / "s.m4a", "aac", 1.0)
    with VideoWriter(tmp_path / "a.webm", 64, 48, 25, source) as video:
        assert not video.copies_sound
        for i in range(25):
            video.write_planes(picture(i))
    with av.open(str(tmp_path / "a.webm")) as container:
        assert container.streams.audio[0].codec_context.name == "opus"
    loud = np.flatnonzero(np.abs(read_sound(tmp_path / "a.webm", 48000).samples) > 0.3) / 48000
    assert loud[0] == pytest.approx(0.2, abs=0.005)


def test_a_wave_file_keeps_its_channel_and_level(tmp_path: Path) -> None:
    """Such files say only how many channels they have; one is mono, not half of stereo."""
    rate = 22050
    tone = 0.5 * np.sin(2 * np.pi * 440 * np.arange(rate) / rate)
    with wave.open(str(tmp_path / "s.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((tone * 32767).astype("<i2").tobytes())
    with VideoWriter(tmp_path / "a.mp4", 64, 48, 25, tmp_path / "s.wav") as video:
        for i in range(25):
            video.write_planes(picture(i))
    assert sound_format(tmp_path / "a.mp4") == (rate, "mono")
    back = read_sound(tmp_path / "a.mp4", None).samples[2000:20000]
    assert np.std(back) == pytest.approx(np.std(tone), rel=0.02)


def test_sound_of_a_video_counts_from_its_first_picture(tmp_path: Path) -> None:
    """A file whose picture begins half a second after its sound."""
    source = tmp_path / "late.mkv"
    with av.open(str(source), "w") as container:
        video = container.add_stream("libx264", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = container.add_stream("aac", rate=48000)
        sound.codec_context.layout = "mono"
        samples = clicks([0.7, 1.5], 2.0).samples
        for i in range(0, len(samples) // 1024 * 1024, 1024):
            part = av.AudioFrame.from_ndarray(samples[None, i : i + 1024], "fltp", "mono")
            part.sample_rate, part.pts = 48000, i
            container.mux(sound.encode(part))
        for i in range(30):
            frame = av.VideoFrame.from_ndarray(picture(i).packed(), format="yuv420p")
            frame.pts, frame.time_base = 12 + i, Fraction(1, 25)
            container.mux(video.encode(frame))
        container.mux(sound.encode(None))
        container.mux(video.encode(None))
    path = tmp_path / "a.mp4"
    with VideoWriter(path, 64, 48, 25, source) as writer:
        assert writer.copies_sound
        for i in range(40):
            writer.write_planes(picture(i))
    for file in (source, path):
        loud = np.flatnonzero(np.abs(read_sound(file, 48000).samples) > 0.3) / 48000
        assert loud[0] == pytest.approx(0.22, abs=0.01)
        assert loud[loud > 0.6][0] == pytest.approx(1.02, abs=0.01)


def test_sound_may_come_while_pictures_do(tmp_path: Path) -> None:
    queue = SoundQueue(16000)
    whole = clicks([0.5, 1.5], 2.0, 16000).samples
    with VideoWriter(tmp_path / "a.mp4", 64, 48, FPS, queue) as video:
        for i in range(50):
            if i % 25 == 0:
                queue.put(whole[i // 25 * 16000 :][:16000])
            video.write_planes(picture(i))
    loud = np.flatnonzero(np.abs(read_sound(tmp_path / "a.mp4", None).samples) > 0.3) / 16000
    assert loud[0] == pytest.approx(0.5, abs=0.003)
    assert loud[loud > 1][0] == pytest.approx(1.5, abs=0.003)


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".mkv", ".mov"])
def test_tags_can_be_read_again(tmp_path: Path, suffix: str) -> None:
    tags = {
        "description": "Synthetic: nobody said this.",
        "synopsis": json.dumps({"synthetic": True, "name": "é"}),
        "comment": "for the jury",
    }
    with VideoWriter(tmp_path / f"a{suffix}", 64, 48, 25, metadata=tags) as video:
        video.write_planes(picture(0))
    with av.open(str(tmp_path / f"a{suffix}")) as container:
        found = {k.lower(): v for k, v in container.metadata.items()}
    assert tags.items() <= found.items()


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_full_disk_is_one_error_and_leaves_no_file(tmp_path: Path, suffix: str) -> None:
    """As a disk that fills up: the system refuses to let the file grow."""
    rng = np.random.default_rng(1)
    noise = [
        Planes(*(rng.integers(0, 255, s, dtype=np.uint8) for s in ((48, 64), (24, 32), (24, 32))))
        for _ in range(60)
    ]
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
        with (
            pytest.raises(MediaError, match=r"a\.\w+: cannot be written \(.+\)$") as caught,
            VideoWriter(tmp_path / f"a{suffix}", 64, 48, 25, clicks([0.1], 3.0), crf=4) as video,
        ):
            for _ in range(3):
                for planes in noise:
                    video.write_planes(planes)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_device_without_room_is_an_error(tmp_path: Path) -> None:
    writer = VideoWriter(tmp_path / "a.mp4", 64, 48, 25)
    writer._partial.symlink_to("/dev/full")
    with pytest.raises(MediaError, match="cannot be written"), writer as video:
        for i in range(200):
            video.write_planes(picture(i))
    assert list(tmp_path.iterdir()) == []
