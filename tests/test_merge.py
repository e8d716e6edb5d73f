"""Databases of one person merged: the content of one build from all their clips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

import analysis.clip_workers
from analysis.build import BuildSettings, build_database
from analysis.corpus import Clip
from analysis.corpus_lips import LipSettings
from analysis.face import FaceModels
from analysis.merge import clips_of_database, merge_databases, together
from database.errors import DatabaseError
from database.fingerprint import content_hash
from database.reader import open_database
from database.timing import Timing, write_timing
from unitsel.cli import main

FOLDERS = {"monday": ("a", "b"), "friday": ("b", "c")}
SETTINGS = BuildSettings(lips=LipSettings(source="mesh-only"))


@pytest.fixture(scope="module")
def footage(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give two folders; a file's name is in both, for other words."""
    root = tmp_path_factory.mktemp("footage")
    seed = 0
    for folder, names in FOLDERS.items():
        (root / folder).mkdir()
        for name in names:
            sentence = ("lay red", "bin blue", "set green")[seed % 3]
            track, words = puppet.even_track(sentence, 0.1, 0.3)
            puppet.write_clip(root / folder / f"{name}.mp4", track, puppet.hum(track, seed), seed)
            write_timing(root / folder / f"{name}.TextGrid", Timing(track, words))
            seed += 1
    return root


@pytest.fixture(scope="module")
def built(footage: Path, face_models: FaceModels, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with a database of each."""
    here = tmp_path_factory.mktemp("built")
    for folder in FOLDERS:
        build_database(footage / folder, here / f"{folder}.h5", settings=SETTINGS, jobs=1)
    return here


def test_a_merged_database_is_that_of_one_build(
    footage: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed: list[str] = []
    real = analysis.clip_workers.analyse_clip

    def seen(clip: Clip, *arguments: object, **options: object) -> object:
        analysed.append(clip.name)
        return real(clip, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(analysis.clip_workers, "analyse_clip", seen)
    both = [built / "monday.h5", built / "friday.h5"]
    report = merge_databases(both, tmp_path / "both.h5", jobs=1)
    # The first one's mask: its clips are taken as they are, but for the one that got another name.
    assert sorted(analysed) == ["c", "friday/b.mp4", "monday/b.mp4"] and report.reused == 1
    one = build_database(
        footage,
        tmp_path / "one.h5",
        settings=SETTINGS,
        jobs=1,
        person=["a", "monday/b.mp4"],
    )
    assert content_hash(report.path) == content_hash(one.path)
    again = merge_databases(both, tmp_path / "both.h5", jobs=1)
    assert again.reused == 4
    with open_database(again.path) as db:
        assert db.sequences.name == ("a", "c", "friday/b.mp4", "monday/b.mp4")


def test_a_clip_of_both_counts_once(footage: Path, built: Path) -> None:
    clips = clips_of_database(built / "monday.h5")
    assert together(clips + clips) == clips
    assert [c.scripts[0].name for c in clips] == ["a.TextGrid", "b.TextGrid"]
    pieces = [Clip("x@1", Path("/f/x.mp4"), (), 1.0, 2.0), Clip("x@2", Path("/f/x.mp4"), (), 2.0)]
    assert together(pieces) == pieces
    assert [Clip.from_json(c.as_json()) for c in pieces] == pieces


def test_what_cannot_be_merged_is_told(
    footage: Path, built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DatabaseError, match="two databases"):
        merge_databases([built / "monday.h5"], tmp_path / "x.h5")
    other = replace(SETTINGS, focal=500.0)
    build_database(footage / "monday", tmp_path / "other.h5", settings=other, jobs=1)
    with pytest.raises(DatabaseError, match=r"other settings than .*friday.h5 \(focal\)"):
        merge_databases([built / "friday.h5", tmp_path / "other.h5"], tmp_path / "x.h5")
    assert main(["merge", str(built / "monday.h5"), "none.h5", "-o", str(tmp_path / "x.h5")]) == 2
    assert "none.h5: there is no such file" in capsys.readouterr().err
    assert not (tmp_path / "x.h5").exists()


def test_an_older_database_says_so(makedb: ModuleType, tmp_path: Path) -> None:
    path = makedb.make_database(tmp_path / "old.h5")
    with pytest.raises(DatabaseError, match="older unitsel"):
        clips_of_database(path)
