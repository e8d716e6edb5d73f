"""``unitsel evaluate`` over the puppet's database and a clip that it does not hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import pytest

from database.timing import Timing, write_timing
from unitsel.costs import Weights

Run = Callable[..., tuple[int, str, str]]

SCORES = {
    *("r_pca", "r_h", "r_pca_speech", "r_h_speech", "sd_ratio", "r_h_mesh"),
    *("sl_avg", "tc_avg", "vc_avg"),
}
METHODS = ("selected", "random", "phoneme_mean", "nearest")


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
    assert set(document) == {*METHODS, "sentences", "skipped"}
    (sentence,) = document["sentences"]
    assert (sentence["clip"], sentence["words"]) == ("new", "set blue now please")
    for method in METHODS:
        assert set(document[method]) >= SCORES
        assert document[method] == sentence[method]
        for name in SCORES - {"r_h_mesh", "sl_avg", "tc_avg", "vc_avg"}:
            assert isinstance(document[method][name], float)
    assert all(document["selected"][name] is not None for name in SCORES)
    (skipped,) = document["skipped"]
    assert skipped["clip"] == "wordless" and "wordless.txt" in skipped["reason"]


def test_text_has_a_row_a_method_and_the_plot_is_drawn(
    puppet_db: Path, unseen: Path, run: Run, tmp_path: Path
) -> None:
    plots = tmp_path / "plots"
    Weights(skip=0.5).write(tmp_path / "weights.json")
    status, out, err = run(
        *("evaluate", puppet_db, unseen, "--plots", plots, "--limit", 1),
        *("--weights", tmp_path / "weights.json"),
    )
    assert (status, err) == (0, "")
    rows = {line[:12].strip(): line.split() for line in out.splitlines()}
    assert {"new", "selected", "random", "phoneme mean", "nearest"} <= set(rows)
    assert rows["new"][1:] == rows["selected"][1:]
    assert len(rows["selected"]) == 1 + len(SCORES)
    assert rows["phoneme mean"][-3:] == ["-"] * 3
    assert "wordless" not in out
    assert [p.name for p in plots.iterdir()] == ["new.png"]
    assert f"drawn: 1 plots in {plots}" in out
    picture = cv2.imread(str(plots / "new.png"))
    assert picture is not None and picture.shape[1] > 800 and picture.std() > 10


def test_an_evaluation_is_the_same_twice(puppet_db: Path, unseen: Path, run: Run) -> None:
    first = run("evaluate", puppet_db, unseen, "--limit", 1, "--json")
    assert run("evaluate", puppet_db, unseen, "--limit", 1, "--json") == first
