"""What a background is: the longest stretch with a face; several as one."""

import numpy as np
import pytest

from database.errors import RenderError
from database.mask import Poses
from render.background import Background, Material, longest_run


def poses(n):
    steps = np.arange(n, dtype=np.float32)[:, None]
    return Poses(np.repeat(steps, 3, 1) / 1000, np.repeat(steps, 3, 1) + 100)


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


def test_joined_backgrounds_go_at_the_first_one_s_rate():
    slow = Background.from_tracked("a.mp4", 25, np.arange(10), poses(10))
    fast = Background.from_tracked("b.mp4", 50, np.arange(30), poses(30))
    both = Background.joined([slow, fast])
    assert [part.path.name for part in both.parts] == ["a.mp4", "b.mp4"]
    assert (both.fps, len(both)) == (25, 10)
    assert Background.joined([both, slow]).parts == (*both.parts, slow)
    material = Material.of(both, 1000)
    assert material.part.tolist() == [0] * 10 + [1] * 15
    assert material.place.tolist() == [*range(10), *range(0, 30, 2)]
    assert material.poses.translations[:, 0].tolist() == [
        100.0 + p for p in [*range(10), *range(0, 30, 2)]
    ]
    assert set(material.ends.tolist()) == {10, 25}
    assert Material.of(both, 8).place.tolist() == [0, 1, 2, 3, 0, 2, 4, 6]
    with pytest.raises(RenderError, match="no background"):
        Background.joined([])
