"""A background without an end: which frames are shown, how they are blended, and memory."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from database.errors import RenderError
from database.mask import Camera, MouthPatch, Poses
from database.media import read_video
from database.planes import Colour, Planes, rgb_to_planes
from database.video_writer import VideoWriter
from render.background import Background
from render.background_frames import BackgroundFrames
from render.morph import between_poses, flow_between, morph
from render.playback import Playback, PlayedFrame

WIDTH, HEIGHT, FPS, N = 128, 96, 25, 90
CAMERA = Camera.assumed(WIDTH, HEIGHT)
DEPTH = 900.0
MM = DEPTH / CAMERA.focal
"""Millimetres that a pixel shows."""

x, y = np.meshgrid(np.linspace(-30, 30, 4), np.linspace(20, 70, 4))
PATCH = MouthPatch(np.stack([x, y, 0 * x], axis=-1).astype(np.float32), 16, 16)


def scene(seed: int = 0) -> np.ndarray:
    """A picture larger than the film, (h, w, 3) uint8, soft enough for pixels to move by parts."""
    noise = np.random.default_rng(seed).normal(size=(HEIGHT + 40, WIDTH + 40, 3))
    soft = gaussian_filter(noise, (2.5, 2.5, 0))
    return np.clip(128 + 45 * soft / soft.std(), 0, 255).astype(np.uint8)


def sway(n: int, rate: float = 0.9) -> np.ndarray:
    """Places of the head, pixels: a sway that comes back to about where it was, (n, 2)."""
    t = np.arange(n) / FPS
    return np.stack([3 * np.sin(2 * np.pi * rate * t), np.cos(2 * np.pi * rate * 1.31 * t)], 1)


def film(path: Path, places: np.ndarray, *, seed: int = 0, size=(WIDTH, HEIGHT)) -> Background:
    """Write a film of the scene at these places; the poses say the same."""
    picture = scene(seed)
    with VideoWriter(path, *size, FPS, crf=4) as video:
        for dx, dy in places:
            shift = np.array([[1, 0, dx - 20], [0, 1, dy - 20]])
            moved = cv2.warpAffine(picture, shift, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
            if size != (WIDTH, HEIGHT):
                moved = cv2.resize(moved, size, interpolation=cv2.INTER_AREA)
            video.write_rgb(moved)
    at = np.column_stack([places * MM, np.full(len(places), DEPTH)]).astype(np.float32)
    return Background(path, FPS, 0, Poses(np.zeros_like(at), at))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Background:
    return film(tmp_path_factory.mktemp("walk") / "clip.mp4", sway(N))


def played(background: Background, n: int, fps: float = FPS, **options: int) -> list[PlayedFrame]:
    with Playback(background, fps, PATCH, CAMERA, **options) as playback:
        return list(islice(playback, n))


def jumps(frames: list[PlayedFrame]) -> np.ndarray:
    luma = np.stack([f.planes.y for f in frames]).astype(np.float32)
    return np.abs(np.diff(luma, axis=0)).mean(axis=(1, 2))


def test_it_begins_as_recorded_and_never_runs_backwards(clip: Background) -> None:
    frames = played(clip, 900)
    assert [f.number for f in frames] == list(range(900))
    assert [f.place for f in frames[:30]] == list(range(30))
    recorded = [f.planes for f in islice(read_video(clip.path), 30)]
    for frame, own in zip(frames[:30], recorded, strict=True):
        assert not frame.blended
        np.testing.assert_array_equal(frame.planes.y, own.y)
    places = np.array([f.place for f in frames])
    plain = ~np.array([f.blended for f in frames])
    alone = plain[1:] & plain[:-1]
    assert (np.diff(places)[alone] == 1).all()
    assert 0.1 < plain.mean() < 0.95
    # It goes on in many different ways.
    changes = {tuple(places[k : k + 2]) for k in np.flatnonzero(np.diff(places) != 1)}
    assert len(changes) > 10


def test_changes_are_no_greater_than_the_recording_s_own_steps(clip: Background) -> None:
    frames = played(clip, 600)
    blended = np.array([f.blended for f in frames])
    changing = blended[1:] | blended[:-1]
    steps = jumps(frames)
    usual = np.percentile(steps[~changing], 95)
    again = [*frames[:40], *frames[:2]]
    assert jumps(again)[39] > 2 * usual, "a cut would be seen"
    assert steps[changing].max() < 1.6 * usual
    # And the head goes with the picture: its pose never jumps either.
    head = np.stack([f.pose[:2, 3] for f in frames]) / MM
    moved = np.linalg.norm(np.diff(head, axis=0), axis=1)
    assert moved[changing].max() < 1.6 * np.percentile(moved[~changing], 95)


def test_the_same_seed_gives_the_same_and_another_another(clip: Background) -> None:
    first, second, other = (played(clip, 400, seed=seed) for seed in (3, 3, 4))
    assert [f.place for f in first] == [f.place for f in second]
    assert all((a.planes.y == b.planes.y).all() for a, b in zip(first, second, strict=True))
    assert [f.place for f in first] != [f.place for f in other]


def test_what_is_long_enough_is_played_straight_on(clip: Background) -> None:
    frames = played(clip, N, length=N)
    assert [f.place for f in frames] == list(range(N))
    assert not any(f.blended for f in frames)


def test_other_rates_keep_time(clip: Background) -> None:
    assert [f.place for f in played(clip, 6, 50)] == [0, 0, 1, 1, 2, 2]
    assert [f.place for f in played(clip, 4, 12.5)] == [0, 2, 4, 6]
    twice = played(clip, 800, 50)
    once = played(clip, 400)
    assert [f.place for f in twice[::2]] == [f.place for f in once]


def test_nothing_alike_is_played_forth_and_back_and_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    away = film(tmp_path / "away.mp4", np.cumsum(rng.uniform(0.2, 0.3, (40, 2)), axis=0))
    with Playback(away, FPS, PATCH, CAMERA) as playback:
        places = [frame.place for frame in islice(playback, 80)]
        assert places == [*range(40), *range(38, -1, -1), 1]
        assert "forth and back" in playback.notes[0] and "away.mp4" in playback.notes[0]
    with Playback(away, FPS, PATCH, CAMERA, length=40) as playback:
        assert playback.notes == ()


def test_several_are_shown_one_after_another(clip: Background, tmp_path: Path) -> None:
    small = (WIDTH // 2, HEIGHT // 2)
    second = film(tmp_path / "second.mp4", sway(60, 0.7) + 1, size=small)
    frames = played(Background.joined([clip, second]), 500)
    parts = np.array([f.part for f in frames])
    first = int(np.argmax(parts == 1))
    assert 50 < first <= N
    assert frames[first].blended
    assert {(f.planes.width, f.planes.height) for f in frames} == {(WIDTH, HEIGHT)}
    steps = jumps(frames)
    assert steps[first - 12 : first + 12].max() < 1.5 * steps[:50].max()


def test_other_shapes_cannot_be_joined(clip: Background, tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "wide.mp4", 128, 64, FPS) as video:
        for _ in range(20):
            video.write_rgb(np.full((64, 128, 3), 90, np.uint8))
    at = np.zeros((20, 3), np.float32) + [0, 0, 900]
    wide = Background(tmp_path / "wide.mp4", FPS, 0, Poses(0 * at, at))
    with pytest.raises(RenderError, match=r"wide\.mp4: its pictures of 128 x 64 cannot be joined"):
        Playback(Background.joined([clip, wide]), FPS, PATCH, CAMERA)


def test_a_join_to_what_is_too_short_is_refused(clip: Background, tmp_path: Path) -> None:
    short = film(tmp_path / "short.mp4", sway(6))
    with pytest.raises(RenderError, match=r"short\.mp4: too short to be joined"):
        played(Background.joined([clip, short]), 200)


def test_a_photo_stands_still(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), scene()[:HEIGHT, :WIDTH])
    pose = np.array([[0, 0, DEPTH]], np.float32)
    photo = Background(tmp_path / "p.png", FPS, 0, Poses(0 * pose, pose), still=True)
    frames = played(photo, 60)
    assert all((f.planes.y == frames[0].planes.y).all() for f in frames)
    wanted = rgb_to_planes(scene()[:HEIGHT, :WIDTH, ::-1], Colour())
    np.testing.assert_array_equal(frames[0].planes.y, wanted.y)


# The frames, in any order


@pytest.fixture(scope="module")
def numbered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """200 frames whose luma tells their number."""
    path = tmp_path_factory.mktemp("numbered") / "clip.mp4"
    with VideoWriter(path, 32, 16, FPS, crf=0) as video:
        for i in range(200):
            grey = np.full((8, 16), 128, np.uint8)
            video.write_planes(Planes(np.full((16, 32), 20 + i, np.uint8), grey, grey))
    return path


@pytest.mark.parametrize("memory", [400_000_000, 20 * 768, 0])
def test_frames_in_any_order_with_any_memory(numbered: Path, memory: int) -> None:
    pose = np.zeros((190, 3), np.float32)
    frames = BackgroundFrames((Background(numbered, FPS, 5, Poses(pose, pose)),), memory)
    order = [0, 1, 2, 150, 151, 3, 189, 70, 71, 100, 69, 0, 188, 189]
    shown = [float(frames.planes(0, place).y.mean()) - 20 for place in order]
    assert np.allclose(shown, np.array(order) + 5, atol=0.5)
    assert len(frames._kept) <= max(1, memory // 768)
    frames.close()


def test_a_file_that_has_become_shorter(numbered: Path) -> None:
    pose = np.zeros((260, 3), np.float32)
    frames = BackgroundFrames((Background(numbered, FPS, 0, Poses(pose, pose)),))
    with pytest.raises(RenderError, match="ends before frame 200"):
        for place in range(260):
            frames.planes(0, place)


# Between two pictures


def test_half_way_between_two_places_is_one_place() -> None:
    picture = scene()
    first, middle, second = (
        rgb_to_planes(
            cv2.warpAffine(
                picture,
                np.array([[1, 0, dx - 20.0], [0, 1, -20.0]]),
                (WIDTH, HEIGHT),
                flags=cv2.INTER_CUBIC,
            ),
            Colour(),
        )
        for dx in (0.0, 1.5, 3.0)
    )
    made = morph(first, second, flow_between(first, second), 0.5)
    inside = np.s_[8:-8, 8:-8]
    error = np.abs(made.y[inside].astype(float) - middle.y[inside]).mean()
    faded = (first.y[inside].astype(float) + second.y[inside]) / 2
    assert error < 0.25 * np.abs(faded - middle.y[inside]).mean()


def test_the_pose_half_way() -> None:
    r, _ = cv2.Rodrigues(np.array([0.0, 0.2, 0.0]))
    first = np.hstack([np.eye(3), [[0.0], [0.0], [900.0]]])
    second = np.hstack([r, [[10.0], [0.0], [800.0]]])
    half = between_poses(first, second, 0.5)
    turn, _ = cv2.Rodrigues(half[:, :3])
    np.testing.assert_allclose(turn.ravel(), [0, 0.1, 0], atol=1e-12)
    np.testing.assert_allclose(half[:, 3], [5, 0, 850])
    np.testing.assert_allclose(between_poses(first, second, 1.0), second, atol=1e-12)
