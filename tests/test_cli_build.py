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
    assert set(report) == {"database", "units", "sequences", "skipped", "repaired", "seconds"}
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
    assert [p.name for p in tmp_path.iterdir()] == ["me.h5"]


def test_build_for_people_names_every_skipped_clip(faulty: Path, tmp_path: Path, run: Run) -> None:
    status, out, err = run(
        *("build", faulty, "-o", tmp_path / "me.h5", "--jobs", 1),
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
        *("--exclude", ",".join(clips[3:]), "--limit", 2, "--codec", "webp:80"),
    )
    assert status == 0
    with open_database(tmp_path / "one.h5") as database:
        assert database.sequences.name == (clips[0], clips[2])
        assert database.codec == "webp:80"
        assert len(database) == json.loads(out)["units"]


def test_an_interrupted_build_leaves_nothing(
    puppet_corpus: Path, face_models: FaceModels, tmp_path: Path
) -> None:
    """As a terminal does it: every process of the build is interrupted at once."""
    build = subprocess.Popen(
        [
            *(sys.executable, "-m", "unitsel", "build", str(puppet_corpus)),
            *("-o", str(tmp_path / "me.h5"), "--jobs", "2", "--json"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    give_up = time.monotonic() + 60
    while not any(tmp_path.iterdir()) and build.poll() is None and time.monotonic() < give_up:
        time.sleep(0.05)
    assert any(tmp_path.iterdir()), "the build never began"
    time.sleep(0.3)
    os.killpg(build.pid, signal.SIGINT)
    out, err = build.communicate(timeout=60)
    assert build.returncode == 130, err
    assert "interrupted" in json.loads(out)["error"]
    # A worker caught while it starts complains too; the last word is ours.
    assert err.splitlines()[-1].startswith("unitsel: interrupted"), err
    assert list(tmp_path.iterdir()) == []
