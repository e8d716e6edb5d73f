"""``unitsel train`` on the puppet: what it writes and says, and that no stop loses work."""

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

import pytest

from database.fingerprint import identity
from database.reader import open_database
from database.timing import Timing, write_timing
from unitsel.cli import main
from unitsel.settings import SelectionSettings, default_settings

Run = Callable[..., tuple[int, str, str]]

MEASURES = {"tc_avg", "sl_avg", "vc_avg", "r_pca_speech", "r_h_speech", "sd_ratio"}


@pytest.fixture(scope="module")
def unseen(
    puppet: ModuleType, puppet_corpus: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Film a clip, and lay beside it one that the database holds."""
    folder = tmp_path_factory.mktemp("unseen")
    track, words = puppet.even_track("set blue now please", 0.2, 0.9)
    puppet.write_clip(folder / "new.mp4", track, puppet.hum(track), 60)
    write_timing(folder / "new.TextGrid", Timing(track, words))
    for extension in ("mp4", "TextGrid"):
        source = puppet_corpus / f"hopper1.{extension}"
        (folder / f"old.{extension}").write_bytes(source.read_bytes())
    return folder


@pytest.fixture(scope="module")
def trained(puppet_db: Path, unseen: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Train without a stop, and give the file."""
    path = tmp_path_factory.mktemp("trained") / "weights.json"
    assert main(command(puppet_db, unseen, path)[3:]) == 0
    return path.read_bytes()


@pytest.fixture(scope="module")
def trained_apart(puppet_db: Path, unseen: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Train in a process of its own.

    In this one, other tests may have changed how many threads add numbers, and so the last digits.
    """
    path = tmp_path_factory.mktemp("apart") / "weights.json"
    subprocess.run(command(puppet_db, unseen, path), check=True, capture_output=True)
    return path.read_bytes()


def assert_same_document(found: object, wanted: object) -> None:
    """Equal but for the last digits of measures: two processes may add in another order."""
    if isinstance(wanted, dict) and isinstance(found, dict):
        assert list(found) == list(wanted)
        for key, value in wanted.items():
            assert_same_document(found[key], value)
    elif isinstance(wanted, list) and isinstance(found, list):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert_same_document(one, other)
    elif isinstance(wanted, float):
        assert found == pytest.approx(wanted, rel=1e-6)
    else:
        assert found == wanted


def command(database: Path, folder: Path, output: Path, *more: str) -> list[str]:
    made = [sys.executable, "-m", "unitsel", "train", str(database), str(folder), "-o", str(output)]
    return [*made, "--generations", "4", "--jobs", "1", *more]


def test_the_file_is_written_told_and_drawn(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path, trained: bytes
) -> None:
    output, plots = tmp_path / "weights.json", tmp_path / "plots"
    status, out, err = run(
        *(
            "train",
            puppet_db,
            unseen,
            "-o",
            output,
            "--generations",
            4,
            "--jobs",
            1,
            "--plots",
            plots,
        )
    )
    assert (status, err) == (0, "")
    assert output.read_bytes() == trained
    with open_database(puppet_db) as database:
        settings = SelectionSettings.read(output, database=identity(database))
    assert settings.target.name == "paper"
    rows = {line[:12].strip(): line.split() for line in out.splitlines()}
    assert {"front", "most alike", "default", "chosen"} <= set(rows)
    assert float(rows["chosen"][1]) == pytest.approx(settings.weights.visual, rel=1e-3)
    assert float(rows["chosen"][2]) == pytest.approx(settings.weights.skip, rel=1e-3)
    assert "skipped (1):" in out and "old.mp4: is part of the database" in out
    drawn = {f"{n}.png" for n in ("front", "correlations", "trajectories")}
    assert {p.name for p in plots.iterdir()} == drawn
    assert all(f"drawn: {plots / name}" in out for name in drawn)
    # Nothing of the work in progress is left.
    assert {p.name for p in tmp_path.iterdir()} == {"weights.json", "plots"}


def test_json_is_one_document(puppet_db: Path, unseen: Path, run: Run, tmp_path: Path) -> None:
    output = tmp_path / "weights.json"
    status, out, err = run(
        *(
            "train",
            puppet_db,
            unseen,
            "-o",
            output,
            "--generations",
            1,
            "--jobs",
            1,
            "--seed",
            5,
            "--json",
        )
    )
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    document = json.loads(out)
    content = json.loads(output.read_text())
    for part in ("weights", "costs", "target", "database"):
        assert document[part] == content[part]
    assert len(document["front"]) == content["about"]["front_size"] == document["front_size"]
    assert all(point in document["front"] for point in content["about"]["front"])
    assert all(set(point) == {"visual", "skip"} | MEASURES for point in document["front"])
    assert document["chosen"] in document["front"]
    assert document["settings"]["seed"] == 5
    assert document["tried"] == document["sets"]
    assert (document["weights_file"], document["stored"], document["plots"]) == (
        *(str(output), False),
        [],
    )
    assert [s["clip"] for s in document["skipped"]] == ["old"]


def test_weights_are_taken_by_synth_and_stored_ones_by_all(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    database = tmp_path / "me.h5"
    database.write_bytes(puppet_db.read_bytes())
    output = tmp_path / "weights.json"
    status, out, err = run(
        *("train", database, unseen, "-o", output, "--generations", 1, "--jobs", 1, "--store")
    )
    assert (status, err) == (0, "")
    assert f"{database}: has these settings as its own now" in out
    with open_database(database) as opened:
        settings = default_settings(opened)
        assert settings == SelectionSettings.read(output, database=identity(opened))
        assert opened.selection == settings.as_json()
    by_file = run("evaluate", puppet_db, unseen, "--weights", output, "--json")
    own = run("evaluate", database, unseen, "--json")
    assert by_file[0] == own[0] == 0
    assert by_file[1] == own[1]
    # Trained again, it starts from the same place: nothing of what is stored leaks in.
    again = tmp_path / "again.json"
    assert run("train", database, unseen, "-o", again, "--generations", 1, "--jobs", 1)[0] == 0
    assert again.read_bytes() == output.read_bytes()


@pytest.mark.parametrize(
    ("stop", "jobs", "status"), [(signal.SIGKILL, "1", -9), (signal.SIGINT, "2", 130)]
)
def test_a_stopped_run_resumes_to_the_same_front(
    puppet_db: Path,
    unseen: Path,
    tmp_path: Path,
    trained_apart: bytes,
    stop: signal.Signals,
    jobs: str,
    status: int,
) -> None:
    output = tmp_path / "weights.json"
    state = tmp_path / "weights.json.partial"
    started = subprocess.Popen(
        command(puppet_db, unseen, output, "--jobs", jobs),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        waited = time.monotonic() + 120
        while not state.is_file() or state.read_bytes().count(b"\n") < 20:
            assert started.poll() is None and time.monotonic() < waited
            time.sleep(0.005)
        os.kill(started.pid, stop)
        out, err = started.communicate(timeout=60)
    finally:
        started.kill()
    assert started.returncode == status
    assert "Traceback" not in err and out == ""
    if stop == signal.SIGINT:
        assert err.count("\n") == 1 and "interrupted" in err
    assert {p.name for p in tmp_path.iterdir()} == {"weights.json.partial"}
    tried = len(state.read_bytes().splitlines()) - 1
    again = command(puppet_db, unseen, output, "--resume", "--json")
    document = json.loads(subprocess.run(again, check=True, capture_output=True).stdout)
    assert 0 < document["tried"] <= document["sets"] - tried + 1 < document["sets"]
    assert_same_document(json.loads(output.read_bytes()), json.loads(trained_apart))
    assert {p.name for p in tmp_path.iterdir()} == {"weights.json"}


def test_the_state_of_another_training_is_refused(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    output = tmp_path / "weights.json"
    state = tmp_path / "weights.json.partial"
    state.write_text(json.dumps({"format": "unitsel-training", "version": 1, "seed": 9}) + "\n")
    given = ("train", puppet_db, unseen, "-o", output, "--generations", 1, "--jobs", 1)
    status, out, err = run(*given, "--resume")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert str(state) in err and "another seed" in err and "leave out --resume" in err
    assert state.is_file() and not output.exists()
    assert run(*given)[0] == 0


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("-o", "weights.txt"), "weights.txt: give it one of the extensions .json"),
        (("-o", "no/weights.json"), "the folder no does not exist"),
        (("-o", "w.json", "--seed", "-1"), "'-1' is not a whole number"),
        (("-o", "w.json", "--sentences", "0"), "'0' is not a whole number above zero"),
        (("-o", "w.json", "--target", "best"), "invalid choice: 'best'"),
        ((), "-o"),
    ],
)
def test_bad_arguments_are_one_line(
    puppet_db: Path,
    unseen: Path,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run("train", puppet_db, unseen, *more)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1 and words in err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_clips_and_a_guide_that_is_not_there(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, more, words in (
        (empty, (), str(empty)),
        (tmp_path / "none", (), "none: is not a folder"),
        (unseen, ("--target", "guided"), "holds no guide from phonemes"),
    ):
        status, out, err = run("train", puppet_db, folder, "-o", tmp_path / "w.json", *more)
        assert (status, out) == (2, "")
        assert err.count("\n") == 1 and words in err
    assert [p.name for p in tmp_path.iterdir()] == ["empty"]
