"""The consent note: given at the build, checked, stored, shown, and kept by a merge."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from analysis.build import BuildSettings
from analysis.consent import checked_consent, merged_consent, read_consent
from analysis.identity import settings_digest
from database.errors import DatabaseError
from database.pictures import encode
from database.reader import open_database
from database.timing import Timing, write_timing
from database.writer import write_database

Run = Callable[..., tuple[int, str, str]]
NOTE = "Ada agreed in writing, 2 May; \u03bd\u03b1\u03af."


@pytest.fixture(scope="module")
def films(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two folders of one clip of half a second each."""
    root = tmp_path_factory.mktemp("films")
    for seed, name in enumerate("ab"):
        (root / name).mkdir()
        track, words = puppet.even_track(("lay red", "bin blue")[seed], 0.1, 0.3)
        puppet.write_clip(root / name / f"{name}.mp4", track, puppet.hum(track, seed), seed)
        write_timing(root / name / f"{name}.TextGrid", Timing(track, words))
    return root


def test_the_note_is_built_in_shown_and_merged(
    films: Path, face_models: object, run: Run, tmp_path: Path
) -> None:
    quick = ("--jobs", 1, "--lips", "mesh-only", "--json")
    one, two, both = (tmp_path / f"{name}.h5" for name in ("one", "two", "both"))
    letter = tmp_path / "letter.txt"
    letter.write_text(f"\ufeff{NOTE}\n", encoding="utf-8")
    assert run("build", films / "a", "-o", one, *quick, "--consent", f"@{letter}")[0] == 0
    assert run("build", films / "b", "-o", two, *quick)[0] == 0
    with open_database(one) as database:
        assert database.consent == NOTE
    assert json.loads(run("inspect", one, "--json")[1])["consent"] == NOTE
    assert f"consent: {NOTE}" in run("inspect", one)[1]
    assert json.loads(run("inspect", two, "--json")[1])["consent"] == ""
    assert "consent: no note of it" in run("inspect", two)[1]
    # Another note is another database of the same clips.
    status, out, _ = run("build", films / "b", "-o", two, *quick, "--consent", "Bob agreed")
    assert status == 0 and json.loads(out)["reused"] == 1
    assert run("merge", one, two, "-o", both, "--jobs", 1)[0] == 0
    with open_database(both) as database:
        assert database.consent == f"one.h5: {NOTE}\ntwo.h5: Bob agreed"


def test_merged_notes_say_who_has_none() -> None:
    assert merged_consent([("a.h5", ""), ("b.h5", "")]) == ""
    assert merged_consent([("a.h5", "yes"), ("b.h5", "yes")]) == "yes"
    assert merged_consent([("a.h5", "yes"), ("b.h5", "")]) == "a.h5: yes\nb.h5: no note"


def test_no_clip_depends_on_the_note() -> None:
    plain = BuildSettings()
    assert settings_digest(plain) == settings_digest(replace(plain, consent="yes"))
    assert settings_digest(plain) != settings_digest(replace(plain, codec="webp"))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read"),
        (b" \n ", "is empty"),
        (b"\xff\xfe\x00", "no text in UTF-8"),
        (b"yes\x00", "cannot be printed"),
        (b"y" * 100_001, "100001 characters"),
    ],
)
def test_a_bad_note_is_told(
    films: Path, run: Run, tmp_path: Path, content: Any, words: str
) -> None:
    note = tmp_path / "note.txt"
    if content is not None:
        note.write_bytes(content)
    status, out, err = run("build", films / "a", "-o", tmp_path / "x.h5", "--consent", f"@{note}")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert str(note) in err and words in err
    assert not (tmp_path / "x.h5").exists()


def test_a_note_is_checked_wherever_it_comes_from(makedb: ModuleType, tmp_path: Path) -> None:
    assert read_consent(" yes ") == checked_consent("yes\n") == "yes"
    with pytest.raises(DatabaseError, match="the consent note is empty"):
        read_consent("  ")
    content, pictures, landmarks = makedb.make_content(sequences=1, frames=4, crop=(16, 16))
    with pytest.raises(DatabaseError, match="cannot be printed"):
        write_database(
            tmp_path / "x.h5",
            replace(content, consent="a\x07"),
            (encode(p) for p in pictures),
            landmarks,
        )
