"""What goes into a database comes out of it."""

import pickle
from dataclasses import fields

import numpy as np
import pytest

from database.errors import DatabaseError
from database.phonemes import PHONEMES, SILENCE
from database.pictures import encode
from database.reader import open_database
from database.track import PhonemeTrack
from database.writer import library_versions, write_database

SIZE = {"sequences": 3, "frames": 60, "crop": (20, 22)}


@pytest.fixture(scope="module")
def made(makedb):
    return makedb.make_content(**SIZE)


@pytest.fixture(scope="module")
def path(makedb, tmp_path_factory):
    return makedb.make_database(tmp_path_factory.mktemp("roundtrip") / "a b.h5", **SIZE)


@pytest.fixture
def db(path):
    with open_database(path) as database:
        yield database


@pytest.mark.parametrize("part", ["units", "sequences", "phones", "texture", "costs"])
def test_every_field_comes_back_as_it_was(db, made, part):
    given, read = getattr(made[0], part), getattr(db, part)
    for f in fields(given):
        a, b = getattr(given, f.name), getattr(read, f.name)
        assert type(a) is type(b), f.name
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, f.name
            np.testing.assert_array_equal(a, b, err_msg=f.name)
        else:
            assert a == b, f.name


def test_the_rest_comes_back_too(db, made):
    content, pictures, landmarks = made
    assert (db.fps, db.codec, len(db)) == (content.fps, "png", len(pictures))
    assert db.camera == content.camera
    assert type(db.camera.width) is int
    assert db.settings == content.settings
    assert db.report == content.report
    assert db.versions == library_versions()
    assert {"unitsel", "numpy", "opencv"} <= set(db.versions)
    np.testing.assert_array_equal(db.mask.vertices, content.mask.vertices)
    np.testing.assert_array_equal(db.mask.patch.grid, content.mask.patch.grid)
    assert (db.mask.patch.crop_width, db.mask.patch.crop_height) == SIZE["crop"]
    np.testing.assert_array_equal(db.pictures(range(len(db))), pictures)
    np.testing.assert_array_equal(db.landmarks(slice(None)), landmarks)


def test_pictures_and_landmarks_come_in_the_order_asked_for(db, made):
    _, pictures, landmarks = made
    order = np.random.default_rng(1).integers(len(db), size=100)
    np.testing.assert_array_equal(db.pictures(order), [pictures[i] for i in order])
    np.testing.assert_array_equal(db.landmarks(order), landmarks[order])
    np.testing.assert_array_equal(db.landmarks(slice(5, 80, 7)), landmarks[5:80:7])
    np.testing.assert_array_equal(db.picture(np.int32(7)), pictures[7])
    assert db.pictures([]).shape == (0, 22, 20, 3)
    assert db.landmarks([]).shape == (0, 468, 2)


def test_webp_pictures_are_near(makedb, tmp_path, made):
    path = makedb.make_database(tmp_path / "w.h5", codec="webp", **SIZE)
    with open_database(path) as db:
        assert db.codec == "webp"
        apart = np.abs(db.picture(4).astype(int) - made[1][4])
        assert 0 < apart.mean() < 6


def test_text_of_all_the_world_comes_back(makedb, tmp_path):
    names = ["", "χρόνος", "发音 clip"]
    content, pictures, landmarks = makedb.make_content(names=names, **SIZE)
    content.settings["note"] = "ñ" * 100_000
    write_database(tmp_path / "u.h5", content, [encode(p) for p in pictures], landmarks)
    with open_database(tmp_path / "u.h5") as db:
        assert db.sequences.name == tuple(names)
        assert db.settings["note"] == "ñ" * 100_000


def test_tracks_are_those_of_the_clips(db, made):
    phones = made[0].phones
    for s, name in enumerate(db.sequences.name):
        track = db.sequence_track(s)
        assert track.name == name
        mine = phones.sequence == s
        np.testing.assert_array_equal(track.phonemes, phones.phoneme[mine])
        np.testing.assert_array_equal(track.boundaries[:-1], phones.start[mine])
        np.testing.assert_array_equal(track.boundaries[1:], phones.end[mine])


def test_context_is_what_each_units_track_says_at_the_times_around_it(db):
    """Against a plain loop over times; sequence 1 has frames without a face."""
    n = 5
    context = db.context(n)
    assert context.dtype == np.uint8 and context.shape == (len(db), 2 * n + 1)
    gaps = np.diff(db.units.frame)[np.diff(db.units.sequence) == 0]
    assert gaps.max() > 1
    for i in range(len(db)):
        phones = [
            (a, b, p)
            for q, a, b, p in zip(
                *(db.phones.sequence, db.phones.start, db.phones.end, db.phones.phoneme),
                strict=True,
            )
            if q == db.units.sequence[i]
        ]
        for k in range(-n, n + 1):
            time = (db.units.frame[i] + k + 0.5) / db.fps
            spoken = [p for a, b, p in phones if a <= time < b]
            assert context[i, k + n] == (spoken[0] if spoken else SILENCE)
    np.testing.assert_array_equal(context[:, n], db.units.phoneme)
    np.testing.assert_array_equal(db.context(0)[:, 0], db.units.phoneme)


def test_a_unit_out_of_range_is_refused(db):
    n = len(db)
    for i in (-1, n, 10**12):
        with pytest.raises(DatabaseError, match=f"a b.h5: there is no unit {i}; it has 0..{n - 1}"):
            db.picture(i)
        for read in (db.pictures, db.landmarks):
            with pytest.raises(DatabaseError, match=f"no unit {i}"):
                read([0, i])
    with pytest.raises(DatabaseError, match="no sequence 3"):
        db.sequence_track(3)
    for strange in (1.0, "1", None):
        with pytest.raises(DatabaseError, match="is no number of a unit"):
            db.picture(strange)
    with pytest.raises(DatabaseError, match="list of their numbers"):
        db.landmarks([0.5])


def test_arrays_are_kept_and_cannot_be_changed(db):
    assert db.units is db.units
    assert db.context(3) is db.context(3)
    for array in (db.units.pca, db.phones.start, db.costs.phoneme_distance, db.context(3)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_after_closing_everything_is_refused(path):
    db = open_database(path)
    db.units, db.context(2), db.picture(0), db.fps
    db.close()
    db.close()
    assert "closed" in repr(db)
    reads = [
        *(lambda n=n: getattr(db, n) for n in ("fps", "codec", "settings", "versions", "report")),
        *(lambda n=n: getattr(db, n) for n in ("units", "sequences", "phones", "mask", "camera")),
        *(lambda n=n: getattr(db, n) for n in ("texture", "costs")),
        lambda: db.picture(0),
        lambda: db.pictures([]),
        lambda: db.landmarks([0]),
        lambda: db.context(2),
        lambda: db.sequence_track(0),
    ]
    for read in reads:
        with pytest.raises(DatabaseError, match="was closed; open it again"):
            read()


def test_a_pickled_database_opens_the_file_again(db):
    with pickle.loads(pickle.dumps(db)) as copy:
        assert copy is not db
        np.testing.assert_array_equal(copy.picture(2), db.picture(2))


def test_the_made_up_content_is_what_it_says(makedb):
    """The helper that other tests lean on: repeatable, and its fields agree with one another."""
    content, pictures, landmarks = makedb.make_content(seed=3, frames=80, fps=50.0)
    again = makedb.make_content(seed=3, frames=80, fps=50.0)
    np.testing.assert_array_equal(content.units.pca, again[0].units.pca)
    np.testing.assert_array_equal(pictures, again[1])
    np.testing.assert_array_equal(landmarks, again[2])
    other = makedb.make_content(seed=4, frames=80, fps=50.0)[0]
    assert not np.array_equal(content.units.pca[:50], other.units.pca[:50])
    units = content.units
    distance = content.costs.phoneme_distance
    np.testing.assert_allclose(distance, distance.T)
    assert not distance.diagonal().any()
    assert np.corrcoef(units.pca[:, 0], units.mouth_height)[0, 1] > 0.7
    for s in range(6):
        mine = units.phoneme[units.sequence == s]
        assert mine[0] == mine[-1] == SILENCE and len(np.unique(mine)) > 4
    lacking = {PHONEMES.index(p) for p in makedb.LACKING}
    assert not lacking & set(units.phoneme.tolist())
    assert list(content.sequences.units) == [80, 74, 80, 80, 80, 80]
    # The mesh opens as the mouth does: lips' points 13 and 14, in pixels.
    opening = np.hypot(*(landmarks[:, 14] - landmarks[:, 13]).T)
    assert np.corrcoef(opening, units.inner_opening)[0, 1] > 0.99
    PhonemeTrack(content.phones.phoneme[:3], content.phones.start[:4])
