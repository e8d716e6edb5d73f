"""``unitsel build`` on the puppet's corpus, on faulty clips, and interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from analysis.face import FaceModels
from database.reader import open_database
from database.timing import Timing, write_timing
from database.video_writer import VideoWriter

Run = Callable[..., tuple[int, str, str]]

QUICK = ("--lips", "mesh-only")
"""A lip model takes longer than all the rest of a small build."""


@pytest.fixture(scope="module")
def faulty(
    puppet: ModuleType, face_models: FaceModels, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Two good clips among four that cannot be used, each for another reason."""
    folder = tmp_path_factory.mktemp("faulty")
    track, words = puppet.even_track("bin blue now", 0.2, 0.5)
    for seed, name in enumerate(("good1", "good2")):
        puppet.write_clip(folder / f"{name}.mp4", track, puppet.hum(track), seed)
        write_timing(folder / f"{name}.TextGrid", Timing(track, words))
    with VideoWriter(folder / "faceless.mp4", 288, 352, 25, puppet.hum(track)) as video:
        for _ in range(round(track.end * 25)):
            video.write_rgb(np.full((352, 288, 3), 90, np.uint8))
    write_timing(folder / "faceless.TextGrid", Timing(track, words))
    puppet.write_clip(folder / "mute.mp4", track, None)
    (folder / "mute.txt").write_text("bin blue now\n")
    puppet.write_clip(folder / "wordless.mp4", track, puppet.hum(track))
    (folder / "broken.mp4").write_bytes(b"no video at all\n" * 20)
    (folder / "broken.txt").write_text("bin blue now\n")
    return folder


def test_build_reports_what_it_made_and_skipped_as_one_object(
    faulty: Path, tmp_path: Path, run: Run
) -> None:
    output = tmp_path / "me.h5"
    status, out, err = run("build", faulty, "-o", output, "--jobs", 1, "--json")
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    report = json.loads(out)
    assert set(report) == {
        *("database", "units", "sequences", "skipped", "repaired", "seconds", "reused"),
        *("damaged", "changed", "person", "shards", "shard_bytes", "estimate"),
    }
    assert report["database"] == str(output)
    assert report["sequences"] == 2
    assert report["seconds"] > 0
    reasons = {entry["clip"]: entry["reason"] for entry in report["skipped"]}
    assert set(reasons) == {"faceless", "mute", "wordless", "broken"}
    assert "no face" in reasons["faceless"]
    assert "no sound" in reasons["mute"]
    assert "wordless.txt" in reasons["wordless"]
    assert "cannot be read" in reasons["broken"]
    for clip, reason in reasons.items():
        assert str(faulty / f"{clip}.mp4") in reason
    with open_database(output) as database:
        assert len(database) == report["units"]
        assert database.sequences.name == ("good1", "good2")
        assert database.report["skipped"] == report["skipped"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["me.h5", "me.h5.shards"]
    assert report["shards"] == str(tmp_path / "me.h5.shards")
    assert report["reused"] == 0 and "good1" in report["person"]


def test_build_for_people_names_every_skipped_clip(faulty: Path, tmp_path: Path, run: Run) -> None:
    status, out, err = run(
        *("build", faulty, "-o", tmp_path / "me.h5", "--jobs", 1, *QUICK),
        *("--exclude", "good2, mute,faceless"),
    )
    assert (status, err) == (0, "")
    assert "units from 1 clips" in out
    assert "skipped (2):" in out
    assert "wordless" in out and "broken" in out
    assert "good2" not in out and "mute" not in out


def test_limit_spreads_over_the_sorted_names(puppet_corpus: Path, tmp_path: Path, run: Run) -> None:
    clips = sorted(p.stem for p in puppet_corpus.glob("*.mp4"))
    status, out, _ = run(
        *("build", puppet_corpus, "-o", tmp_path / "one.h5", "--jobs", 1, "--json"),
        *("--exclude", ",".join(clips[3:]), "--limit", 2, "--codec", "webp:80", *QUICK),
    )
    assert status == 0
    with open_database(tmp_path / "one.h5") as database:
        assert database.sequences.name == (clips[0], clips[2])
        assert database.codec == "webp:80"
        assert len(database) == json.loads(out)["units"]


@pytest.mark.parametrize("after", ["nothing", "a clip"])
def test_an_interrupted_build_leaves_whole_clips_and_no_noise(
    puppet_corpus: Path, face_models: FaceModels, tmp_path: Path, run: Run, after: str
) -> None:
    """As a terminal does it: every process of the build is interrupted at once."""
    command = [
        *(sys.executable, "-m", "unitsel", "build", str(puppet_corpus)),
        *("-o", str(tmp_path / "me.h5"), "--jobs", "2", "--json", "--limit", "3", *QUICK),
    ]
    build = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    # Workers start when the clips' folder is there; their first clip comes seconds later.
    wanted = "me.h5.shards/*/*" + (".shard" if after == "a clip" else "")
    give_up = time.monotonic() + 120
    while not any(tmp_path.glob(wanted)) and build.poll() is None and time.monotonic() < give_up:
        time.sleep(0.02)
    assert any(tmp_path.glob(wanted)), "the build never came so far"
    if after == "nothing":
        time.sleep(0.3)
    os.killpg(build.pid, signal.SIGINT)
    out, err = build.communicate(timeout=60)
    assert build.returncode == 130, err
    assert "interrupted" in json.loads(out)["error"]
    # No worker says a word, wherever it was caught.
    assert err.count("\n") == 1 and err.startswith("unitsel: interrupted"), err
    kept = list(tmp_path.glob("me.h5.shards/*/*.shard"))
    assert [p.name for p in tmp_path.iterdir()] == (["me.h5.shards"] if kept else [])
    assert bool(kept) == (after == "a clip")
    assert not list(tmp_path.rglob("*.partial"))
    marks = (f"sem.loky-{build.pid}-", f"joblib_memmapping_folder_{build.pid}_")
    assert not [p for p in Path("/dev/shm").glob("*") if p.name.startswith(marks)]
    if kept:
        status, out, _ = run(*command[3:], "--jobs", 1)
        assert status == 0 and json.loads(out)["reused"] == len(kept)


def test_an_estimate_is_told_without_the_work(faulty: Path, tmp_path: Path, run: Run) -> None:
    arguments = ("build", faulty, "-o", tmp_path / "me.h5", "--estimate")
    status, out, err = run(*arguments, "--json")
    assert (status, err) == (0, "")
    estimate = json.loads(out)["estimate"]
    # One of the six cannot be opened, and each lasts 0.95 seconds.
    assert estimate["clips"] == 5 and estimate["reused"] == 0
    assert estimate["frames"] == pytest.approx(5 * 24, abs=5)
    assert 0 < estimate["seconds"] < 600
    assert estimate["free_bytes"] > estimate["needed_bytes"] > estimate["database_bytes"] > 0
    assert list(tmp_path.iterdir()) == []
    status, out, _ = run(*arguments)
    assert status == 0 and out.startswith("5 clips, ") and "of database" in out


def test_kept_clips_are_named_and_can_be_discarded(faulty: Path, tmp_path: Path, run: Run) -> None:
    chosen = ("--jobs", 1, "--exclude", "broken,faceless,mute,wordless", *QUICK)
    output, elsewhere = tmp_path / "me.h5", tmp_path / "kept"
    status, out, _ = run("build", faulty, "-o", output, *chosen, "--shards", elsewhere)
    assert status == 0 and f"kept for a build of more in {elsewhere} (" in out
    status, out, _ = run("build", faulty, "-o", output, *chosen, "--shards", elsewhere)
    assert status == 0 and "from 2 clips (2 of them analysed before)" in out
    status, out, _ = run("build", faulty, "-o", output, *chosen, "--discard-shards")
    assert status == 0 and "analysed before" not in out and "are kept" not in out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["kept", "me.h5"]
    both = ("--discard-shards", "--shards", elsewhere)
    status, _, err = run("build", faulty, "-o", output, *both)
    assert status == 2 and "not allowed with" in err
    status, out, _ = run("build", faulty, "-o", output, *chosen, "--person", "good2", "--restart")
    assert status == 0 and "kept for a build of more in" in out
