"""Builds that are killed, all processes at once, and started again."""

from __future__ import annotations

import contextlib
import importlib.util
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from analysis.face import FaceModels
from analysis.guide import GuideSettings
from database.timing import Timing, write_timing

SENTENCES = ("bin blue", "lay red", "place white", "set green")


@pytest.fixture(scope="module")
def kills() -> ModuleType:
    """Give `benchmarks/build_kills.py`."""
    path = Path(__file__).parent.parent / "benchmarks" / "build_kills.py"
    spec = importlib.util.spec_from_file_location("build_kills", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["build_kills"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def corpus(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four clips of half a second."""
    folder = tmp_path_factory.mktemp("four")
    for seed, sentence in enumerate(SENTENCES):
        track, words = puppet.even_track(sentence, 0.1, 0.25)
        puppet.write_clip(folder / f"clip{seed}.mp4", track, puppet.hum(track, seed), seed)
        write_timing(folder / f"clip{seed}.TextGrid", Timing(track, words))
    return folder


def test_killed_builds_give_the_same_database(
    kills: ModuleType, corpus: Path, face_models: FaceModels, tmp_path: Path
) -> None:
    instants = [
        kills.Instant("analysing clips", 0.5, 0.02),
        kills.Instant("learning from phonemes", 0.0, 0.05),
        kills.Instant("renaming", 1.0, 0.0),
    ]
    guide = GuideSettings(fewest_clips=4, hidden=8, members=1, epochs=1, steps=10, held_back=2)
    content, outcomes = kills.kill_builds(
        corpus, tmp_path, instants, jobs=2, again=1, guide=guide, lips="mesh-only", kept=True
    )
    assert [o.content for o in outcomes] == [content] * 3
    assert outcomes[0].killed and outcomes[1].killed
    assert outcomes[0].reused in (2, 3), "the clips that were done are kept"
    assert [o.reused for o in outcomes[1:]] == [4, 4]
    assert [o.after for o in outcomes] == [0, 0, 0], "left in shared memory"
    assert [o.litter for o in outcomes] == [[], [], []]


def test_workers_end_with_a_build_that_is_killed_alone(
    corpus: Path, face_models: FaceModels, tmp_path: Path
) -> None:
    """As the system does it where memory is short."""
    build = subprocess.Popen(
        [*(sys.executable, "-m", "unitsel", "build", str(corpus)), "-o", str(tmp_path / "x.h5")]
        + ["--jobs", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    give_up = time.monotonic() + 120
    while not any(tmp_path.glob("x.h5.shards/*/*.shard")) and time.monotonic() < give_up:
        assert build.poll() is None, "the build ended before a clip was done"
        time.sleep(0.02)
    assert len(_group(build.pid)) > 1
    build.kill()
    build.wait()
    give_up = time.monotonic() + 60
    while _group(build.pid) and time.monotonic() < give_up:
        time.sleep(0.1)
    assert not _group(build.pid)


def _group(leader: int) -> list[int]:
    """Processes of a group that are alive."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state, _, group = (path / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(group) == leader and state != "Z":
                found.append(int(path.name))
    return found


def test_instants_are_drawn_over_all_stages(kills: ModuleType) -> None:
    drawn = kills.draw_instants(20)
    assert drawn == kills.draw_instants(20) != kills.draw_instants(20, seed=1)
    assert {i.stage for i in drawn} >= {
        *("analysing clips", "describing mouths", "learning from phonemes", "learning from sound"),
        *("writing", "renaming", "renamed", "done", "finding the person", "fitting lips"),
    }
