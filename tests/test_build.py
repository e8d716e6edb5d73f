"""A corpus into a database, end to end: the puppet's, a faulty one, and real faults."""

import json
import re

import numpy as np
import pytest

from analysis.build import BuildSettings, build_database
from analysis.texture import TextureSettings, describe_clip, reduce_crop
from database.errors import (
    CorpusError,
    DatabaseError,
    FaceError,
    ModelError,
    PronunciationError,
    UnitselError,
)
from database.fingerprint import content_hash
from database.phonemes import CLOSURES, PHONEMES, VISEME_OF
from database.pictures import codec_for
from database.reader import open_database
from database.timing import Timing, read_timing, write_timing
from database.track import frame_times
from database.video_writer import VideoWriter

GREY = np.full((352, 288, 3), 90, np.uint8)


@pytest.fixture(scope="module")
def db(puppet_db):
    with open_database(puppet_db) as opened:
        yield opened


@pytest.fixture
def no_traces(tmp_path):
    """Give a folder for the output; afterwards it holds databases and kept clips, nothing else."""
    folder = tmp_path / "out"
    folder.mkdir()
    yield folder
    assert [p.name for p in folder.iterdir() if p.suffix not in (".h5", ".shards")] == []
    assert not list(folder.rglob("*.partial"))


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


SHORT = ("bin blue now", "lay red soon", "place white again")


@pytest.fixture(scope="module")
def short_corpus(puppet, tmp_path_factory):
    """Three clips of a second each; one with words alone where there is speech."""
    folder = tmp_path_factory.mktemp("short")
    for seed, sentence in enumerate(SHORT):
        track, words = puppet.even_track(sentence, 0.2, 0.5)
        sound = puppet.hum(track, seed)
        if seed == 2 and puppet.can_speak():
            sound, track = puppet.speak(sentence, 0.15)
            (folder / "clip2.txt").write_text(sentence)
        else:
            write_timing(folder / f"clip{seed}.TextGrid", Timing(track, words))
        puppet.write_clip(folder / f"clip{seed}.mp4", track, sound, seed)
    return folder


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
    again = build_database(short_corpus, no_traces / "again.h5", jobs=1)
    side = build_database(short_corpus, no_traces / "side.h5", jobs=2)
    assert content_hash(again.path) == content_hash(side.path)
    assert content_hash(again.path) == content_hash(short_build[0].path)


def test_settings_change_the_content(short_corpus, short_build, no_traces):
    settings = BuildSettings(codec="webp", texture=TextureSettings(components=5))
    report = build_database(short_corpus, no_traces / "webp.h5", settings=settings, jobs=1)
    with open_database(report.path) as opened:
        assert opened.codec == "webp"
        assert opened.units.pca.shape[1] == 5
        assert opened.settings["texture"]["components"] == 5
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


@pytest.fixture(scope="module")
def faulty(puppet, short_corpus, tmp_path_factory):
    """The short corpus with a clip of every fault that a user may have."""
    folder = tmp_path_factory.mktemp("faulty")
    for path in short_corpus.iterdir():
        (folder / path.name).symlink_to(path)
    track, words = puppet.even_track("bin blue now", 0.2, 0.5)
    timing, sound = Timing(track, words), puppet.hum(track)
    n = round(track.end * puppet.FPS)

    def copy(name, *scripts):
        (folder / f"{name}.mp4").symlink_to(short_corpus / "clip0.mp4")
        for suffix in scripts:
            write_timing(folder / f"{name}{suffix}", timing)

    def film(name, pictures, fps=puppet.FPS, size=(288, 352)):
        with VideoWriter(folder / f"{name}.mp4", *size, fps, sound) as video:
            for picture in pictures:
                video.write_rgb(picture)
        write_timing(folder / f"{name}.TextGrid", timing)

    (folder / "empty.mp4").touch()
    (folder / "empty.txt").write_text("bin blue now")
    (folder / "text.mp4").write_bytes(b"this is no video\n" * 50)
    whole = (short_corpus / "clip1.mp4").read_bytes()
    (folder / "cut.mp4").write_bytes(whole[: len(whole) // 20])
    film("faceless", [GREY] * n)
    puppet.write_clip(folder / "mute.mp4", track, None)
    (folder / "mute.txt").write_text("bin blue now")
    copy("wordless")
    copy("truncated", ".TextGrid")
    grid = (folder / "truncated.TextGrid").read_bytes()
    (folder / "truncated.TextGrid").write_bytes(grid[: len(grid) * 2 // 3])
    copy("binary")
    (folder / "binary.TextGrid").write_bytes(bytes(range(256)) * 4)
    copy("unsaid")
    (folder / "unsaid.txt").write_text("internationalization notwithstanding")
    copy("foreign")
    (folder / "foreign.txt").write_text("слово")
    film("slow", puppet.film(track, n // 2), fps=12)
    # These have faults that can be lived with.
    pictures = list(puppet.film(track, n, seed=3))
    film("gaps", [GREY] * 4 + pictures[4:15] + [GREY] + pictures[16:])
    puppet.write_clip(folder / "quiet.mp4", track, None)
    write_timing(folder / "quiet.TextGrid", timing)
    film("fast", puppet.film(track, n), fps=50)
    return folder


@pytest.fixture(scope="module")
def faulty_report(faulty, face_models, tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    report = build_database(faulty, folder / "faulty.h5", jobs=2)
    assert sorted(p.name for p in folder.iterdir()) == ["faulty.h5", "faulty.h5.shards"]
    return report


REASONS = {
    "empty": r"empty\.mp4: cannot be read",
    "text": r"text\.mp4: cannot be read",
    "cut": r"cut\.mp4: ",
    "faceless": r"faceless\.mp4: shows no face that can be followed, in 25 frames",
    "mute": r"mute\.mp4: has no sound.*phone-level timing",
    "wordless": r"wordless\.mp4: has no words; put wordless\.txt",
    "truncated": r"truncated\.TextGrid",
    "binary": r"binary\.TextGrid",
    "unsaid": r"unsaid.mp4: the words .* could not be aligned",
    "foreign": r"foreign.mp4: no pronunciation for слово",
    "slow": r"slow\.mp4: has 12 frames a second, less than the corpus's 25",
}


def test_every_bad_clip_is_named_with_its_reason(faulty_report):
    skipped = dict(faulty_report.skipped)
    assert set(skipped) == set(REASONS)
    for name, reason in skipped.items():
        assert "\n" not in reason and "Traceback" not in reason and "unexpected" not in reason
        assert re.search(REASONS[name], reason), reason


def test_good_clips_beside_bad_ones_are_used(faulty_report):
    with open_database(faulty_report.path) as opened:
        assert opened.sequences.name == ("clip0", "clip1", "clip2", "fast", "gaps", "quiet")
        assert opened.report["skipped"] == [
            {"clip": c, "reason": r} for c, r in faulty_report.skipped
        ]
        assert opened.report["repaired"] == [
            {"clip": c, "note": n} for c, n in faulty_report.repaired
        ]


def test_frames_without_a_face_are_left_out_and_named(faulty_report):
    notes = dict(faulty_report.repaired)
    assert notes["gaps"] == "no face in frames 0 to 3, 15 (counted from 0); left out"
    with open_database(faulty_report.path) as opened:
        s = opened.sequences.name.index("gaps")
        mine = opened.units.sequence == s
        assert opened.sequences.frames[s] == 25
        expected = [*range(4, 15), *range(16, 25)]
        assert opened.units.frame[mine].tolist() == expected
        track = opened.sequence_track(s)
        assert track.end == pytest.approx(1.0)
        at = frame_times(25, 25)[expected]
        np.testing.assert_array_equal(opened.units.phoneme[mine], track.at(at))


def test_a_faster_clip_is_taken_at_the_corpus_rate(faulty_report):
    with open_database(faulty_report.path) as opened:
        s = opened.sequences.name.index("fast")
        assert opened.fps == 25
        assert opened.sequences.fps[s] == 50
        assert 12 <= opened.sequences.frames[s] <= 13


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


def only(folder, source, *stems):
    for path in source.iterdir():
        if path.stem in stems:
            (folder / path.name).symlink_to(path)
    return folder


@pytest.mark.parametrize(
    ("clips", "error", "message"),
    [
        (
            ("empty", "text"),
            CorpusError,
            r"no clip of the corpus can be read; the first: .*empty\.mp4",
        ),
        (("faceless",), FaceError, r"faceless.mp4: shows no face"),
        (("wordless", "binary"), CorpusError, r"none of the 2 clips could be used; the"),
    ],
)
def test_a_corpus_of_nothing_but_faults(
    faulty, face_models, tmp_path, no_traces, clips, error, message
):
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    only(corpus, faulty, *clips)
    (no_traces / "old.h5").write_bytes(b"what was there before")
    with pytest.raises(error, match=message) as caught:
        build_database(corpus, no_traces / "old.h5", jobs=1)
    assert "\n" not in str(caught.value)
    assert (no_traces / "old.h5").read_bytes() == b"what was there before"
    assert [p.name for p in no_traces.iterdir()] == ["old.h5"]


def test_guesses_are_noted_in_the_report(puppet, face_models, tmp_path, no_traces):
    if not puppet.can_speak():
        pytest.skip("needs the optional extra `espeak`")
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    sound, track = puppet.speak("blorp now", 0.2)
    for name in ("a", "b"):
        puppet.write_clip(corpus / f"{name}.mp4", track, sound)
        (corpus / f"{name}.txt").write_text("blorp now")
    report = build_database(corpus, no_traces / "x.h5", jobs=1)
    note = "pronunciation of 'blorp' guessed by espeak: b l ao r p"
    assert report.repaired == (("a", note), ("b", note))
    mine = tmp_path / "mine.dict"
    mine.write_text("blorp B L AO1 R P\n")
    # Workers live on from build to build, but each build has its own dictionary.
    for dictionary, notes in ((mine, ()), (None, (("a", note), ("b", note)))):
        report = build_database(corpus, no_traces / "x.h5", jobs=2, dictionary=dictionary)
        assert report.repaired == notes


FACELESS = ("bbizzn", "brwa4p", "brwg8p", "bwwuzn")
SHORTER = ("lrae3s", "sbbbzp")


@pytest.fixture(scope="module")
def real(corpus, face_models, tmp_path_factory):
    """Build the shared corpus's six faulty clips and two sound ones into a database."""
    names = (*FACELESS, *SHORTER, "bbaf2n", "swwp2s")
    there = [n for n in names if (corpus / f"{n}.mpg").is_file()]
    if set(FACELESS + SHORTER) - set(there):
        pytest.skip(f"needs the GRID clips {', '.join(FACELESS + SHORTER)}")
    folder = only(tmp_path_factory.mktemp("grid"), corpus, *there)
    report = build_database(folder, tmp_path_factory.mktemp("built") / "grid.h5", jobs=2)
    with open_database(report.path) as opened:
        yield report, opened


def test_real_clips_lose_just_their_faceless_frames(real):
    report, opened = real
    assert report.skipped == ()
    for name in FACELESS:
        notes = [note for clip, note in report.repaired if clip == name]
        assert sum(note.startswith("no face in frame") for note in notes) == 1, notes
        s = opened.sequences.name.index(name)
        mine = opened.units.frame[opened.units.sequence == s]
        assert mine[0] > 0, "the clip begins without a face"
        assert len(mine) > 40, "the rest of the clip is kept"
        np.testing.assert_array_equal(mine, np.arange(mine[0], opened.sequences.frames[s]))


def test_real_clips_that_are_a_frame_short_are_used(real):
    report, opened = real
    for name in SHORTER:
        s = opened.sequences.name.index(name)
        assert opened.sequences.frames[s] == opened.sequences.units[s] == 74
        assert name not in dict(report.repaired)


def test_real_mouths_close_on_closures(real):
    """GRID's commands and colours: lips are nearer on b and p than on open vowels."""
    _, opened = real
    shut = np.isin(opened.units.phoneme, list(CLOSURES))
    vowels = np.isin(opened.units.phoneme, [PHONEMES.index(p) for p in ("ay", "ae", "ey", "eh")])
    assert np.median(opened.units.mouth_height[shut]) < 0.9 * np.median(
        opened.units.mouth_height[vowels]
    )
