"""The Synthesizer's pieces, each alone: select, background, render, write."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from analysis.clip import sha256_of
from database.errors import FaceError, RenderError, SelectionError
from database.mask import project
from database.media import probe, read_video
from database.pictures import encode
from database.reader import UnitDatabase, open_database
from database.track import PhonemeTrack, frame_count
from database.video_writer import VideoWriter
from database.writer import write_database
from render.background import Background
from render.blend import blend_alpha
from render.scene import Scene
from unitsel.background_ranking import rank_backgrounds
from unitsel.costs import Weights
from unitsel.synthesizer import Synthesizer


@pytest.fixture(scope="module")
def database(puppet_db: Path) -> Iterator[UnitDatabase]:
    """Open the puppet's database."""
    with open_database(puppet_db) as opened:
        yield opened


@pytest.fixture(scope="module")
def synthesizer(database: UnitDatabase) -> Synthesizer:
    return Synthesizer(database)


@pytest.fixture(scope="module")
def track(puppet: ModuleType) -> PhonemeTrack:
    return puppet.even_track("set blue", 0.1, 0.4)[0]


def test_select_covers_the_track_and_is_the_same_twice(
    synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    told: list[tuple[str, int, int]] = []
    first = synthesizer.select(track, progress=lambda *a: told.append(a))
    second = Synthesizer(synthesizer.database).select(track)
    assert len(first.units) == frame_count(track.end, synthesizer.database.fps)
    assert first.units.tolist() == second.units.tolist()
    assert first.costs.cost == second.costs.cost
    stage, done, total = told[-1]
    assert (stage, done) == ("selecting", total)


def test_excluded_sequences_are_not_used(synthesizer: Synthesizer, track: PhonemeTrack) -> None:
    sequences = synthesizer.database.sequences
    free = synthesizer.select(track)
    used = int(synthesizer.database.units.sequence[free.units[0]])
    found = synthesizer.select(track, exclude_sequences=[sequences.name[used]])
    assert used not in synthesizer.database.units.sequence[found.units]
    with pytest.raises(SelectionError, match="nobody"):
        synthesizer.select(track, exclude_sequences=["nobody"])
    with pytest.raises(SelectionError, match="every sequence"):
        synthesizer.select(track, exclude_sequences=range(len(sequences)))


def test_weights_steer_the_selection(database: UnitDatabase, track: PhonemeTrack) -> None:
    smooth = Synthesizer(database, Weights(target=0, skip=10)).select(track)
    choppy = Synthesizer(database, Weights(concatenation=0)).select(track)
    steps = [int((np.diff(s.units) != 1).sum()) for s in (smooth, choppy)]
    assert steps[0] < steps[1]


@pytest.mark.parametrize("fps", [25, 50])
def test_outside_the_blend_region_planes_are_the_backgrounds(
    fps: int, synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    db = synthesizer.database
    background = synthesizer.background()
    selection = synthesizer.select(track)
    made = list(synthesizer.render(selection, background=background, fps=fps))
    assert len(made) == frame_count(track.end, fps)
    originals = [
        f for f in read_video(background.path, background.fps) if f.index >= background.first
    ]
    # As long as the background lasts it is played straight on, at each rate nearest in time.
    places = np.ceil(np.arange(len(made)) * (background.fps / fps) - 0.5 - 1e-6).astype(int)
    assert places[-1] < len(background)
    info = probe(background.path)
    camera = db.camera.scaled_to(info.width, info.height)
    patch = db.mask.patch
    blank = np.zeros((patch.crop_height, patch.crop_width, 3), np.uint8)
    alpha = blend_alpha(db.mask)
    changed = 0
    with Scene(info.width, info.height, patch, camera, alpha) as scene:
        for planes, place in zip(made, places, strict=True):
            original = originals[int(place)].planes
            pose = background.poses.matrix(int(place))
            layer = scene.draw(blank, pose)
            whole = np.zeros((info.height, info.width), np.float32)
            rows = slice(layer.y0, layer.y0 + layer.alpha.shape[0])
            columns = slice(layer.x0, layer.x0 + layer.alpha.shape[1])
            whole[rows, columns] = layer.alpha
            outside = whole == 0
            assert (planes.y[outside] == original.y[outside]).all()
            blocks = outside.reshape(info.height // 2, 2, info.width // 2, 2).all(axis=(1, 3))
            assert (planes.u[blocks] == original.u[blocks]).all()
            assert (planes.v[blocks] == original.v[blocks]).all()
            # What the scene says is drawn lies inside the mouth's patch, wherever the head is.
            corners = project(patch.grid.reshape(-1, 3), pose, camera)
            low, high = corners.min(axis=0) - 2, corners.max(axis=0) + 2
            y, x = np.nonzero(~outside)
            assert (x >= low[0]).all() and (x <= high[0]).all()
            assert (y >= low[1]).all() and (y <= high[1]).all()
            assert 0 < (~outside).mean() < 0.3
            changed += int((planes.y != original.y).sum())
    assert changed > 100 * len(made)


def test_render_draws_as_it_is_asked(synthesizer: Synthesizer, track: PhonemeTrack) -> None:
    told: list[tuple[str, int, int]] = []
    pictures = synthesizer.render(synthesizer.select(track), progress=lambda *a: told.append(a))
    assert told == []
    first = next(pictures)
    info = probe(synthesizer.background().path)
    assert (first.width, first.height) == (info.width, info.height)
    assert len(told) <= 1
    rest = list(pictures)
    assert told[-1] == ("rendering", 1 + len(rest), 1 + len(rest))


def test_write_gives_what_it_wrote(
    synthesizer: Synthesizer, track: PhonemeTrack, puppet_corpus: Path, tmp_path: Path
) -> None:
    background = synthesizer.background(puppet_corpus / "hopper2.mp4")
    written = synthesizer.write(
        synthesizer.select(track), tmp_path / "o.mp4", background=background, fps=30
    )
    assert written.path == tmp_path / "o.mp4"
    assert written.background == puppet_corpus / "hopper2.mp4"
    assert written.frames == frame_count(track.end, 30) == probe(written.path).frames
    assert written.fps == 30
    assert written.seconds == pytest.approx(written.frames / 30)
    assert probe(written.path).fps == 30


def test_a_background_that_ends_early_leaves_no_video(
    synthesizer: Synthesizer, puppet: ModuleType, tmp_path: Path
) -> None:
    short = tmp_path / "short.mp4"
    known = synthesizer.background()
    track, _ = puppet.even_track("bin", 0.1, 0.1)
    puppet.write_clip(short, track, None)
    cheat = Background(short, known.fps, 0, known.poses)
    longer, _ = puppet.even_track("set blue now", 0.2, 0.8)
    with pytest.raises(RenderError, match=r"short\.mp4: ends before frame"):
        synthesizer.write(synthesizer.select(longer), tmp_path / "o.mp4", background=cheat)
    assert [p.name for p in tmp_path.iterdir()] == ["short.mp4"]


def test_a_clip_of_the_database_is_known_wherever_it_lies(
    synthesizer: Synthesizer, puppet_corpus: Path, tmp_path: Path
) -> None:
    moved = tmp_path / "elsewhere.mp4"
    moved.write_bytes((puppet_corpus / "hopper2.mp4").read_bytes())
    told: list[tuple[str, int, int]] = []
    background = synthesizer.background(moved, progress=lambda *a: told.append(a))
    assert told == []
    assert background.path == moved
    db = synthesizer.database
    s = db.sequences.name.index("hopper2")
    first = int(db.sequences.first_unit[s])
    assert np.array_equal(background.poses.translations[0], db.units.translation[first])


def test_other_footage_is_tracked(
    synthesizer: Synthesizer, puppet: ModuleType, tmp_path: Path
) -> None:
    track, _ = puppet.even_track("bin", 0.1, 0.2)
    puppet.write_clip(tmp_path / "other.mp4", track, None, 5)
    told: list[tuple[str, int, int]] = []
    background = synthesizer.background(tmp_path / "other.mp4", progress=lambda *a: told.append(a))
    assert [t[1:] for t in told] == [(0, 1), (1, 1)]
    assert len(background) == frame_count(track.end, 25)


@pytest.fixture
def made_up(makedb: ModuleType, tmp_path: Path) -> Path:
    """Make up a database whose third clip keeps still; the clips' files hold their names."""
    content, pictures, landmarks = makedb.make_content(missing_in=None)
    units = content.units
    still = np.where(units.sequence == 2, 0.0, 1.0)[:, None].astype(np.float32)
    at_rest = np.array([0, 0, 900], np.float32)
    for name in content.sequences.name:
        (tmp_path / f"{name}.mpg").write_text(name)
    content = replace(
        content,
        units=replace(
            units,
            rotation=units.rotation * still,
            translation=(units.translation - at_rest) * still + at_rest,
        ),
        sequences=replace(
            content.sequences,
            media=tuple(str(tmp_path / f"{n}.mpg") for n in content.sequences.name),
            sha256=tuple(sha256_of(tmp_path / f"{n}.mpg") for n in content.sequences.name),
        ),
    )
    path = tmp_path / "made-up.h5"
    write_database(path, content, (encode(p, "png") for p in pictures), landmarks, "png")
    return path


def test_the_best_clip_at_hand_is_the_background(made_up: Path) -> None:
    with open_database(made_up) as database:
        synthesizer = Synthesizer(database)
        ranked = rank_backgrounds(database)
        assert {one.media for one in ranked} == set(made_up.parent.glob("*.mpg"))
        first, second, third = (one.media for one in ranked[:3])
        assert synthesizer.background().path == first
        first.write_text("another video by now")
        assert synthesizer.background().path == second
        second.unlink()
        assert synthesizer.background().path == third


def test_footage_moved_away_asks_for_a_background(made_up: Path) -> None:
    for clip in made_up.parent.glob("*.mpg"):
        clip.unlink()
    with open_database(made_up) as database, pytest.raises(RenderError, match="--background"):
        Synthesizer(database).background()


def test_a_background_without_a_face(
    synthesizer: Synthesizer, puppet: ModuleType, tmp_path: Path
) -> None:
    with VideoWriter(tmp_path / "wall.mp4", 64, 64, 25) as video:
        for _ in range(5):
            video.write_rgb(np.full((64, 64, 3), 120, np.uint8))
    with pytest.raises(FaceError, match=r"wall\.mp4"):
        synthesizer.background(tmp_path / "wall.mp4")
