"""Chinese text to Pinyin, its syllables to mouths, and espeak's sounds to its syllables.

`data/mandarin_syllables.json` holds the 408 toneless syllables of the table of initials and
finals, each with the strongest key frame of each of its mouths.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import unitsel
import unitsel.speech.spoken
from analysis.utterance import say
from database.errors import PronunciationError, SpeechError
from database.pinyin import INITIALS, RIMES, Syllable, split
from unitsel.portrait.keyframes import N_KEYS, NAMES, syllable_shapes
from unitsel.speech import mandarin
from unitsel.speech.mandarin import IN_PINYIN, Word, spelled, timed_syllables, told, words_of
from unitsel.speech.mandarin import _for_espeak as for_espeak

TABLE: dict[str, str] = json.loads(
    (Path(__file__).parent / "data" / "mandarin_syllables.json").read_text(encoding="utf-8")
)["syllables"]


@pytest.fixture
def espeak() -> None:
    pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")


@pytest.fixture
def pinyin() -> None:
    pytest.importorskip("pypinyin", reason="needs the optional extra `mandarin`")


def mouths(pinyin: str) -> list[str]:
    return [NAMES[int(row.argmax())] for row in syllable_shapes(split(pinyin))]


def test_every_syllable_of_mandarin_has_its_mouths() -> None:
    assert len(TABLE) == 408
    for pinyin, expected in TABLE.items():
        shapes = syllable_shapes(split(pinyin))
        assert " ".join(mouths(pinyin)) == expected, pinyin
        assert 1 <= len(shapes) <= 4 and shapes.shape[1] == N_KEYS < 10
        np.testing.assert_allclose(shapes.sum(axis=1), 1)


def test_initials_show_only_where_the_lips_make_them() -> None:
    for pinyin in TABLE:
        first, rest = mouths(pinyin)[0], mouths(pinyin)[1:]
        labial = re.match("[bpmf]", pinyin)
        assert (first in ("closed", "bite")) == bool(labial), pinyin
        assert not {"closed", "bite"} & set(rest), pinyin
        if labial:
            assert (first == "bite") == pinyin.startswith("f")
    # The others dissolve into the final: ta and a, guo and wo, xiao and yao look alike.
    for one, other in (("ta", "a"), ("guo", "wo"), ("xiao", "yao"), ("jun", "yun"), ("lei", "ei")):
        np.testing.assert_array_equal(syllable_shapes(split(one)), syllable_shapes(split(other)))


def test_rounded_and_open_finals_look_so() -> None:
    for pinyin in TABLE:
        seen = set(mouths(pinyin))
        rounded = re.search("[oüw]|yu|u", pinyin) is not None
        assert bool(seen & {"round", "pucker"}) == rounded, pinyin
        wide = "a" in pinyin and not re.search("(i|y|yu|ü|[jqx]u)an$", pinyin)
        assert ("open" in seen) == wide, pinyin


@pytest.mark.parametrize(
    ("pinyin", "expected"),
    [
        ("zhuang", ("zh", "u", "ang")),
        ("xue", ("x", "ü", "ê")),
        ("xuan", ("x", "ü", "an")),
        ("gui", ("g", "u", "ei")),
        ("liu", ("l", "i", "ou")),
        ("lun", ("l", "u", "en")),
        ("lve", ("l", "ü", "ê")),
        ("jiong", ("j", "ü", "ong")),
        ("yong", ("", "ü", "ong")),
        ("you", ("", "i", "ou")),
        ("wei", ("", "u", "ei")),
        ("yi", ("", "", "i")),
        ("wu", ("", "", "u")),
        ("yu", ("", "", "ü")),
        ("shi", ("sh", "", "-i")),
        ("si", ("s", "", "-i")),
        ("di", ("d", "", "i")),
        ("er", ("", "", "er")),
        ("bo", ("b", "", "o")),
    ],
)
def test_spelling_is_undone(pinyin: str, expected: tuple[str, str, str]) -> None:
    assert split(pinyin) == Syllable(*expected)


@pytest.mark.usefixtures("pinyin")
def test_all_that_pypinyin_reads_is_understood() -> None:
    from pypinyin.contrib.tone_convert import to_normal
    from pypinyin.pinyin_dict import pinyin_dict

    read = {to_normal(r) for place, all_of in pinyin_dict.items() for r in all_of.split(",")}
    assert len(read) > 400
    for pinyin in read:
        parts = split(pinyin)
        assert parts.initial in ("", *INITIALS) and parts.rime in RIMES
        assert len(syllable_shapes(parts))
    assert set(TABLE) <= {r.replace("v", "ü") for r in read}
    for wrong in ("", "xyz", "hello", "bang1", "üü"):
        with pytest.raises(PronunciationError):
            split(wrong)


@pytest.mark.usefixtures("pinyin")
def test_readings_and_tones_depend_on_the_words() -> None:
    def read(text: str) -> list[str]:
        return [f"{s}{t}" for w in words_of(text) for s, t in w.syllables]

    assert read("银行行走") == ["yin2", "hang2", "xing2", "zou3"]
    assert read("你好")[0] == "ni2", "a third tone before a third one is said as a second"
    assert read("不要一个") == ["bu2", "yao4", "yi2", "ge4"]
    words = words_of("你好，hello 银行2026。")
    assert [w.written for w in words] == ["你好，", "hello", "银行", "2026。"]
    assert spelled(words) == ("ni2hao3， hello yin2hang2 2026。", True)
    # What Pinyin would read as Chinese keeps the characters.
    assert spelled(words_of("我 can 说")) == ("我 can 说", False)
    assert words_of("Hello there") == (Word("Hello", "Hello"), Word("there", "there"))


@pytest.mark.usefixtures("espeak")
def test_espeak_says_every_syllable_in_one_piece() -> None:
    words = tuple(Word(s, for_espeak(s, 1), ((s, 1),)) for s in TABLE)
    found = []
    for k in range(0, len(words), 51):
        part = words[k : k + 51]
        said = say(spelled(part)[0], IN_PINYIN, lambda piece: None)
        syllables, spans, others = timed_syllables(part, said)
        assert others == () and [s.label for s in spans] == [w.written for w in part]
        found += syllables
    assert [s.pinyin for s in found] == list(TABLE)
    for s in found:
        assert 0.08 < s.end - s.start < 0.8, s
        # An initial takes some of the time, and leaves the final some.
        has = split(s.pinyin).initial != ""
        assert (s.start < s.onset < s.end) if has else s.onset == s.start, s


@pytest.mark.usefixtures("espeak", "pinyin")
def test_a_sentence_has_its_syllables_in_time() -> None:
    speech = unitsel.speak("妈妈忘记了银行。花儿 hello 好", voice="cmn")
    names = [s.pinyin for s in speech.syllables]
    assert names == ["ma", "ma", "wang", "ji", "le", "yin", "hang", "hua", "er", "hao"]
    times = [t for s in speech.syllables for t in (s.start, s.end)]
    assert (np.diff(times) > -1e-9).all() and times[-1] <= speech.track.end
    m = speech.syllables[0]
    closed = [i for i in speech.track.intervals() if i.label == "m"]
    assert closed[0].start == pytest.approx(m.start, abs=0.01)
    assert closed[0].end == pytest.approx(m.onset, abs=0.01)
    assert speech.words is not None and "忘记" in "".join(speech.words.words)
    assert speech.notes == ("said as espeak reads them, without Pinyin: hello",)
    assert unitsel.speak("hello", voice="en-us").syllables == ()


def test_a_note_names_a_few() -> None:
    assert told(["a", "b"]).endswith("Pinyin: a, b")
    assert told(list("abcdef")).endswith("Pinyin: a, b, c, d and 2 more")


@pytest.mark.usefixtures("espeak")
def test_without_pinyin_espeak_reads_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unitsel.speech.spoken, "can_read", lambda: False)
    speech = unitsel.speak("你好", voice="cmn")
    assert speech.syllables == () and speech.track.labels[1:4] == ("n", "iy", "k")
    assert len(speech.notes) == 1 and "unitsel[mandarin]" in speech.notes[0]
    monkeypatch.setattr(mandarin, "can_read", lambda: False)
    with pytest.raises(SpeechError, match=r"unitsel\[mandarin\]"):
        words_of("你好")
