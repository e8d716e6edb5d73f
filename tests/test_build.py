"""A corpus into a database, end to end: its content, and what is wrong with the call."""

import json

import numpy as np
import pytest

from analysis.build import BuildSettings, build_database
from analysis.corpus_lips import LipSettings
from analysis.texture import TextureSettings, describe_clip, reduce_crop
from database.errors import (
    CorpusError,
    DatabaseError,
    ModelError,
    PronunciationError,
    UnitselError,
)
from database.fingerprint import content_hash
from database.phonemes import CLOSURES, PHONEMES, VISEME_OF
from database.pictures import codec_for
from database.reader import open_database
from database.timing import read_timing
from database.track import frame_times


@pytest.fixture(scope="module")
def db(puppet_db):
    with open_database(puppet_db) as opened:
        yield opened


def expected_opening(puppet, db, s):
    """How far the puppet opened its mouth in each unit of a sequence, 0..1."""
    name = db.sequences.name[s]
    track = puppet.speak(puppet.SPOKEN[name])[1] if name in puppet.SPOKEN else db.sequence_track(s)
    names = [PHONEMES[p] for p in track.at(frame_times(int(db.sequences.frames[s]), puppet.FPS))]
    opened = np.array([puppet.OPENNESS.get(p, 0.0) for p in names])
    smooth = np.convolve(np.pad(opened, 1, "edge"), [0.25, 0.5, 0.25], "valid")
    return smooth[db.units.frame[db.units.sequence == s]]


def test_the_report_counts(puppet, puppet_corpus, puppet_report, db):
    clips = sorted(p.stem for p in puppet_corpus.glob("*.mp4"))
    assert db.sequences.name == tuple(clips)
    assert puppet_report.sequences == len(clips)
    assert puppet_report.units == len(db) == db.sequences.units.sum()
    assert puppet_report.skipped == () and puppet_report.repaired == ()
    assert db.fps == puppet.FPS
    assert json.loads(json.dumps(puppet_report.as_json()))["units"] == len(db)
    assert (db.sequences.units == db.sequences.frames).all(), "every frame shows the face"


def test_phones_come_from_the_files(puppet_corpus, db):
    for s, name in enumerate(db.sequences.name):
        beside = puppet_corpus / f"{name}.TextGrid"
        if not beside.is_file():
            continue
        timing = read_timing(beside)
        track = db.sequence_track(s)
        assert track.labels == timing.phones.labels
        np.testing.assert_allclose(track.boundaries, timing.phones.boundaries, atol=1e-6)
        assert db.sequences.words[s] == " ".join(timing.words.words)


def test_units_name_their_phonemes(puppet, db):
    for s in range(len(db.sequences)):
        mine = db.units.sequence == s
        at = frame_times(int(db.sequences.frames[s]), puppet.FPS)[db.units.frame[mine]]
        np.testing.assert_array_equal(db.units.phoneme[mine], db.sequence_track(s).at(at))
    np.testing.assert_array_equal(db.units.viseme, VISEME_OF[db.units.phoneme])


def test_speech_is_aligned_in_the_build(puppet, db):
    spoken = [s for s, name in enumerate(db.sequences.name) if name in puppet.SPOKEN]
    if not spoken:
        pytest.skip("needs speech: the optional extra `espeak`")
    for s in spoken:
        truth = puppet.speak(puppet.SPOKEN[db.sequences.name[s]])[1]
        at = frame_times(int(truth.end * 50), 50)
        same = VISEME_OF[db.sequence_track(s).at(at)] == VISEME_OF[truth.at(at)]
        assert same.mean() > 0.75


def test_mouths_are_measured_as_the_puppet_moved_them(puppet, db):
    """Opening, height and the first component follow what was drawn."""
    for s in range(len(db.sequences)):
        mine = db.units.sequence == s
        expected = expected_opening(puppet, db, s)
        for values in (db.units.inner_opening, db.units.mouth_height, db.units.pca[:, 0]):
            assert np.corrcoef(values[mine], expected)[0, 1] > 0.85
    spoken_shut = np.isin(db.units.phoneme, list(CLOSURES))
    opened = np.isin(db.units.phoneme, [PHONEMES.index(p) for p in ("aa", "ae", "ay", "aw")])
    assert np.median(db.units.inner_opening[spoken_shut]) < 4
    assert np.median(db.units.inner_opening[opened]) > 8


def test_teeth_show_where_they_were_drawn(puppet, db):
    toothy = np.isin(db.units.phoneme, [PHONEMES.index(p) for p in puppet.TOOTHY])
    silent = db.units.phoneme == 0
    assert db.units.teeth[toothy].mean() > 5 * db.units.teeth[silent].mean()
    assert db.units.tongue.max() < 0.2, "none was drawn"


def test_head_motion_is_out_of_the_crops_and_in_the_poses(puppet, db):
    """The patch of skin above the lips stands still while the head moves by pixels."""
    mine = np.flatnonzero((db.units.sequence == 0) & (db.units.inner_opening < 2))
    crops = db.pictures(mine).astype(np.float32)
    still = crops[:, : crops.shape[1] // 5].std(axis=0).mean()
    assert still < 6
    turns = puppet.head_motion(int(db.sequences.frames[0]), seed=0)
    roll = np.arctan2(turns[:, 1, 0], turns[:, 0, 0])[db.units.frame[db.units.sequence == 0]]
    measured = db.units.rotation[db.units.sequence == 0][:, 2]
    assert np.corrcoef(roll, measured)[0, 1] > 0.97
    assert np.ptp(measured) == pytest.approx(np.ptp(roll), rel=0.2)


def test_stored_pictures_give_the_stored_weights(db):
    """A clip of the database described as a foreign one has nearly the weights that it has.

    They were found in the crops as they were before encoding lost a little of them.
    """
    for s in (0, len(db.sequences) - 1):
        mine = np.flatnonzero(db.units.sequence == s)
        reduced = np.stack([reduce_crop(p) for p in db.pictures(mine)])
        weights = describe_clip(reduced, db.texture)
        assert np.abs(weights - db.units.pca[mine]).max() < 1e-2 * np.abs(db.units.pca).max()


def test_everything_is_finite_and_in_range(db):
    for name in ("pca", "mouth_width", "mouth_height", "inner_opening", "rotation", "translation"):
        assert np.isfinite(getattr(db.units, name)).all(), name
    for name in ("teeth", "tongue"):
        values = getattr(db.units, name)
        assert values.min() >= 0 and values.max() <= 1, name
    assert (db.units.mouth_width > 30).all() and (db.units.mouth_width < 80).all()
    assert db.costs.phoneme_distance.shape == (43, 43)
    patch = db.mask.patch
    assert db.settings["codec"] == db.codec == codec_for(patch.crop_width, patch.crop_height)
    assert set(db.versions) >= {"unitsel", "numpy"}


@pytest.fixture(scope="module")
def short_build(short_corpus, face_models, tmp_path_factory):
    """Give a build's report, and what was told of its progress."""
    told = []
    output = tmp_path_factory.mktemp("built") / "one.h5"
    report = build_database(
        short_corpus, output, jobs=1, progress=lambda *stage: told.append(stage)
    )
    return report, told


def test_builds_do_not_depend_on_jobs_or_repetition(short_corpus, short_build, no_traces):
    side = build_database(short_corpus, no_traces / "side.h5", jobs=2)
    assert content_hash(side.path) == content_hash(short_build[0].path)


def test_settings_change_the_content(short_corpus, short_build, no_traces):
    settings = BuildSettings(
        codec="webp",
        texture=TextureSettings(components=5),
        lips=LipSettings(source="mesh-only"),
    )
    report = build_database(short_corpus, no_traces / "webp.h5", settings=settings, jobs=1)
    with open_database(report.path) as opened:
        assert opened.codec == "webp"
        assert opened.units.pca.shape[1] == 5
        assert opened.settings["texture"]["components"] == 5
        assert opened.lips is None
    assert content_hash(report.path) != content_hash(short_build[0].path)


def test_progress_is_told(short_build):
    _, told = short_build
    stages = list(dict.fromkeys(stage for stage, _, _ in told))
    assert stages == [
        "finding the person",
        "analysing clips",
        "describing mouths",
        "training the lip model",
        "fitting lips",
        "writing",
    ]
    for stage in stages:
        done = [d for s, d, _ in told if s == stage]
        (total,) = {t for s, _, t in told if s == stage}
        assert done == sorted(done) and done[-1] == total, stage


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"output": "nowhere/x.h5"}, DatabaseError, "nowhere does not exist; make it first"),
        ({"output": "."}, DatabaseError, "is a folder; name a file"),
        ({"jobs": 0}, CorpusError, "at least 1, not 0"),
        ({"corpus": "none"}, CorpusError, "none: is not a folder"),
        ({"exclude": ["clip7"]}, CorpusError, "'clip7' to exclude; near it: clip"),
        ({"limit": 0}, CorpusError, "at least 1, not 0"),
        ({"models": "none"}, ModelError, "face_detection_short_range.tflite: cannot be read"),
        ({"dictionary": "none.dict"}, PronunciationError, r"none\.dict"),
        ({"settings": BuildSettings(codec="gif")}, UnitselError, "gif"),
    ],
)
def test_what_is_wrong_with_the_call(
    short_corpus, face_models, no_traces, monkeypatch, arguments, error, message
):
    monkeypatch.chdir(no_traces)
    given = {"corpus": short_corpus, "output": "x.h5", "jobs": 1} | arguments
    with pytest.raises(error, match=message) as caught:
        build_database(**given)
    assert "\n" not in str(caught.value)
    assert list(no_traces.iterdir()) == []
