"""Gentle, Rhubarb, CTM, subtitles and ELAN's TextGrids: what each means and cannot carry."""

import json
from pathlib import Path

import numpy as np
import pytest

from database.errors import TimingError
from database.phonemes import PHONEMES
from database.timing import Timing, WordTrack, parse_timing, read_timing, write_timing
from database.timing.rhubarb import SHAPES, STAND_INS
from database.track import Interval, PhonemeTrack

DATA = Path(__file__).parent / "data" / "timing"
GRID = 'File type = "ooTextFile"\nObject class = "TextGrid"\n0\n1\n<exists>\n'


def read(name: str, text: str) -> Timing:
    return parse_timing(name, text.encode())


def said(name: str, text: str) -> str:
    with pytest.raises(TimingError) as caught:
        read(name, text)
    message = str(caught.value)
    assert message.startswith(f"{name}: ") and "\n" not in message
    return message.removeprefix(f"{name}: ")


def track(*spans: tuple[float, float, str]) -> PhonemeTrack:
    return PhonemeTrack.from_intervals([Interval(*s) for s in spans])


# Gentle


def test_gentle_words_and_phones_come_back(tmp_path: Path) -> None:
    phones = track((0.1, 0.2, "b"), (0.2, 0.3, "ih"), (0.3, 0.4, "n"), (0.5, 0.7, "ey"),
                   (0.7, 0.9, "sil"), (0.9, 1.0, "s"))  # fmt: skip
    words = WordTrack(("bin", "a"), (0.1, 0.5), (0.4, 0.75))
    file = tmp_path / "a.json"
    write_timing(file, Timing(phones, words), "gentle")
    again = read_timing(file)
    assert again.words == words
    assert again.phones is not None
    # What ends word "a" early is silence, whether the phones or the word say so.
    assert again.phones.labels == ("sil", "b", "ih", "n", "sil", "ey", "sil", "sil", "s")
    assert again.phones.end == pytest.approx(1.0)
    value = json.loads(file.read_text())
    assert value["transcript"] == "bin a"
    assert [w["case"] for w in value["words"]] == ["success"] * 2 + ["not-found-in-transcript"]
    assert [value["transcript"][w["startOffset"] : w["endOffset"]] for w in value["words"][:2]] == [
        "bin",
        "a",
    ]
    with pytest.raises(TimingError, match="silence only"):
        write_timing(file, track((0, 1, "sil")), "gentle")


def test_a_word_that_gentle_did_not_find_is_left_out() -> None:
    timing = read_timing(DATA / "gentle-not-found-and-disfluency.json")
    assert timing.words is not None and "zyx" not in timing.words.words
    assert "holds no word that was found" in said(
        "a.json", '{"words": [{"word": "a", "case": "not-found-in-audio"}]}'
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ('{"word": "a", "case": "lost"}', "word 1: expected the case 'success', 'not-found"),
        ('{"word": "a", "start": 0}', "word 1: expected a member 'end', got ['word', 'start']"),
        ('{"start": 0}', "word 1: expected a member 'word'"),
        ('{"word": "a", "start": 0, "end": NaN}', "word 1: expected 'end' in seconds as a finite"),
        ('{"word": "a", "start": 0, "end": 1e7}', "word 1: expected times below 1e+06 s"),
        ('{"word": "a", "start": 0, "end": 1, "phones": [{"phone": "ah_S", "duration": 3}]}',
         "word 1: expected phones as long as the word, 1 s, got 3 s"),
        ('{"word": "a", "start": 0, "end": 1, "phones": [{"phone": "ah_S", "duration": -1}]}',
         "word 1, phone 1: expected a duration of 0 or more, got -1"),
        ('{"word": "a", "start": 0, "end": 1, "phones": [{"phone": "qq_S", "duration": 1}]}',
         "word 1, phone 1: unknown phoneme 'qq'"),
    ],
)  # fmt: skip
def test_gentle_that_cannot_be_read(word: str, message: str) -> None:
    assert said("a.json", f'{{"words": [{word}]}}').startswith(message)


def test_a_word_named_like_a_member_does_not_mislead() -> None:
    """GRID says the letter w; pocketsphinx and MFA name members so."""
    words = (
        '{"words": [{"word": "w", "start": 0, "end": 1}, {"word": "tiers", "start": 1, "end": 2}]}'
    )
    timing = read("a.json", words)
    assert timing.words is not None and timing.words.words == ("w", "tiers")


# Rhubarb


def test_every_phoneme_has_a_shape_and_every_shape_a_phoneme() -> None:
    assert set(SHAPES) == set(PHONEMES) - {"h", "hh"}
    assert set("".join(SHAPES.values())) == set(STAND_INS) == set("ABCDEFGHX")
    assert {s: SHAPES[p] for s, p in STAND_INS.items()} == {s: s for s in STAND_INS}


@pytest.mark.parametrize("name", ["rhubarb-cues.json", "rhubarb-lines.tsv"])
@pytest.mark.parametrize("out", ["rhubarb-json", "rhubarb-tsv"])
def test_shapes_come_back(name: str, out: str, tmp_path: Path) -> None:
    timing = read_timing(DATA / name)
    assert timing.shapes_only
    file = tmp_path / ("a.json" if out == "rhubarb-json" else "a.tsv")
    write_timing(file, timing, out)
    again = read_timing(file)
    assert again.phones is not None and timing.phones is not None
    assert again.phones.labels == timing.phones.labels
    assert again.phones.boundaries.tolist() == timing.phones.boundaries.tolist()


def test_phonemes_become_the_shapes_that_rhubarb_describes(tmp_path: Path) -> None:
    """Its own example: "Hi" opens wide for the h, before the diphthong, and closes at the end."""
    file = tmp_path / "a.tsv"
    write_timing(file, track((0.05, 0.1, "hh"), (0.1, 0.4, "ay"), (0.4, 0.5, "v"),
                             (0.5, 0.6, "ow"), (0.6, 0.7, "p"), (0.7, 0.8, "h")))  # fmt: skip
    assert file.read_text() == (
        "0.00\tX\n0.05\tD\n0.28\tB\n0.40\tG\n0.50\tE\n0.56\tF\n0.60\tA\n0.70\tC\n0.80\tX\n"
    )
    with pytest.raises(TimingError, match="needs phones"):
        write_timing(file, WordTrack(("a",), (0,), (1,)))
    with pytest.raises(TimingError, match=r"0\.001 s are too short for hundredths"):
        write_timing(file, PhonemeTrack(np.array([1]), np.array([0, 0.001])))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.tsv", "0\tX\n", "line 1: expected two lines or more"),
        ("a.tsv", "0\tX\n1\tQ\n", "line 2: expected a mouth shape, one of A, B,"),
        ("a.tsv", "0\t1\tX\n", "line 1: expected 'seconds TAB shape', got '0\\t1\\tX'; a table"),
        ("a.tsv", "0\tX\nnan\tA\n", "line 2: expected the time in seconds as a number"),
        ("a.tsv", "1\tX\n0.5\tA\n", "line 1: expected an end after the start"),
        ("a.tsv", "1\tX\n1\tA\n", "holds no phone"),
        ("a.json", '{"mouthCues": [{"start": 0, "value": "A"}]}',
         "mouth cue 1: expected a member 'end'"),
        ("a.json", '{"mouthCues": [{"start": 0, "end": 1, "value": "rest"}]}',
         "mouth cue 1: expected a mouth shape"),
        ("a.json", '{"mouthCues": {}}', "top level: expected 'mouthCues' to be an array"),
    ],
)  # fmt: skip
def test_shapes_that_cannot_be_read(name: str, text: str, message: str) -> None:
    assert said(name, text).startswith(message)


# CTM


def test_of_several_recordings_the_files_own_is_read() -> None:
    text = "a 1 0 0.5 bin\nb 1 0 0.5 blue\n"
    assert read("b.ctm", text).words == WordTrack(("blue",), (0,), (0.5,))
    assert "got several ('a 1', 'b 1'); leave one" in said("c.ctm", text)
    assert "got several ('b 1', 'b 2')" in said("b.ctm", "b 1 0 1 c\nb 2 0 1 blue\n")


def test_rounded_ctm_times_touch() -> None:
    words = read("a.ctm", "a 1 0.10 0.21 bin\na 1 0.30 0.20 blue\na 1 0.51 0.3 at\n").words
    assert words is not None
    assert words.starts == pytest.approx((0.1, 0.31, 0.5), abs=1e-9)
    assert "line 2: expected a start at or after 0.4 s" in said(
        "a.ctm", "a 1 0.1 0.3 bin\na 1 0.3 0.2 blue\n"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a 1 0 1\n", "line 1: expected 'file channel start duration token', got 'a 1 0 1'"),
        (";; x\na 1 zero 1 b\n", "line 2: expected the start in seconds as a number, got 'zero'"),
        ("a 1 0 inf b\n", "line 1: expected the duration in seconds as a number"),
        ("a 1 0 -1 b\n", "line 1: expected a duration of 0 or more"),
        ("a 1 0 0 bin\n", "holds no word and no phone"),
    ],
)
def test_ctm_that_cannot_be_read(text: str, message: str) -> None:
    assert said("a.ctm", text).startswith(message)


# Subtitles


def test_subtitles_are_written_one_cue_a_word(tmp_path: Path) -> None:
    words = WordTrack(("bin", "a&b"), (0.0, 3661.5), (0.25, 3662.0))
    write_timing(tmp_path / "a.srt", words)
    assert (tmp_path / "a.srt").read_text() == (
        "1\n00:00:00,000 --> 00:00:00,250\nbin\n\n2\n01:01:01,500 --> 01:01:02,000\na&amp;b\n"
    )
    write_timing(tmp_path / "a.vtt", words)
    assert (tmp_path / "a.vtt").read_text().startswith("WEBVTT\n\n1\n00:00:00.000 --> 00:00:00.250")
    assert read_timing(tmp_path / "a.srt").words == read_timing(tmp_path / "a.vtt").words == words
    with pytest.raises(TimingError, match="subtitles need words"):
        write_timing(tmp_path / "b.srt", track((0, 1, "s")))
    with pytest.raises(TimingError, match=r"'a' from 0 to 0\.0001 s is too short for milliseconds"):
        write_timing(tmp_path / "b.srt", WordTrack(("a",), (0,), (1e-4,)))


def test_words_of_a_cue_know_that_they_share_it() -> None:
    words = read_timing(DATA / "srt-cues-with-tags.srt").words
    assert words is not None and words.cues == (0, 0, 1, 1, 1)
    inner = read_timing(DATA / "vtt-settings-and-inner-times.vtt").words
    assert inner is not None and inner.cues == ()


def test_tags_inside_a_word_leave_it_whole() -> None:
    words = read(
        "a.srt", "1\n0:01 --> 0:02\n<i>un</i>likely<br>it's {\\b1}so{\\b0} (sighs)\n"
    ).words
    assert words is not None and words.words == ("unlikely", "it's", "so")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.vtt", "1\n00:01.0 --> 00:02.0\na\n", "line 1: expected WEBVTT, got '1'"),
        ("a.vtt", "WEBVTT\n", "holds no word"),
        ("a.srt", "1\n00:00:01,000\na\n", "line 1: expected 'HH:MM:SS,mmm --> HH:MM:SS,mmm', got"),
        ("a.srt", "1\n00:00:01,000 -> 00:00:02,000\na\n", "line 1: expected 'HH:MM:SS,mmm -->"),
        ("a.srt", "1\n00:00:01,0000 --> 00:00:02,000\na\n", "line 2: expected 'HH:MM:SS,mmm"),
        ("a.srt", "1\n00:61:00 --> 00:62:00\na\n", "line 2: expected minutes and seconds"),
        ("a.srt", "1\n00:02 --> 00:01\na\n", "line 2: expected an end after the start at 2 s"),
        ("a.srt", "1\n00:01 --> 00:02\na\n2\n00:02 --> 00:03\nb\n",
         "line 5: expected an empty line before the next cue"),
        ("a.srt", "1\n00:01 --> 00:03\na\n\n2\n00:02 --> 00:04\nb\n",
         "line 6: expected a start at or after 3 s"),
        ("a.vtt", "WEBVTT\n\n00:01 --> 00:02\nbin<00:03.000>blue\n", "line 3: expected an end"),
        ("a.srt", "1\n00:01 --> 00:02\n[music]\n", "holds no word"),
    ],
)  # fmt: skip
def test_subtitles_that_cannot_be_read(name: str, text: str, message: str) -> None:
    assert said(name, text).startswith(message)


# TextGrids as ELAN exports them


@pytest.mark.parametrize(
    ("phones", "words"),
    [("phones@A", "words@A"), ("A_Phones", "A_Words"), ("Phoneme (A)", "A - word"),
     ("A-segments", "A/ort-mau")],
)  # fmt: skip
def test_tiers_named_beside_a_speaker_are_found(phones: str, words: str) -> None:
    tiers = "".join(
        f'"IntervalTier" "{name}" 0 1 1 0 1 "{label}"\n'
        for name, label in (("A-notes", "s"), (phones, "ax"), (words, "s"))
    )
    timing = read("a.TextGrid", f"{GRID}3\n{tiers}")
    assert timing.phones is not None and timing.phones.labels == ("ax",)
    if "ort-mau" not in words:
        assert timing.words is not None and timing.words.words == ("s",)


def test_two_speakers_of_one_file_are_told() -> None:
    tiers = "".join(f'"IntervalTier" "words@{n}" 0 1 1 0 1 "bin"\n' for n in "AB")
    message = said("a.TextGrid", f"{GRID}2\n{tiers}")
    assert "got several tiers of one kind: 'words@A', 'words@B'; leave one" in message


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("form", ["textgrid", "textgrid-short"])
def test_elans_textgrid_comes_back_in_every_encoding(
    encoding: str, form: str, tmp_path: Path
) -> None:
    timing = read_timing(DATA / "elan-participants-and-rounding.TextGrid")
    file = tmp_path / "a.TextGrid"
    write_timing(file, timing, form)
    file.write_bytes(file.read_text(encoding="utf-8").replace("\n", "\r\n").encode(encoding))
    again = read_timing(file)
    assert again.words == timing.words
    assert again.phones is not None and timing.phones is not None
    assert again.phones.labels == timing.phones.labels
    assert again.phones.boundaries.tolist() == timing.phones.boundaries.tolist()


def test_utf_16_is_written_with_its_mark(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.TextGrid", track((0, 1, "s")), "textgrid-utf16")
    data = (tmp_path / "a.TextGrid").read_bytes()
    assert data[:2] in (b"\xff\xfe", b"\xfe\xff")
    assert 'text = "s"' in data.decode("utf-16")


def test_utf_16_cut_off_inside_a_letter_is_told() -> None:
    data = (DATA / "utf16-big-endian-mark.TextGrid").read_bytes()
    with pytest.raises(TimingError, match="expected text in UTF-16, got byte"):
        parse_timing("a.TextGrid", data[:-1])
