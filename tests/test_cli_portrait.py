"""``unitsel portrait``, and the other commands on its head."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from database.heads import open_portrait
from database.media import probe
from database.portrait_mesh import OUTER_LIPS

Run = Callable[..., tuple[int, str, str]]

TIMING = "start,end,label\n0.0,0.1,sil\n0.1,0.2,m\n0.2,0.4,aa\n0.4,0.5,sil\n"


@pytest.fixture
def timing(tmp_path: Path) -> Path:
    path = tmp_path / "ma.csv"
    path.write_text(TIMING)
    return path


def test_a_photo_becomes_a_head(
    run: Run, portrait_photo: Path, face_models: object, tmp_path: Path
) -> None:
    head = tmp_path / "h.h5"
    status, out, err = run("portrait", portrait_photo, "-o", head, "--plots", tmp_path, "--json")
    assert (status, err) == (0, "")
    told = json.loads(out)
    assert told["width"] == 512 and 60 < told["mouth_width"] < 90
    assert {Path(p).name for p in told["plots"]} == {"mask.png", "mouths.png"}
    status, out, _ = run("inspect", head, "--json")
    assert status == 0 and json.loads(out)["vertices"] < 200


def test_a_mask_is_adjusted(
    run: Run, portrait_photo: Path, portrait_head: Path, tmp_path: Path
) -> None:
    with open_portrait(portrait_head) as head:
        x, y = head.mask.vertices[OUTER_LIPS[0]]
    change = tmp_path / "a.json"
    change.write_text(json.dumps({"drags": [{"from": [x, y], "to": [x - 4, y + 1]}]}))
    made = tmp_path / "h.h5"
    assert run("portrait", portrait_photo, "-o", made, "--adjust", change)[0] == 0
    with open_portrait(made) as head:
        assert head.mask.vertices[OUTER_LIPS[0]] == pytest.approx((x - 4, y + 1), abs=0.01)
        assert head.settings["adjustment"]["drags"]


def test_it_is_synthesised(run: Run, portrait_head: Path, timing: Path, tmp_path: Path) -> None:
    video = tmp_path / "o.mp4"
    status, out, err = run(
        *("synth", portrait_head, timing, "-o", video, "--still", "--fps", 25, "--json")
    )
    assert (status, err) == (0, "")
    assert json.loads(out)["frames"] == probe(video).frames == 12


@pytest.mark.parametrize(
    "option", [("--target", "paper"), ("--background", "x.mp4"), ("--explain", "x.html")]
)
def test_options_of_footage_are_refused(
    run: Run, portrait_head: Path, timing: Path, tmp_path: Path, option: tuple[str, str]
) -> None:
    status, out, err = run("synth", portrait_head, timing, "-o", tmp_path / "o.mp4", *option)
    assert status == 2 and out == "" and err.count("\n") == 1
    assert option[0] in err and not (tmp_path / "o.mp4").exists()


def test_options_of_portraits_are_refused_for_footage(
    run: Run, small_db: Path, timing: Path, tmp_path: Path
) -> None:
    status, _, err = run("synth", small_db, timing, "-o", tmp_path / "o.mp4", "--still")
    assert status == 2 and "--still" in err and "portraits" in err


def test_what_needs_footage_says_so(run: Run, portrait_head: Path) -> None:
    for command in (("evaluate", portrait_head, "--folds", 2), ("doctor", portrait_head)):
        status, _, err = run(*command)
        assert status == 2 and "is a portrait's head" in err and err.count("\n") == 1


def test_bad_photos_leave_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.png").write_text("no picture")
    status, _, err = run("portrait", tmp_path / "x.png", "-o", tmp_path / "h.h5")
    assert status == 2 and err.count("\n") == 1 and "x.png" in err
    status, _, err = run("portrait", tmp_path / "x.png", "-o", tmp_path / "h.mp4")
    assert status == 2 and ".h5" in err
    status, _, err = run("portrait", tmp_path / "x.png", "-o", tmp_path / "h.h5", "--face", "up")
    assert status == 2 and "chooses no face" in err
    assert not (tmp_path / "h.h5").exists()
