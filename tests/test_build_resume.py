"""What an earlier build has analysed is taken as it is, and the content is that of one build."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import analysis.clip_workers
import analysis.estimate
import analysis.shard_store
from analysis.build import BuildReport, BuildSettings, ShardSettings, build_database
from analysis.build_lock import SHARED_MEMORY, only_build
from analysis.clip import AnalysedClip
from analysis.corpus_lips import LipSettings
from analysis.face import FaceModels
from analysis.identity import RUN_LATER
from analysis.texture import TextureSettings
from database.errors import CorpusError, DatabaseError
from database.fingerprint import content_hash
from database.reader import open_database
from database.timing import Timing, write_timing

SENTENCES = {
    **{"b": "bin blue now", "c": "lay red soon", "d": "place white again", "e": "set blue now"},
    **{
        "f": "lay green",
        "g": "bin white soon",
        "y": "lay white",
        "z": "place red again",
        "a": "set green",
    },
}
"""Clips of less than a second; the last one comes first by name."""

MANY = "bcdefg"
"""More are not looked at for the mask."""

QUICK = BuildSettings(lips=LipSettings(source="mesh-only"))
"""A lip model takes longer than all the rest of so small a build; one test has it."""

Build = Callable[..., BuildReport]


@pytest.fixture(scope="module")
def films(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clips with their phones, and one whose words nobody can say."""
    folder = tmp_path_factory.mktemp("films")
    for seed, (name, sentence) in enumerate(SENTENCES.items()):
        track, words = puppet.even_track(sentence, 0.15, 0.35)
        puppet.write_clip(folder / f"{name}.mp4", track, puppet.hum(track, seed), seed)
        write_timing(folder / f"{name}.TextGrid", Timing(track, words))
    shutil.copy(folder / "b.mp4", folder / "foreign.mp4")
    (folder / "foreign.txt").write_text("слово")
    return folder


@pytest.fixture
def corpus(tmp_path: Path) -> Path:
    folder = tmp_path / "corpus"
    folder.mkdir()
    return folder


@pytest.fixture
def analysed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Names of the clips that are decoded, also for the mask."""
    names: list[str] = []
    clip, person = analysis.clip_workers.analyse_clip, analysis.shard_store.study_person

    def seen(one: Any, *arguments: Any, **options: Any) -> AnalysedClip:
        names.append(one.name)
        return clip(one, *arguments, **options)

    def looked(videos: Any, *arguments: Any, **options: Any) -> Any:
        names.append("mask")
        return person(videos, *arguments, **options)

    monkeypatch.setattr(analysis.clip_workers, "analyse_clip", seen)
    monkeypatch.setattr(analysis.shard_store, "study_person", looked)
    yield names


@pytest.fixture
def build(corpus: Path, tmp_path: Path, face_models: FaceModels) -> Build:
    """Build the corpus as it is now into a file; in this process, so that calls are seen."""

    def call(name: str = "x.h5", **options: Any) -> BuildReport:
        return build_database(corpus, tmp_path / name, jobs=1, **{"settings": QUICK, **options})

    return call


def put(corpus: Path, films: Path, *names: str) -> None:
    for path in films.iterdir():
        if path.stem in names:
            shutil.copy(path, corpus / path.name)


def shards_of(report: BuildReport) -> list[Path]:
    assert report.shards is not None
    return sorted(report.shards.glob("*/*.shard"))


def test_more_clips_cost_only_themselves(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    put(corpus, films, *MANY)
    first = build()
    assert first.reused == 0 and sorted(analysed) == [*MANY, "mask"]
    assert first.person == tuple(MANY)
    put(corpus, films, "y")
    build()
    analysed.clear()
    put(corpus, films, "z")
    second = build(settings=BuildSettings())
    assert analysed == ["z"] and second.reused == 7 and second.changed == ()
    in_one_go = build("go.h5", settings=BuildSettings())
    assert sorted(analysed) == [*MANY, "mask", "y", "z", "z"]
    assert content_hash(second.path) == content_hash(in_one_go.path)
    assert second.units == in_one_go.units > first.units
    assert second.estimate.frames < in_one_go.estimate.frames
    analysed.clear()
    assert build().reused == 8 and analysed == []


def test_a_clip_that_comes_first_makes_another_mask(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    """Unless the mask's clip is named: content depends on the clips, not on their history."""
    put(corpus, films, "b", "c")
    build()
    build("named.h5", person=["b"])
    put(corpus, films, "a")
    analysed.clear()
    named = build("named.h5", person=["b"])
    assert analysed == ["a"] and named.person == ("b",) and named.reused == 2
    analysed.clear()
    report = build()
    assert sorted(analysed) == ["a", "b", "c", "mask"]
    assert report.person == ("a", "b", "c") and report.reused == 0 and report.changed == ("mask",)
    assert len(shards_of(report)) == 3, "what was kept with the other mask is of no more use"
    in_one_go = build("go.h5")
    assert content_hash(report.path) == content_hash(in_one_go.path)
    assert content_hash(report.path) != content_hash(named.path)
    assert content_hash(named.path) == content_hash(build("go2.h5", person=["b"]).path)


def test_the_mask_is_kept_where_other_clips_than_its_own_change(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    put(corpus, films, "b", "c", "d")
    build(person=["d", "b"])
    analysed.clear()
    (corpus / "c.mp4").unlink()
    assert build(person=["d", "b"]).reused == 2 and analysed == []
    put(corpus, films, "c")
    report = build(person=["d", "b"])
    assert report.reused == 3 and analysed == [], "it was kept meanwhile"
    assert report.person == ("d", "b")
    with pytest.raises(CorpusError, match="no usable clip 'z' to make the mask of"):
        build(person=["z"])


@pytest.mark.parametrize("fault", ["a flipped bit", "a cut", "an empty file"])
def test_a_damaged_shard_is_made_again_and_told(
    films: Path, corpus: Path, build: Build, analysed: list[str], fault: str
) -> None:
    put(corpus, films, "b", "c")
    first = build()
    before = content_hash(first.path)
    path = shards_of(first)[0]
    whole = path.read_bytes()
    data = bytearray(whole)
    data[len(data) // 3] ^= 4
    path.write_bytes({"a flipped bit": data, "a cut": whole[:-1], "an empty file": b""}[fault])
    analysed.clear()
    again = build()
    assert again.reused == 1 and len(analysed) == 1
    assert again.damaged == tuple(analysed)
    assert content_hash(again.path) == before
    assert build().damaged == ()


def test_only_what_a_clip_is_made_with_matters(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    put(corpus, films, "b", "c")
    build()
    analysed.clear()
    fewer = BuildSettings(texture=TextureSettings(components=4))
    report = build(settings=fewer)
    assert report.reused == 2 and analysed == []
    assert content_hash(report.path) == content_hash(build("go.h5", settings=fewer).path)
    analysed.clear()
    report = build(settings=replace(fewer, codec="webp"))
    assert report.reused == 0 and report.changed == ("settings",)
    assert sorted(analysed) == ["b", "c", "mask"]
    report = build(settings=replace(fewer, focal=700.0))
    assert set(report.changed) == {"mask", "camera", "settings"}


def test_other_words_are_another_clip(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    put(corpus, films, "b", "c")
    build()
    analysed.clear()
    (corpus / "c.TextGrid").write_bytes((films / "d.TextGrid").read_bytes())
    report = build()
    assert analysed == ["c"] and report.reused == 1
    assert content_hash(report.path) == content_hash(build("go.h5").path)
    with open_database(report.path) as database:
        assert database.sequences.words[1] == SENTENCES["d"]


def test_a_corpus_that_moved_is_not_analysed_again(
    films: Path, corpus: Path, build: Build, analysed: list[str], tmp_path: Path
) -> None:
    put(corpus, films, "b", "c", "foreign")
    build()
    analysed.clear()
    there = tmp_path / "there"
    corpus.rename(there)
    report = build_database(there, tmp_path / "x.h5", settings=QUICK, jobs=1)
    # The reason names the file, so it is found anew.
    assert analysed == ["foreign"] and report.reused == 2
    ((clip, reason),) = report.skipped
    assert clip == "foreign" and str(there / "foreign.mp4") in reason
    with open_database(report.path) as database:
        assert database.sequences.media[0] == str((there / "b.mp4").resolve())
    in_one_go = build_database(there, tmp_path / "go.h5", settings=QUICK, jobs=1)
    assert content_hash(report.path) == content_hash(in_one_go.path)


def test_a_clip_that_cannot_be_used_is_not_tried_again(
    films: Path, corpus: Path, build: Build, analysed: list[str]
) -> None:
    put(corpus, films, "b", "foreign")
    first = build()
    assert [c for c, _ in first.skipped] == ["foreign"]
    analysed.clear()
    second = build()
    assert analysed == [] and second.skipped == first.skipped and second.reused == 2
    assert content_hash(second.path) == content_hash(build("go.h5").path)


def test_what_becomes_of_the_shards_is_the_users_choice(
    films: Path, corpus: Path, build: Build, analysed: list[str], tmp_path: Path
) -> None:
    put(corpus, films, "b", "c")
    kept = build()
    assert kept.shards == tmp_path / "x.h5.shards"
    assert kept.shard_bytes == sum(p.stat().st_size for p in kept.shards.rglob("*") if p.is_file())
    analysed.clear()
    assert build(shards=ShardSettings(restart=True)).reused == 0
    assert sorted(analysed) == ["b", "c", "mask"]
    discarded = build(shards=ShardSettings(keep=False))
    assert discarded.reused == 2 and discarded.shards is None and not kept.shards.exists()
    common = ShardSettings(folder=tmp_path / "common")
    for name in ("one.h5", "two.h5"):
        report = build(name, shards=common)
        assert report.shards == tmp_path / "common"
    assert report.reused == 2
    webp = BuildSettings(codec="webp")
    build("webp.h5", settings=webp, shards=common)
    assert build("one.h5", shards=common).reused == 2, "nothing of a named folder is deleted"
    names = {"corpus", "x.h5", "one.h5", "two.h5", "webp.h5", "common"}
    assert {p.name for p in tmp_path.iterdir()} == names


def test_half_written_files_of_a_killed_build_are_cleared_away(
    films: Path, corpus: Path, build: Build, tmp_path: Path
) -> None:
    put(corpus, films, "b", "c")
    report = build()
    # Of a process whose number has gone to another one: only the lock tells.
    partial = f"{os.getpid()}-0a1b2c.partial"
    beside = tmp_path / f".x.h5.{partial}"
    inside = shards_of(report)[0].parent / f".clip.shard.{partial}"
    other = tmp_path / f".y.h5.{partial}"
    for path in (beside, inside, other):
        path.write_bytes(b"half")
    assert build().reused == 2
    assert not beside.exists() and not inside.exists() and other.exists()


def test_two_builds_into_one_database_do_not_meet(
    films: Path, corpus: Path, build: Build, tmp_path: Path
) -> None:
    put(corpus, films, "b")
    lock = tmp_path / ".x.h5.lock"
    with only_build(lock, tmp_path / "x.h5"):
        with pytest.raises(DatabaseError, match=rf"x\.h5: .*process {os.getpid()} on ") as caught:
            build()
        assert "\n" not in str(caught.value)
        assert build("y.h5").sequences == 1
    assert not lock.exists()
    assert build().sequences == 1


@pytest.mark.skipif(not SHARED_MEMORY.is_dir(), reason="needs /dev/shm")
def test_a_killed_builds_shared_memory_is_freed_and_no_other(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], stdout=-1)
    dead, alive = int(done.stdout), os.getppid()
    made = []
    for pid in (dead, alive):
        semaphore = SHARED_MEMORY / f"sem.loky-{pid}-unitseltest"
        semaphore.write_bytes(b"x")
        folder = SHARED_MEMORY / f"joblib_memmapping_folder_{pid}_unitsel_test"
        (folder / "below").mkdir(parents=True)
        made.append((semaphore, folder))
    lock = tmp_path / ".x.h5.lock"
    try:
        for pid in (dead, alive):
            lock.write_text(f'{{"pid": {pid}}}')
            with only_build(lock, tmp_path / "x.h5"):
                pass
        assert [[p.exists() for p in both] for both in made] == [[False, False], [True, True]]
    finally:
        for semaphore, folder in made:
            semaphore.unlink(missing_ok=True)
            shutil.rmtree(folder, ignore_errors=True)


def test_the_estimate_is_near_what_comes(films: Path, corpus: Path, build: Build) -> None:
    put(corpus, films, "b", "c", "d")
    told = []
    report = build(announce=told.append)
    assert told == [report.estimate]
    assert report.estimate.frames == pytest.approx(report.units, abs=3)
    assert report.estimate.shard_bytes == pytest.approx(report.shard_bytes, rel=0.25)
    # The models of a small database weigh more than its few units.
    size = report.path.stat().st_size
    assert 0.4 * size < report.estimate.database_bytes < 1.5 * size
    again = build().estimate
    assert again.frames == 0 and again.reused == 3
    # What is kept of the person is not of any clip.
    assert again.shard_bytes == pytest.approx(report.shard_bytes, rel=0.2)


def test_too_little_space_is_told_before_the_work(
    films: Path, corpus: Path, build: Build, analysed: list[str], monkeypatch: Any, tmp_path: Path
) -> None:
    put(corpus, films, "b", "c")
    full = shutil.disk_usage(tmp_path)._replace(free=100_000)
    monkeypatch.setattr(analysis.estimate.shutil, "disk_usage", lambda path: full)
    with pytest.raises(DatabaseError, match=r"needs about .* MB, and 100 kB are free"):
        build()
    assert analysed == ["mask"]
    assert [p.name for p in tmp_path.iterdir()] == ["corpus"]


def test_no_clip_goes_through_the_code_that_runs_later() -> None:
    """The modules whose changes leave shards valid are none that analyse a clip."""
    folder = Path(analysis.clip_workers.__file__).parent
    reached: set[str] = set()
    todo = ["clip_workers"]
    while todo:
        name = todo.pop()
        if name in reached:
            continue
        reached.add(name)
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("analysis."):
                todo.append(str(node.module).removeprefix("analysis."))
    assert all((folder / name).is_file() for name in RUN_LATER)
    assert not {f"{name}.py" for name in reached} & RUN_LATER
    assert {"clip", "align", "motion", "lips"} <= reached
