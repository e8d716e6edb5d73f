"""Clips with faults: each is named with its reason, made-up ones and real ones of GRID."""

import re

import numpy as np
import pytest

from analysis.build import BuildSettings, build_database
from analysis.corpus_lips import LipSettings
from database.errors import CorpusError, FaceError
from database.phonemes import CLOSURES, PHONEMES
from database.reader import open_database
from database.timing import Timing, write_timing
from database.track import frame_times
from database.video_writer import VideoWriter

GREY = np.full((352, 288, 3), 90, np.uint8)
QUICK = BuildSettings(lips=LipSettings(source="mesh-only"))


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
    report = build_database(faulty, folder / "faulty.h5", settings=QUICK, jobs=2)
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
    note = "pronunciation of 'blorp' guessed by espeak: b l ao r p"
    mine = tmp_path / "mine.dict"
    mine.write_text("blorp B L AO1 R P\n")
    # Workers live on from build to build, but each build has its own dictionary.
    for dictionary, notes in ((mine, ()), (None, (("a", note), ("b", note)))):
        report = build_database(
            corpus, no_traces / "x.h5", settings=QUICK, jobs=2, dictionary=dictionary
        )
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
