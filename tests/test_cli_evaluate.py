"""``unitsel evaluate`` over the puppet's database and a clip that it does not hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from database.media import probe, read_video
from database.reader import open_database
from database.sound import read_sound
from database.timing import Timing, write_timing
from unitsel.costs import Weights
from unitsel.likeness.side_by_side import STRIP
from unitsel.settings import SelectionSettings, TargetSettings

Run = Callable[..., tuple[int, str, str]]

SCORES = {
    *("r_pca", "r_h", "r_pca_speech", "r_h_speech", "sd_ratio", "r_h_mesh"),
    *("sl_avg", "tc_avg", "vc_avg"),
    *("closure_hits", "silence_ratio", "join_jump"),
}
METHODS = ("selected", "random", "phoneme_mean", "nearest", "real")
WITHOUT_UNITS = ("phoneme_mean", "real")


@pytest.fixture(scope="module")
def unseen(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Film a clip, and lay beside it a video that says nothing."""
    folder = tmp_path_factory.mktemp("unseen")
    track, words = puppet.even_track("set blue now please", 0.2, 0.9)
    puppet.write_clip(folder / "new.mp4", track, puppet.hum(track), 60)
    write_timing(folder / "new.TextGrid", Timing(track, words))
    (folder / "wordless.mp4").write_bytes((folder / "new.mp4").read_bytes())
    return folder


def test_json_holds_means_sentences_and_what_was_skipped(
    puppet_db: Path, unseen: Path, run: Run
) -> None:
    status, out, err = run("evaluate", puppet_db, unseen, "--json")
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    document = json.loads(out)
    assert set(document) == {*METHODS, "settings", "folds", "sentences", "skipped"}
    (sentence,) = document["sentences"]
    assert (sentence["clip"], sentence["words"]) == ("new", "set blue now please")
    for method in METHODS:
        assert set(document[method]) >= SCORES
        assert document[method] == sentence[method]
        for name in SCORES:
            lacks = method in WITHOUT_UNITS and name in ("sl_avg", "tc_avg", "vc_avg", "join_jump")
            assert isinstance(document[method][name], type(None) if lacks else float), name
    assert all(document["selected"][name] is not None for name in SCORES)
    (skipped,) = document["skipped"]
    assert skipped["clip"] == "wordless" and "wordless.txt" in skipped["reason"]


def test_text_has_a_row_a_method_and_the_plot_is_drawn(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    plots = tmp_path / "plots"
    settings = SelectionSettings(Weights(skip=0.5), target=TargetSettings("paper"))
    settings.write(tmp_path / "weights.json")
    status, out, err = run(
        *("evaluate", puppet_db, unseen, "--plots", plots, "--limit", 1),
        *("--weights", tmp_path / "weights.json"),
    )
    assert (status, err) == (0, "")
    rows = {line[:16].strip(): line[16:].split() for line in out.splitlines()}
    assert {"new", "selected (paper)", "random", "phoneme mean", "nearest", "real"} <= set(rows)
    assert rows["new"] == rows["selected (paper)"]
    assert len(rows["selected (paper)"]) == len(SCORES)
    titles = rows[""]
    for title in ("SL", "TC", "VC", "jump"):
        assert rows["phoneme mean"][titles.index(title)] == "-"
    assert rows["real"][titles.index("closed")] != "-"
    assert "wordless" not in out
    assert [p.name for p in plots.iterdir()] == ["new.png"]
    assert f"drawn: 1 plots in {plots}" in out
    picture = cv2.imread(str(plots / "new.png"))
    assert picture is not None and picture.shape[1] > 800 and picture.std() > 10


def test_an_evaluation_is_the_same_twice(puppet_db: Path, unseen: Path, run: Run) -> None:
    first = run("evaluate", puppet_db, unseen, "--limit", 1, "--json")
    assert run("evaluate", puppet_db, unseen, "--limit", 1, "--json") == first


def test_folds_need_no_footage(puppet_db: Path, run: Run) -> None:
    status, out, err = run("evaluate", puppet_db, "--folds", 2, "--limit", 3, "--jobs", 1)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert "mean over 3 sentences of the database, in 2 folds:" in lines
    assert any(line.startswith("selected (paper)") for line in lines)


def test_methods_are_rows_of_their_own(puppet_db: Path, run: Run) -> None:
    command = ("evaluate", puppet_db, "--folds", 2, "--limit", 1, "--jobs", 1, "--json")
    document = json.loads(run(*command, "--methods", "all")[1])
    assert document["paper"] == document["selected"]
    assert "guided" not in document and "prediction" not in document
    assert document["folds"] == 2


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((), "HELDOUT_DIR"),
        (("clips", "--folds", "2"), "HELDOUT_DIR"),
        (("clips", "--jobs", "2"), "--jobs"),
        (("--folds", "1"), "1 folds"),
        (("--folds", "99"), "99 folds"),
        (("--folds", "2", "--methods", "papre"), "'papre'"),
        (("--folds", "2", "--methods", "guided"), "'guided'"),
        (("--folds", "2", "--target", "sound"), "'sound'"),
        (("--folds", "2", "--methods", ","), "no target cost"),
    ],
)
def test_what_does_not_go_together(
    arguments: tuple[str, ...], named: str, puppet_db: Path, run: Run
) -> None:
    status, out, err = run("evaluate", puppet_db, *arguments)
    assert (status, out) == (2, "")
    assert err.startswith("unitsel: ") and err.count("\n") == 1 and named in err


def test_videos_show_the_recording_beside_what_was_made_of_it(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    videos = tmp_path / "videos"
    status, out, err = run("evaluate", puppet_db, unseen, "--video", videos, "--json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["videos"] == [str(videos / "new.mp4")] and document["without_video"] == []
    assert [p.name for p in videos.iterdir()] == ["new.mp4"]
    recorded, shown = probe(unseen / "new.mp4"), probe(videos / "new.mp4")
    assert shown.frames == recorded.frames and shown.fps == recorded.fps and shown.has_sound
    height, width = recorded.height, recorded.width
    assert shown.width == 2 * width and shown.height == height + STRIP
    differing = 0.0
    for real, both in zip(
        read_video(unseen / "new.mp4"), read_video(videos / "new.mp4"), strict=True
    ):
        below = both.planes.y[STRIP:].astype(float)
        left, right = below[:, :width], below[:, width:]
        coded = np.abs(left - real.planes.y).mean()
        assert coded < 4
        # All but the middle of the face is the recording's own.
        assert np.abs(right[:80] - real.planes.y[:80]).mean() < 1.5 * coded
        differing = max(differing, float(np.abs(left - right).max()))
    assert differing > 30
    there, made = (read_sound(p).samples for p in (unseen / "new.mp4", videos / "new.mp4"))
    assert np.corrcoef(there[4000:20000], made[4000:20000])[0, 1] > 0.8


def test_videos_of_the_database_s_own_sentences(puppet_db: Path, run: Run, tmp_path: Path) -> None:
    with open_database(puppet_db) as database:
        folds = len(database.sequences)
    status, out, err = run(
        *("evaluate", puppet_db, "--folds", folds, "--limit", 1, "--jobs", 1),
        *("--video", tmp_path, "--target", "paper"),
    )
    assert (status, err) == (0, "")
    assert f"videos: 1 in {tmp_path}" in out
    assert probe(tmp_path / "hopper1.mp4").height == 352 + STRIP


def test_a_recording_that_went_away_is_told_and_its_own_file_is_not_replaced(
    puppet_db: Path, unseen: Path, puppet: ModuleType, run: Run, tmp_path: Path
) -> None:
    before = (unseen / "new.mp4").read_bytes()
    status, out, _ = run("evaluate", puppet_db, unseen, "--video", unseen)
    assert status == 0
    assert "no video of new" in out and "is the recording itself" in out
    assert (unseen / "new.mp4").read_bytes() == before
    (tmp_path / "file").touch()
    status, _, err = run("evaluate", puppet_db, unseen, "--video", tmp_path / "file")
    assert status == 2 and err.count("\n") == 1 and "cannot be made" in err
