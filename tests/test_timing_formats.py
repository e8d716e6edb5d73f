"""Each timing format: what is read from its fixture, and what is written comes back."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pocketsphinx.to_textgrid import json_to_textgrid

from database.errors import TimingError
from database.phonemes import PHONEMES
from database.timing import (
    FORMATS,
    Format,
    Timing,
    WordTrack,
    read_timing,
    timing_extensions,
    timing_formats,
    write_timing,
)
from database.track import PhonemeTrack

DATA = Path(__file__).parent / "data" / "timing"

# Fixture, phones with their ends, words with starts and ends, duration of the word track.
EXPECTED: list[tuple[str, str | None, Sequence[float], str | None, Sequence[float], float]] = [
    ("long-words-and-phones-with-stress.TextGrid", "sil b ah t ax n sil",
     [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.9], "button", [0.2, 0.7], 0.9),
    ("short-phones-by-content.TextGrid", "b iy ih t", [0.1, 0.3, 0.4, 0.5], None, [], 0),
    ("label-with-quotes-and-intervals.TextGrid", "m aa", [0.2, 0.4], None, [], 0),
    ("utf16-with-point-tier.TextGrid", "sh ay", [0.1, 0.3], None, [], 0),
    ("words-only.TextGrid", None, [], "bin a", [0, 0.4, 0.4, 0.8], 1.0),
    ("htk-phones-with-scores.lab", "sil b ih n", [0.15, 0.21, 0.29, 0.35], None, [], 0),
    ("htk-words.lab", None, [], "bin blue", [0.15, 0.41, 0.41, 0.5], 0.6),
    ("mbrola-pitch-and-comments.pho", "sil ae er ch ax n sil",
     [0.051, 0.1135, 0.2405, 0.3505, 0.3905, 0.4305, 0.4505], None, [], 0),
    ("grid-words.align", None, [], "bin red", [0.62, 0.84, 0.86, 1.04], 2.98),
    ("mfa-words-phones-utterances.csv", "sil r eh d", [0.1, 0.2, 0.4, 0.5], "red",
     [0.1, 0.5], 0.5),
    ("plain-header-and-empty-label.csv", "sil m ax sil", [0.25, 0.5, 0.75, 1], None, [], 0),
    ("plain-semicolons-no-header-and-gap.csv", "m sil ey", [0.25, 0.3, 0.5], None, [], 0),
    ("plain-words-with-tabs.csv", None, [], "the cat", [0.1, 0.2, 0.25, 0.5], 0.5),
    ("mfa-tiers.json", "sil r ey sil", [0.1, 0.2, 0.5, 0.6], "ray", [0.1, 0.5], 0.6),
    ("pocketsphinx-nested.json", "sil ey b iy", [0.1, 0.3, 0.38, 0.5], "a b",
     [0.1, 0.3, 0.3, 0.5], 0.5),
    ("pocketsphinx-two-utterances-of-phones.json", "sil m aa", [0.1, 0.2, 0.3], None, [], 0),
    ("elan-participants-and-rounding.TextGrid", "sil b ih n ey sil",
     [0.1, 0.2, 0.3, 0.4, 0.8, 1.2], "bin a", [0.1, 0.4, 0.4, 0.8], 1.2),
    ("utf16-big-endian-no-mark-short.TextGrid", "sh ay", [0.2, 0.5], None, [], 0),
    ("utf16-little-endian-no-mark-long.TextGrid", "sh ay", [0.2, 0.5], None, [], 0),
    ("utf16-big-endian-mark.TextGrid", "sh ay", [0.2, 0.5], None, [], 0),
    ("gentle-not-found-and-disfluency.json", "sil s iy ah ey sil n aa t",
     [0.1, 0.21, 0.31, 0.4, 0.5, 0.6, 0.68, 0.8, 0.9], "See uh a not",
     [0.1, 0.31, 0.31, 0.4, 0.4, 0.5, 0.6, 0.9], 0.9),
    ("gentle-unknown-word.json", None, [], "See uh a not",
     [0.1, 0.31, 0.31, 0.4, 0.4, 0.5, 0.6, 0.9], 0.9),
    ("rhubarb-cues.json", "sil aa eh s sil", [0.05, 0.27, 0.31, 0.43, 0.47], None, [], 0),
    ("rhubarb-lines.tsv", "sil aa eh s sil", [0.05, 0.27, 0.31, 0.43, 0.47], None, [], 0),
    ("ctm-phones-with-positions.ctm", "sil b ix n", [0.1, 0.18, 0.29, 0.41], None, [], 0),
    ("ctm-words-with-alternatives.ctm", None, [], "bin blue", [0.1, 0.3, 0.3, 0.6], 0.6),
    ("srt-cues-with-tags.srt", None, [], "Bin blue at F two",
     [0.5, 0.842857, 0.842857, 1.3, 1.3, 1.533333, 1.533333, 1.65, 1.65, 2], 2.0),
    ("vtt-settings-and-inner-times.vtt", None, [], "Bin blue a&b",
     [0.5, 1.0, 1.0, 1.4, 1.4, 2.0], 2.0),
]  # fmt: skip


@pytest.mark.parametrize("expected", EXPECTED, ids=lambda e: e[0])
def test_the_fixture_is_read(
    expected: tuple[str, str | None, Sequence[float], str | None, Sequence[float], float],
) -> None:
    file, phones, ends, words, times, duration = expected
    timing = read_timing(DATA / file)
    if phones is None:
        assert timing.phones is None
    else:
        assert timing.phones is not None
        assert timing.phones.labels == tuple(phones.split())
        assert timing.phones.boundaries[1:].tolist() == pytest.approx(ends)
    if words is None:
        assert timing.words is None
    else:
        assert timing.words is not None
        assert timing.words.words == tuple(words.split())
        both = zip(timing.words.starts, timing.words.ends, strict=True)
        assert [t for pair in both for t in pair] == pytest.approx(times, abs=1e-6)
        assert timing.words.duration == pytest.approx(duration)


def test_every_fixture_is_expected_to_hold_something() -> None:
    timed = {f.name for f in DATA.iterdir() if not f.name.startswith("words-with")}
    assert timed == {e[0] for e in EXPECTED}


def test_every_extension_has_a_fixture() -> None:
    assert {Path(e[0]).suffix.lower() for e in EXPECTED} == set(timing_extensions())
    assert timing_formats() == FORMATS
    assert len({f.name for f in FORMATS}) == len(FORMATS)


PHONES = PhonemeTrack(
    np.array([0, *range(1, len(PHONEMES)), 0]), np.cumsum([0.0, *[0.0437] * (len(PHONEMES) + 1)])
)
WORDS = WordTrack(("bin", "o'clock", "x"), (0.1, 0.51234, 1.0), (0.5, 0.6, 1.2), duration=1.5)

RESOLUTION = {"htk": 1e-7, "grid": 1 / 25000, "mbrola": 1e-6, "ctm": 1.1e-6, "srt": 1e-3,
              "vtt": 1e-3}  # fmt: skip
SHAPES = [f for f in FORMATS if f.name.startswith("rhubarb")]
HOLDS_PHONES = [f for f in FORMATS if f.name not in ("grid", "srt", "vtt") and f not in SHAPES]
HOLDS_WORDS = [f for f in FORMATS if f.name != "mbrola" and f not in SHAPES]
HOLDS_BOTH = [
    f for f in FORMATS if f.name.startswith("textgrid") or f.name in ("mfa-csv", "mfa-json",
                                                                      "pocketsphinx")
]  # fmt: skip
NO_DURATION = ("mfa-csv", "gentle", "ctm", "srt", "vtt")
"""Formats without a place for the silence after the last word."""


def same_phones(a: PhonemeTrack | None, b: PhonemeTrack | None, form: Format) -> None:
    assert a is not None
    assert b is not None
    wanted = tuple("hh" if p == "h" and form.name == "mbrola" else p for p in b.labels)
    times = b.boundaries.tolist()
    if form.name == "gentle" and wanted[-1] == "sil":
        wanted, times = wanted[:-1], times[:-1]
    assert a.labels == wanted
    step = RESOLUTION.get(form.name, 1e-9)
    assert a.boundaries.tolist() == pytest.approx(times, abs=step)


def same_words(a: WordTrack | None, b: WordTrack | None, form: Format) -> None:
    assert a is not None
    assert b is not None
    step = RESOLUTION.get(form.name, 1e-9)
    assert a.words == b.words
    assert a.starts == pytest.approx(b.starts, abs=step)
    assert a.ends == pytest.approx(b.ends, abs=step)
    if form.name not in NO_DURATION:
        assert a.duration == pytest.approx(b.duration, abs=step)


@pytest.mark.parametrize("form", HOLDS_PHONES, ids=lambda f: f.name)
def test_phones_come_back(form: Format, tmp_path: Path) -> None:
    file = tmp_path / f"out{form.extensions[0]}"
    write_timing(file, PHONES, form.name)
    same_phones(read_timing(file).phones, PHONES, form)
    assert [f.name for f in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize("form", HOLDS_WORDS, ids=lambda f: f.name)
def test_words_come_back(form: Format, tmp_path: Path) -> None:
    file = tmp_path / f"out{form.extensions[0]}"
    write_timing(file, WORDS, form.name)
    again = read_timing(file)
    assert again.phones is None
    same_words(again.words, WORDS, form)


@pytest.mark.parametrize("form", HOLDS_BOTH, ids=lambda f: f.name)
def test_phones_and_words_come_back(form: Format, tmp_path: Path) -> None:
    file = tmp_path / f"out{form.extensions[0]}"
    write_timing(file, Timing(PHONES, WORDS), form.name)
    again = read_timing(file)
    same_phones(again.phones, PHONES, form)
    same_words(again.words, WordTrack(WORDS.words, WORDS.starts, WORDS.ends, PHONES.end), form)


@st.composite
def tracks(draw: st.DrawFn) -> PhonemeTrack:
    lengths = draw(st.lists(st.floats(0.001, 3.0), min_size=1, max_size=10))
    spoken = st.sampled_from([i for i, p in enumerate(PHONEMES) if p != "h"])
    return PhonemeTrack(np.array([draw(spoken) for _ in lengths]), np.cumsum([0.0, *lengths]))


@settings(deadline=None, max_examples=40)
@given(tracks(), st.sampled_from([f for f in HOLDS_PHONES if f.name != "gentle"]))
def test_any_track_comes_back(
    tmp_path_factory: pytest.TempPathFactory, t: PhonemeTrack, form: Format
) -> None:
    file = tmp_path_factory.mktemp("any") / f"out{form.extensions[0]}"
    write_timing(file, t, form.name)
    same_phones(read_timing(file).phones, t, form)


@pytest.mark.parametrize("form", FORMATS, ids=lambda f: f.name)
def test_a_track_that_starts_late_keeps_its_times(form: Format, tmp_path: Path) -> None:
    file = tmp_path / f"out{form.extensions[0]}"
    late = PhonemeTrack(np.array([1, 2]), np.array([0.5, 0.6, 0.7]))
    if form in SHAPES:
        write_timing(file, late, form.name)
        shown = read_timing(file).phones
        assert shown is not None
        assert shown.labels == ("sil", "eh")
        assert shown.boundaries.tolist() == pytest.approx([0, 0.5, 0.7])
        return
    if form not in HOLDS_PHONES:
        with pytest.raises(TimingError, match=r"out\.(align|srt|vtt): .*needs? words"):
            write_timing(file, late, form.name)
        assert not list(tmp_path.iterdir())
        return
    write_timing(file, late, form.name)
    again = read_timing(file).phones
    assert again is not None
    assert again.labels == ("sil", "ae", "ax")
    assert again.boundaries.tolist() == pytest.approx([0, 0.5, 0.6, 0.7])


def test_the_extension_may_be_written_in_any_case(tmp_path: Path) -> None:
    for name in ("a.textgrid", "a.TEXTGRID", "a.Lab"):
        write_timing(tmp_path / name, PHONES)
        assert read_timing(str(tmp_path / name)).phones is not None


def test_the_default_textgrid_is_long_and_the_default_json_mfas(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.TextGrid", PHONES)
    assert "intervals [1]:" in (tmp_path / "a.TextGrid").read_text()
    write_timing(tmp_path / "a.json", PHONES)
    assert set(json.loads((tmp_path / "a.json").read_text())) == {"start", "end", "tiers"}


def test_htk_times_are_whole_units_of_100_ns(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.lab", PhonemeTrack(np.array([0, 1]), np.array([0, 0.1, 1 / 3])))
    assert (tmp_path / "a.lab").read_text() == "0 1000000 sil\n1000000 3333333 ae\n"


def test_mbrola_lengths_add_up_to_the_times(tmp_path: Path) -> None:
    t = PhonemeTrack(np.full(3000, 2), np.linspace(0, 100, 3001))
    write_timing(tmp_path / "a.pho", t)
    lengths = [float(line.split()[1]) for line in (tmp_path / "a.pho").read_text().splitlines()]
    assert sum(lengths) == pytest.approx(100_000, abs=1e-3)


def test_the_writer_of_grid_marks_silences(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.align", WordTrack(("a", "b"), (0.2, 0.5), (0.4, 0.6), 1.0))
    assert (tmp_path / "a.align").read_text() == (
        "0 5000 sil\n5000 10000 a\n10000 12500 sil\n12500 15000 b\n15000 25000 sil\n"
    )


def test_pocketsphinx_phones_are_nested_in_their_words(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.json", read_timing(DATA / "pocketsphinx-nested.json"),
                 "pocketsphinx")  # fmt: skip
    value = json.loads((tmp_path / "a.json").read_text())
    nested = [(w["t"], [p["t"] for p in w["w"]]) for w in value["w"]]
    assert nested == [("<sil>", ["sil"]), ("a", ["ey"]), ("b", ["b", "iy"])]


def test_the_textgrid_that_pocketsphinx_makes_of_its_json(tmp_path: Path) -> None:
    fixture = DATA / "pocketsphinx-nested.json"
    with (tmp_path / "a.TextGrid").open("w") as out:
        json_to_textgrid(json.loads(fixture.read_text()), out)
    theirs, ours = read_timing(tmp_path / "a.TextGrid"), read_timing(fixture)
    same_phones(theirs.phones, ours.phones, FORMATS[0])
    same_words(theirs.words, ours.words, FORMATS[0])


def test_an_alphabet_can_be_named(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("0,0.5,a\n0.5,1,s\n")
    for alphabet, vowel in (("sampa", "aa"), ("espeak", "ae"), ("ipa", "ae")):
        track = read_timing(file, alphabet).phones
        assert track is not None
        assert track.labels == (vowel, "s")


def test_a_label_of_several_phonemes_is_split(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("0,0.4,ɑːɹ\n0.4,0.6,t\n", encoding="utf-8")
    track = read_timing(file).phones
    assert track is not None
    assert track.labels == ("aa", "r", "t")
    assert track.boundaries.tolist() == pytest.approx([0, 0.2, 0.4, 0.6])
