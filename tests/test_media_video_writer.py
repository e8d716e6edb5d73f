"""Video out: exact times, sound in step, nothing half-written."""

from fractions import Fraction

import av
import numpy as np
import pytest

from database.errors import MediaError
from database.media import probe, read_sound, read_video
from database.planes import Planes
from database.sound import Sound, sound_format
from database.video_writer import VideoWriter


def picture(seed=0, width=64, height=48):
    rng = np.random.default_rng(seed)
    return Planes(
        rng.integers(16, 236, (height, width), dtype=np.uint8),
        rng.integers(90, 160, (height // 2, width // 2), dtype=np.uint8),
        rng.integers(90, 160, (height // 2, width // 2), dtype=np.uint8),
    )


def clicks(rate, times, length):
    samples = np.zeros(int(length * rate), np.float32)
    for time in times:
        samples[int(time * rate) : int((time + 0.004) * rate)] = 0.9
    return Sound(samples, rate)


def write(path, n, fps=25, sound=None, **options):
    with VideoWriter(path, 64, 48, fps, sound, **options) as video:
        for i in range(n):
            video.write_planes(picture(i))
    return path


@pytest.mark.parametrize(
    ("fps", "exact"),
    [
        (25, Fraction(25)),
        (29.97, Fraction(30000, 1001)),
        (30, Fraction(30)),
        (50, Fraction(50)),
        (59.94, Fraction(60000, 1001)),
        (Fraction(24000, 1001), Fraction(24000, 1001)),
        (12.5, Fraction(25, 2)),
    ],
)
def test_frame_times_are_exact(tmp_path, fps, exact):
    path = write(tmp_path / "a.mp4", 130, fps, clicks(16000, [0.0], 0.1))
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        times = [f.pts * f.time_base for f in container.decode(stream)]
        assert times == [i / exact for i in range(130)]
        assert stream.duration * stream.time_base == 130 / exact
    assert probe(path).fps == float(exact)


@pytest.mark.parametrize("rate", [16000, 22050, 44100, 48000])
@pytest.mark.parametrize("fps", [25, 29.97, 59.94])
def test_sound_is_in_step_with_the_picture(tmp_path, rate, fps):
    sound = clicks(rate, [0.0, 1.5], 2)
    path = write(tmp_path / "a.mp4", round(2 * fps), fps, sound)
    back = read_sound(path, None)
    assert back.rate == rate
    loud = np.abs(back.samples) > 0.3
    assert np.argmax(loud) / rate == pytest.approx(0, abs=0.003)
    half = rate
    assert np.argmax(loud[half:]) / rate + half / rate == pytest.approx(1.5, abs=0.003)


@pytest.mark.parametrize("length", [0.4, 1.0, 3.0])
def test_sound_gets_the_length_of_the_video(tmp_path, length):
    path = write(tmp_path / "a.mp4", 25, 25, clicks(48000, [0.2], length))
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        assert float(stream.duration * stream.time_base) == pytest.approx(1.0, abs=1024 / 48000)
    tail = read_sound(path, None).samples[48000 * 9 // 10 :]
    assert float(np.abs(tail).max()) < 0.01


def test_sound_of_a_file_keeps_rate_and_channels(tmp_path):
    source = tmp_path / "source.mkv"
    with av.open(str(source), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=44100)
        stream.codec_context.layout = "stereo"
        pcm = np.zeros((1, 2 * 44100), np.int16)
        pcm[0, 44100 : 44100 + 400 : 2] = 30000  # 0.5 s, the left channel alone
        frame = av.AudioFrame.from_ndarray(pcm, format="s16", layout="stereo")
        frame.sample_rate, frame.pts = 44100, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    path = write(tmp_path / "a.mp4", 25, 25, source)
    assert sound_format(path) == (44100, "stereo")
    loud = np.abs(read_sound(path, None).samples) > 0.15
    assert np.argmax(loud) / 44100 == pytest.approx(0.5, abs=0.003)


def test_planes_reach_the_encoder_unaltered(tmp_path):
    path = write(tmp_path / "a.mp4", 3, crf=0)
    for i, frame in enumerate(read_video(path)):
        wanted = picture(i)
        assert np.array_equal(frame.planes.y, wanted.y)
        assert np.array_equal(frame.planes.u, wanted.u)
        assert np.array_equal(frame.planes.v, wanted.v)


def test_an_exception_leaves_nothing_behind(tmp_path):
    with (
        pytest.raises(ZeroDivisionError),
        VideoWriter(tmp_path / "a.mp4", 64, 48, 25) as video,
    ):
        video.write_planes(picture())
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_an_older_video_is_replaced_only_by_a_complete_one(tmp_path):
    path = write(tmp_path / "a.mp4", 3)
    before = path.read_bytes()
    with pytest.raises(KeyError), VideoWriter(path, 64, 48, 25) as video:
        video.write_planes(picture())
        raise KeyError
    assert path.read_bytes() == before
    write(path, 5)
    assert probe(path).frames == 5
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


def test_sound_that_fails_leaves_nothing_behind(tmp_path):
    silent = write(tmp_path / "silent.mp4", 2)
    with pytest.raises(MediaError, match=r"silent\.mp4: holds no sound"):
        VideoWriter(tmp_path / "a.mp4", 64, 48, 25, silent)
    assert not (tmp_path / "a.mp4").exists()


def test_what_cannot_be_written_is_refused_at_once(tmp_path):
    with pytest.raises(MediaError, match="does not exist; create it"):
        VideoWriter(tmp_path / "none" / "a.mp4", 64, 48, 25)
    with pytest.raises(MediaError, match=r"written as \.mp4"):
        VideoWriter(tmp_path / "a.xyz", 64, 48, 25)
    with pytest.raises(MediaError, match="even"):
        VideoWriter(tmp_path / "a.mp4", 63, 48, 25)
    with pytest.raises(MediaError, match="frame rate"):
        VideoWriter(tmp_path / "a.mp4", 64, 48, 0)
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(MediaError, match="is a folder"):
        VideoWriter(tmp_path / "folder.mp4", 64, 48, 25)
    with pytest.raises(MediaError, match=r"mp4 with prores4444 is not written; choose h264"):
        VideoWriter(tmp_path / "a.mp4", 64, 48, 25, codec="prores4444")
    with pytest.raises(MediaError, match=r"holds no transparency; use \.mov"):
        VideoWriter(tmp_path / "a.mp4", 64, 48, 25, alpha=True)
    with pytest.raises(MediaError, match="CRF goes from 0 to 51, not 52"):
        VideoWriter(tmp_path / "a.mp4", 64, 48, 25, crf=52)
    with pytest.raises(MediaError, match="ffv1 has no CRF"):
        VideoWriter(tmp_path / "a.mkv", 64, 48, 25, codec="ffv1", crf=3)


def test_wrong_sizes_and_no_frames_are_errors(tmp_path):
    path = tmp_path / "a.mp4"
    with pytest.raises(MediaError, match="frame 0 is 32 x 48"), VideoWriter(path, 64, 48, 25) as v:
        v.write_planes(picture(width=32))
    with pytest.raises(MediaError, match="no frame was written"), VideoWriter(path, 64, 48, 25):
        pass
    with pytest.raises(MediaError, match="with statement"):
        VideoWriter(path, 64, 48, 25).write_planes(picture())
    assert list(tmp_path.iterdir()) == []
