"""The eyes of another clip on a background: where they are, and what they leave alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from database.errors import MediaError, RenderError
from database.mask import LEFT_EYE, RIGHT_EYE, Mask, project
from database.mask_surface import eyes_patch
from database.media import probe, read_video
from database.planes import planes_to_rgb, rgb_to_planes
from database.reader import UnitDatabase, open_database
from database.timing import write_timing
from database.video_writer import VideoWriter
from render.background import Background
from render.blend import blend_alpha
from render.eyes import eyes_alpha
from render.picture_measures import changed_outside
from render.scene import Scene
from unitsel.synthesizer import Synthesizer

PUPIL = (30, 60, 235)
"""Colour of the eyes that are painted into a clip, RGB."""


@pytest.fixture(scope="module")
def database(puppet_db: Path) -> Iterator[UnitDatabase]:
    """Open the puppet's database."""
    with open_database(puppet_db) as opened:
        yield opened


def irises(mask: Mask) -> np.ndarray:
    """Middle of each eye on the mask, (2, 3) mm."""
    return np.stack([mask.vertices[list(eye)].mean(axis=0) for eye in (LEFT_EYE, RIGHT_EYE)])


@pytest.fixture(scope="module")
def painted(database: UnitDatabase, tmp_path_factory: pytest.TempPathFactory) -> Background:
    """A clip of the database with blue eyes: its poses are known, so nothing is tracked."""
    source = Synthesizer(database).background(
        database.sequences.media[database.sequences.name.index("hopper3")]
    )
    info = probe(source.path)
    camera = database.camera.scaled_to(info.width, info.height)
    path = tmp_path_factory.mktemp("eyes") / "blue.mp4"
    with VideoWriter(path, info.width, info.height, 25, colour=info.colour, crf=10) as video:
        for frame in read_video(source.path, source.fps):
            rgb = frame.rgb.copy()
            i = min(max(frame.index - source.first, 0), len(source) - 1)
            for x, y in project(irises(database.mask), source.poses.matrix(i), camera):
                cv2.circle(rgb, (round(x), round(y)), 4, PUPIL, -1, cv2.LINE_AA)
            video.write_planes(rgb_to_planes(rgb, info.colour))
    return replace(source, path=path)


def test_the_region_is_both_eyes_and_lies_on_the_face(database: UnitDatabase) -> None:
    mask = database.mask
    patch = eyes_patch(mask)
    assert patch.pixels_per_mm == pytest.approx(mask.patch.pixels_per_mm, rel=0.01)
    alpha = eyes_alpha(mask, patch)
    assert alpha.shape == (patch.crop_height, patch.crop_width)
    for eye in (LEFT_EYE, RIGHT_EYE):
        for x, y in np.rint(patch.to_crop(mask.vertices[list(eye)])).astype(int):
            assert alpha[y, x] > 0.95
    for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]):
        assert not edge.any()
    # Neither the tip of the nose nor the forehead.
    x, y = patch.to_crop(mask.vertices[[4, 10]]).T
    inside = (y > 0) & (y < patch.crop_height - 1) & (x > 0) & (x < patch.crop_width - 1)
    assert not inside.any()
    # The grid is as deep as the mesh under it.
    known = mask.vertices[[33, 133, 362, 263, 168]]
    columns, rows = patch.grid[0, :, 0], patch.grid[:, 0, 1]
    for point in known:
        near = patch.grid[np.abs(rows - point[1]).argmin(), np.abs(columns - point[0]).argmin()]
        assert abs(near[2] - point[2]) < 8


def test_eyes_come_from_the_other_clip_and_nothing_else_changes(
    database: UnitDatabase, painted: Background, puppet: ModuleType
) -> None:
    synthesizer = Synthesizer(database)
    track = puppet.even_track("set blue", 0.1, 0.3)[0]
    selection = synthesizer.select(track)
    under = synthesizer.background(
        database.sequences.media[database.sequences.name.index("hopper1")]
    )
    plain = list(synthesizer.render(selection, background=under))
    made = list(synthesizer.render(selection, background=under, eyes=painted))
    assert len(made) == len(plain)
    info = probe(under.path)
    mask, camera = database.mask, database.camera.scaled_to(info.width, info.height)
    patch = eyes_patch(mask)
    alpha = eyes_alpha(mask, patch)
    blank = np.zeros((patch.crop_height, patch.crop_width, 3), np.uint8)
    with Scene(info.width, info.height, patch, camera, alpha) as scene:
        for i, (with_eyes, without) in enumerate(zip(made, plain, strict=True)):
            pose = under.poses.matrix(i)
            layer = scene.draw(blank, pose)
            assert changed_outside(with_eyes, without, layer.alpha, layer.x0, layer.y0) == 0
            rgb, before = (planes_to_rgb(p, info.colour) for p in (with_eyes, without))
            for x, y in np.rint(project(irises(mask), pose, camera)).astype(int):
                red, _, blue = rgb[y, x].astype(int)
                assert blue > red + 60
                red, _, blue = before[y, x].astype(int)
                assert blue < red + 30


def test_the_mouth_is_the_same_with_other_eyes(database: UnitDatabase) -> None:
    """The two regions do not meet, or one would be blended into the other."""
    mask = database.mask
    camera = database.camera
    mouth = blend_alpha(mask)
    patch = eyes_patch(mask)
    pose = np.hstack([np.eye(3), np.array([[0.0], [0.0], [1000.0]])])
    covered = np.zeros((camera.height, camera.width), int)
    for part, alpha in ((mask.patch, mouth), (patch, eyes_alpha(mask, patch))):
        blank = np.zeros((part.crop_height, part.crop_width, 3), np.uint8)
        with Scene(camera.width, camera.height, part, camera, alpha) as scene:
            layer = scene.draw(blank, pose)
        h, w = layer.alpha.shape
        covered[layer.y0 : layer.y0 + h, layer.x0 : layer.x0 + w] += layer.alpha > 0
    assert covered.max() == 1


def test_eyes_need_a_background_and_are_not_overwritten(
    database: UnitDatabase, painted: Background, puppet: ModuleType
) -> None:
    synthesizer = Synthesizer(database)
    track = puppet.even_track("set", 0.1, 0.2)[0]
    selection = synthesizer.select(track)
    size = painted.path.stat().st_size
    with pytest.raises(MediaError, match="is an input of this video too"):
        synthesizer.write(selection, painted.path, eyes=painted)
    assert painted.path.stat().st_size == size
    with pytest.raises(RenderError, match="has none"):
        next(synthesizer.stream([track], eyes=painted, alpha=True))


def test_the_command_takes_eyes(
    puppet: ModuleType,
    puppet_db: Path,
    puppet_corpus: Path,
    run: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
) -> None:
    track, _ = puppet.even_track("bin", 0.1, 0.2)
    write_timing(tmp_path / "say.lab", track)
    plain, blue = tmp_path / "plain.mp4", tmp_path / "eyes.mp4"
    common = ("synth", puppet_db, tmp_path / "say.lab", "--background")
    own = puppet_corpus / "hopper1.mp4"
    eyes = puppet_corpus / "hopper2.mp4"
    assert run(*common, own, "-o", plain)[0] == 0
    status, _, err = run(*common, own, "--eyes", eyes, "-o", blue)
    assert (status, err) == (0, "")
    first, second = (list(read_video(v)) for v in (plain, blue))
    assert len(first) == len(second)
    assert (first[0].planes.y != second[0].planes.y).any()
    status, _, err = run(*common, own, "--eyes", tmp_path / "none.mp4", "-o", tmp_path / "o.mp4")
    assert status == 2 and "none.mp4" in err and not (tmp_path / "o.mp4").exists()
    status, _, err = run(*common, own, "--eyes", eyes, "--alpha", "-o", tmp_path / "o.mov")
    assert status == 2 and "--alpha" in err
