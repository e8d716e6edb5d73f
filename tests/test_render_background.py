"""Which background frame is shown when, and reading them with little memory."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from database.errors import RenderError
from database.mask import Poses
from database.planes import Planes
from database.video_writer import VideoWriter
from render.background import Background, longest_run, playback_indices, stream_frames


def poses(n):
    steps = np.arange(n, dtype=np.float32)[:, None]
    return Poses(np.repeat(steps, 3, 1) / 1000, np.repeat(steps, 3, 1) + 100)


@given(
    n=st.integers(1, 60),
    n_out=st.integers(0, 300),
    own=st.sampled_from([23.976, 25.0, 29.97, 30.0, 50.0, 59.94]),
    out=st.sampled_from([24.0, 25.0, 29.97, 30.0, 50.0, 59.94]),
)
def test_playback_never_jumps(n, n_out, own, out):
    indices = playback_indices(n, n_out, own, out)
    assert indices.shape == (n_out,)
    assert indices.dtype == np.int64
    assert ((indices >= 0) & (indices < n)).all()
    assert n_out == 0 or indices[0] == 0
    assert (np.abs(np.diff(indices)) <= np.ceil(own / out)).all()


@given(n=st.integers(2, 60), n_out=st.integers(2, 300))
def test_at_equal_rates_every_step_is_one(n, n_out):
    assert (np.abs(np.diff(playback_indices(n, n_out, 25, 25))) == 1).all()


def test_forth_and_back():
    assert playback_indices(4, 10, 25, 25).tolist() == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]
    assert playback_indices(4, 3, 25, 25).tolist() == [0, 1, 2]
    assert playback_indices(1, 4, 25, 50).tolist() == [0, 0, 0, 0]
    assert playback_indices(2, 5, 25, 25).tolist() == [0, 1, 0, 1, 0]


def test_other_rates_keep_time():
    assert playback_indices(10, 6, 25, 50).tolist() == [0, 0, 1, 1, 2, 2]
    assert playback_indices(10, 4, 50, 25).tolist() == [0, 2, 4, 6]
    long = playback_indices(100_000, 3600 * 30, 25, 29.97)
    times = np.arange(3600 * 30) / 29.97
    assert np.abs(long / 25 - times)[long < 99_999].max() <= 0.5 / 25 + 1e-6


def test_rates_and_lengths_are_checked():
    with pytest.raises(RenderError, match="no frame"):
        playback_indices(0, 3, 25, 25)
    with pytest.raises(RenderError, match="positive"):
        playback_indices(3, 3, 25, 0)


def test_longest_run():
    assert longest_run(np.array([4, 5, 6, 9, 10, 11, 12, 20])) == (3, 7)
    assert longest_run(np.array([7])) == (0, 1)
    assert longest_run(np.array([1, 2, 5, 6])) == (0, 2)


def test_background_is_the_longest_tracked_stretch(tmp_path):
    tracked = poses(9)
    tracked.translations[6] = np.nan  # Frame 13 has no pose after all.
    frames = np.array([0, 1, 8, 9, 10, 12, 13, 14, 15])
    background = Background.from_tracked(tmp_path / "a.mp4", 25, frames, tracked)
    assert (background.first, len(background)) == (8, 3)
    assert background.poses.translations[:, 0].tolist() == [102, 103, 104]
    with pytest.raises(RenderError, match="no face"):
        Background.from_tracked("a.mp4", 25, np.zeros(0, int), poses(0))
    with pytest.raises(RenderError, match="9 poses for 3 frames"):
        Background.from_tracked("a.mp4", 25, np.arange(3), tracked)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """30 frames whose luma tells their number."""
    path = tmp_path_factory.mktemp("background") / "clip.mp4"
    with VideoWriter(path, 32, 16, 25, crf=0) as video:
        for i in range(30):
            grey = np.full((8, 16), 128, np.uint8)
            video.write_planes(Planes(np.full((16, 32), 20 + 7 * i, np.uint8), grey, grey))
    return path


# A frame counts 32 x 16 x 6 = 3,072 bytes: all are held, or four, or the two that is least.
@pytest.mark.parametrize("memory", [500_000_000, 4 * 3072, 0])
def test_frames_are_read_in_playback_order(clip, memory):
    background = Background.from_tracked(clip, 25, np.arange(5, 25), poses(20))
    indices = playback_indices(20, 70, 25, 25)
    frames = list(stream_frames(background, indices, memory=memory))
    assert [f.index for f in frames] == (indices + 5).tolist()
    shown = [round((float(f.planes.y.mean()) - 20) / 7) for f in frames]
    assert shown == (indices + 5).tolist()


def test_frames_at_another_rate(clip):
    background = Background.from_tracked(clip, 25, np.arange(30), poses(30))
    indices = playback_indices(30, 100, 25, 50)
    frames = list(stream_frames(background, indices))
    assert [f.index for f in frames] == indices.tolist()


def test_a_file_that_has_become_shorter(clip):
    background = Background.from_tracked(clip, 25, np.arange(40), poses(40))
    with pytest.raises(RenderError, match="ends before frame 30"):
        list(stream_frames(background, playback_indices(40, 40, 25, 25)))
