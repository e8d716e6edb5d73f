"""Closures and rests, on clips whose closures are known to the hundredth of a second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.phone_marks import SpokenClip, mark_phones
from database.errors import DatabaseError
from database.phonemes import CLOSURES, PHONEME_INDEX, SILENCE
from database.reader import open_database
from database.schema import PhoneMarks, Phones
from database.writer import write_database

FPS = 25.0
SAID = (("sil", 0.5), ("b", 0.1), ("ih", 0.2), ("p", 0.1), ("ae", 0.3), ("m", 0.1), ("iy", 0.2))
PHONES = (*SAID, ("sil", 0.5))
CLOSED = {1: (0.46, 0.58), 3: (0.79, 0.88), 5: (1.21, 1.31)}
"""Seconds for which the lips are closed, by phone: the aligner is 10 to 40 ms off."""


def phones(clips: int = 1) -> Phones:
    ends = np.cumsum([seconds for _, seconds in PHONES])
    return Phones(
        np.repeat(np.arange(clips, dtype=np.int32), len(PHONES)),
        np.tile(np.array([PHONEME_INDEX[p] for p, _ in PHONES], np.uint8), clips),
        np.tile(np.append(0.0, ends[:-1]), clips),
        np.tile(ends, clips),
    )


def clip(seed: int = 0) -> SpokenClip:
    """Lips that close over 20 ms, and a sound that is dark meanwhile, with some noise."""
    rng = np.random.default_rng(seed)
    end = sum(seconds for _, seconds in PHONES)

    def shut(t: np.ndarray) -> np.ndarray:
        open_ = np.minimum(np.clip((t - 0.36) / 0.04, 0, 1), np.clip((1.55 - t) / 0.05, 0, 1))
        for a, b in CLOSED.values():
            open_ = np.minimum(open_, np.clip(np.maximum(a - t, t - b) / 0.02, 0, 1))
        return open_

    times = (np.arange(round(end * FPS)) + 0.5) / FPS
    opening = 1.0 + 6.0 * shut(times) + rng.normal(0, 0.05, len(times))
    t = np.arange(round(end * 100) + 1) / 100
    voiced = (t > 0.5) & (t < 1.5)
    sound = np.where(voiced, 0.8, -1.0)[:, None] + rng.normal(0, 0.1, (len(t), 26))
    for k, (a, b) in CLOSED.items():
        within = (t >= a) & (t < b)
        # A nasal stays loud below.
        sound[within, 12 if k == 5 else 0 :] = (0.0 if k == 5 else -1.0) + rng.normal(0, 0.1)
    return SpokenClip(times, opening, sound)


def test_closures_are_found_to_a_hundredth_of_a_second() -> None:
    marks = mark_phones(phones(), [clip()])
    assert marks.phone.tolist() == [0, 1, 3, 5, 7]
    assert marks.sound.all() and marks.lips.all()
    for k in (3, 5):
        i = marks.phone.tolist().index(k)
        assert (marks.start[i], marks.end[i]) == pytest.approx(CLOSED[k], abs=0.011)
    # After silence the sound knows where the b ends, and the lips, filmed every 40 ms, its start.
    assert marks.end[1] == pytest.approx(CLOSED[1][1], abs=0.011)
    assert marks.start[1] == pytest.approx(CLOSED[1][0], abs=0.041)


def test_rests_end_where_voice_or_lips_begin() -> None:
    marks = mark_phones(phones(), [clip()])
    assert marks.start[0] == 0.0
    assert 0.3 < marks.end[0] < 0.5, "lips move before the sound"
    assert marks.start[-1] == pytest.approx(1.55, abs=0.05), "and come to rest after it"


def test_the_lips_alone_where_there_is_no_sound() -> None:
    marks = mark_phones(phones(), [replace(clip(), sound=np.zeros((0, 26)))])
    assert marks.phone.tolist() == [0, 1, 3, 5, 7]
    assert not marks.sound.any() and marks.lips.all()
    i = marks.phone.tolist().index(3)
    assert (marks.start[i], marks.end[i]) == pytest.approx(CLOSED[3], abs=0.03)


def test_the_sound_alone_where_no_face_was_seen() -> None:
    seen = clip()
    keep = (seen.times < 0.7) | (seen.times > 1.0)
    marks = mark_phones(
        phones(), [replace(seen, times=seen.times[keep], opening=seen.opening[keep])]
    )
    found = dict(zip(marks.phone.tolist(), zip(marks.sound, marks.lips, strict=True), strict=True))
    assert found[3] == (1, 0) and found[5] == (1, 1)


def test_a_closure_that_neither_shows_is_not_marked() -> None:
    said = clip()
    steady = SpokenClip(said.times, np.full_like(said.opening, 7.0), np.full_like(said.sound, 0.8))
    marks = mark_phones(phones(2), [said, steady])
    assert (marks.phone < len(PHONES)).all() and len(marks) == 5


def test_any_split_into_clips_gives_each_its_marks() -> None:
    one, two = clip(1), clip(2)
    marks = mark_phones(phones(2), [one, two])
    first = marks.phone < len(PHONES)
    assert first.sum() == 5 and (~first).sum() == 5
    assert marks.phone[~first].tolist() == [len(PHONES) + k for k in (0, 1, 3, 5, 7)]


def test_marks_come_back_from_a_file(makedb: object, tmp_path: Path) -> None:
    content, pictures, landmarks = makedb.make_content(sequences=2, guided=True)  # type: ignore[attr-defined]
    from database.pictures import encode

    coded = [encode(p, "png") for p in pictures]
    write_database(tmp_path / "x.h5", content, coded, landmarks, "png")
    with open_database(tmp_path / "x.h5") as db:
        for name in ("phone", "start", "end", "sound", "lips"):
            assert np.array_equal(getattr(db.marks, name), getattr(content.marks, name))
        assert set(db.phones.phoneme[db.marks.phone]) <= {SILENCE, *CLOSURES}
    wrong = replace(content, marks=replace(content.marks, phone=content.marks.phone[::-1]))
    with pytest.raises(DatabaseError, match="marks/phone must ascend"):
        write_database(tmp_path / "y.h5", wrong, coded, landmarks, "png")
    none = replace(content, marks=PhoneMarks.none())
    write_database(tmp_path / "z.h5", none, coded, landmarks, "png")
    with open_database(tmp_path / "z.h5") as db:
        assert len(db.marks) == 0
