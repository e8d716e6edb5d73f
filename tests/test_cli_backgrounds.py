"""``unitsel backgrounds``: listed, ranked, added, removed; and what they are used for."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from database.errors import DatabaseError, MediaError, RenderError
from database.fingerprint import content_hash, identity
from database.media import probe, read_video
from database.photo import is_photo, read_photo
from database.reader import open_database
from database.video_writer import VideoWriter
from database.writer import store_backgrounds
from unitsel.background_ranking import rank_backgrounds
from unitsel.synthesizer import Synthesizer

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def sitting(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Film the puppet while it sits and says nothing, a little more than a second."""
    path = tmp_path_factory.mktemp("sitting") / "sitting.mp4"
    silence = puppet.even_track("bin", 1.2, 0.01)[0]
    with VideoWriter(path, puppet.WIDTH, puppet.HEIGHT, puppet.FPS, crf=14) as video:
        for picture in puppet.film(silence, 28, seed=7, motion=0.6):
            video.write_rgb(picture)
    return path


@pytest.fixture(scope="module")
def photo(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo of the puppet, of another size than the film."""
    path = tmp_path_factory.mktemp("photo") / "portrait.jpg"
    x, y = puppet.CORNER.astype(int)
    seen = puppet.portrait()[y : y + puppet.HEIGHT, x : x + puppet.WIDTH]
    large = cv2.resize(seen, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(path), large[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
    return path


@pytest.fixture
def own_db(puppet_db: Path, tmp_path: Path) -> Path:
    """Give a copy of the puppet's database."""
    return Path(shutil.copy(puppet_db, tmp_path / "own.h5"))


def test_the_clips_are_listed_the_best_first(run: Run, puppet_db: Path) -> None:
    status, out, err = run("backgrounds", puppet_db, "--json")
    assert (status, err) == (0, "")
    told = json.loads(out)
    listed = told["backgrounds"]
    with open_database(puppet_db) as database:
        assert sorted(one["name"] for one in listed) == sorted(database.sequences.name)
        assert Synthesizer(database).background().path == Path(listed[0]["media"])
    assert [one["cost"] for one in listed] == sorted(one["cost"] for one in listed)
    assert all(one["state"] == "there" and not one["added"] for one in listed)
    # The puppet's light is steady, its jaw moves, and all its clips begin and end at rest.
    assert all(one["light"] < 0.02 and one["chin_mm"] > 0.5 for one in listed)
    assert all(0.1 < one["rest"] < 1 for one in listed)
    status, out, err = run("backgrounds", puppet_db, "--limit", 2)
    assert (status, err) == (0, "")
    assert len(out.splitlines()) == 4 and out.splitlines()[1].startswith(listed[0]["name"])


def test_added_ranked_used_and_removed(
    run: Run, own_db: Path, sitting: Path, photo: Path, tmp_path: Path
) -> None:
    before = content_hash(own_db)
    with open_database(own_db) as database:
        same = identity(database)
    status, out, err = run("backgrounds", own_db, "--add", sitting, photo, "--json")
    assert (status, err) == (0, ""), err
    told = json.loads(out)
    assert told["added"] == ["sitting", "portrait"]
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]
    first = told["backgrounds"][0]
    assert (first["name"], first["added"], first["photo"]) == ("sitting", True, False)
    clips = [one for one in told["backgrounds"] if not one["added"]]
    # A mouth at rest: no clip that speaks comes near it.
    assert first["rest"] == 1 and first["cost"] < min(one["cost"] for one in clips)
    assert first["chin_mm"] < 0.5 * min(one["chin_mm"] for one in clips)
    assert told["backgrounds"][-1]["name"] == "portrait"
    with open_database(own_db) as database:
        assert identity(database) == same
        synthesizer = Synthesizer(database, models=tmp_path / "nowhere")
        # Nothing is tracked again: there are no models to do it with.
        background = synthesizer.background()
        assert background.path == sitting and len(background) == 28
        assert synthesizer.background("sitting").path == sitting
        still = synthesizer.background(photo)
        assert still.still and len(still) == 1
        both = synthesizer.background("sitting", "hopper2")
        assert [part.path.name for part in both.parts] == ["sitting.mp4", "hopper2.mp4"]
        with pytest.raises(RenderError, match=r"portrait\.jpg: is a photo, which cannot be joined"):
            synthesizer.background("sitting", "portrait")
        # The pose that was kept fits: the mouth stays where the background has its own.
        place = background.poses.translations[:, :2]
        assert np.ptp(place, axis=0).max() < 15
    # Once more takes the place of the first, and leaves one.
    run("backgrounds", own_db, "--add", sitting)
    with open_database(own_db) as database:
        assert sorted(database.backgrounds.name) == ["portrait", "sitting"]
    status, out, _ = run("backgrounds", own_db, "--remove", "sitting", photo, "--json")
    assert status == 0 and json.loads(out)["removed"] == ["sitting", str(photo)]
    assert content_hash(own_db) == before
    assert sitting.is_file()


def test_a_video_over_several_backgrounds_and_over_a_photo(
    run: Run, puppet: ModuleType, own_db: Path, sitting: Path, photo: Path, tmp_path: Path
) -> None:
    from database.timing import Timing, write_timing

    track, words = puppet.even_track("set white with nine again now please", 0.3, 3.4)
    write_timing(tmp_path / "t.TextGrid", Timing(track, words))
    made = tmp_path / "o.mp4"
    timing = (tmp_path / "t.TextGrid", "-o", made, "--json")
    status, out, err = run(
        "synth", own_db, *timing, "--background", sitting, "--background", "hopper2"
    )
    assert (status, err) == (0, ""), err
    assert json.loads(out)["frames"] == round(track.end * 25) == probe(made).frames
    # Longer than both together, and yet no frame jumps more than a cut between the two would.
    luma = np.stack([f.planes.y for f in read_video(made)]).astype(np.float32)
    steps = np.abs(np.diff(luma, axis=0)).mean(axis=(1, 2))
    first = next(iter(read_video(sitting))).planes.y.astype(np.float32)
    with open_database(own_db) as database:
        other = Synthesizer(database).background("hopper2")
    cut = np.abs(next(iter(read_video(other.path))).planes.y - first).mean()
    assert steps.max() < 0.7 * cut
    status, out, err = run("synth", own_db, *timing, "--background", photo)
    assert (status, err) == (0, ""), err
    width, height = probe(made).width, probe(made).height
    assert (width, height) == (puppet.WIDTH * 3 // 2, puppet.HEIGHT * 3 // 2)
    luma = np.stack([f.planes.y for f in read_video(made)]).astype(np.float32)
    # Above the nose nothing moves; below it a mouth does.
    moves = luma.std(axis=0)
    assert moves[: height // 3].mean() < 0.5
    assert moves[height // 2 :].max() > 8


def test_bad_backgrounds(
    run: Run, puppet: ModuleType, own_db: Path, sitting: Path, photo: Path, tmp_path: Path
) -> None:
    before = own_db.read_bytes()
    (tmp_path / "words.txt").write_text("no video")
    (tmp_path / "odd.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"\0" * 40)
    (tmp_path / "cut.jpg").write_bytes(photo.read_bytes()[:4000])
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((120, 160, 3), 120, np.uint8))
    track = puppet.even_track("bin", 0.1, 0.1)[0]
    with VideoWriter(tmp_path / "short.mp4", puppet.WIDTH, puppet.HEIGHT, 25) as video:
        for picture in puppet.film(track, 7):
            video.write_rgb(picture)
    with VideoWriter(tmp_path / "wall.mp4", 64, 64, 25) as video:
        for _ in range(20):
            video.write_rgb(np.full((64, 64, 3), 120, np.uint8))
    expected = {
        "none.mp4": "none.mp4",
        "words.txt": "words.txt",
        "odd.png": "odd.png: is no JPEG or PNG picture",
        "cut.jpg": "cut.jpg: cannot be read as a picture",
        "wall.png": "wall.png: shows no face",
        "wall.mp4": "wall.mp4: shows no face",
        "short.mp4": "in no more than 7 frames on end, 0.28 s; a background needs 0.5 s",
    }
    for name, message in expected.items():
        status, out, err = run("backgrounds", own_db, "--add", sitting, tmp_path / name)
        assert (status, out) == (2, "") and message in err, (name, err)
        assert err.count("\n") == 1
    for name, message in {
        "nobody": "holds no background nobody; it holds none",
        "hopper2": "hopper2 is a clip that the database was built from",
    }.items():
        status, out, err = run("backgrounds", own_db, "--remove", name)
        assert (status, out) == (2, "") and message in err
    assert own_db.read_bytes() == before


def test_a_background_that_is_gone_or_another_by_now(
    run: Run, own_db: Path, sitting: Path, tmp_path: Path
) -> None:
    mine = Path(shutil.copy(sitting, tmp_path / "mine.mp4"))
    assert run("backgrounds", own_db, "--add", mine)[0] == 0
    mine.write_bytes(mine.read_bytes() + b"more")
    with open_database(own_db) as database:
        synthesizer = Synthesizer(database)
        assert rank_backgrounds(database)[0].state == "changed"
        assert synthesizer.background().path != mine
        with pytest.raises(RenderError, match=r"mine\.mp4: .* was changed since; add it again"):
            synthesizer.background("mine")
        mine.unlink()
        with pytest.raises(RenderError, match=r"mine\.mp4: .* is no longer there"):
            synthesizer.background("mine")
        with pytest.raises(MediaError, match="nobody"):
            synthesizer.background("nobody")
    assert "missing" in run("backgrounds", own_db)[1].splitlines()[1]


def test_stored_backgrounds_are_checked(makedb: ModuleType, small_db: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(small_db, tmp_path / "a.h5"))
    before = path.read_bytes()
    good = makedb.make_backgrounds()
    for wrong in (
        {"fps": np.zeros(2)},
        {"frames": good.frames + 1},
        {"name": ("same", "same")},
        {"still": np.ones(2, np.uint8)},
        {"rotation": good.rotation * np.nan},
    ):
        with pytest.raises(DatabaseError, match="not written: backgrounds/"):
            store_backgrounds(path, type(good)(**{**vars(good), **wrong}))
    assert path.read_bytes() == before
    store_backgrounds(path, good)
    with open_database(path) as database:
        assert database.backgrounds.name == good.name
        np.testing.assert_array_equal(database.backgrounds.chin, good.chin)
        assert database.backgrounds.chosen([1]).rotation.tolist() == good.rotation[-1:].tolist()


def test_photos_are_told_by_their_content_and_stand_upright(tmp_path: Path) -> None:
    from PIL import Image

    picture = np.zeros((41, 30, 3), np.uint8)
    picture[:10] = 250
    exif = Image.Exif()
    exif[0x0112] = 6  # The camera was held turned: show it by a quarter turn to the right.
    Image.fromarray(picture).save(tmp_path / "turned.mp4", format="JPEG", exif=exif, quality=95)
    assert is_photo(tmp_path / "turned.mp4")
    upright = read_photo(tmp_path / "turned.mp4")
    assert upright.shape == (30, 40, 3)
    assert upright[:, -8:].mean() > 240 and upright[:, :-14].mean() < 10
    Image.fromarray(np.zeros((3000, 4000, 3), np.uint8)).save(tmp_path / "large.png")
    assert read_photo(tmp_path / "large.png").shape == (1440, 1920, 3)
    (tmp_path / "none.txt").write_text("words")
    assert not is_photo(tmp_path / "none.txt") and not is_photo(tmp_path / "missing.png")
