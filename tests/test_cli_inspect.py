"""``unitsel inspect``: what a database holds, in text, JSON and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2

Run = Callable[..., tuple[int, str, str]]


def test_json(small_db: Path, run: Run) -> None:
    status, out, err = run("inspect", small_db, "--json")
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    document = json.loads(out)
    assert document["path"] == str(small_db)
    assert document["units"] == sum(document["visemes"].values())
    assert document["plots"] == []
    assert {"sequences", "fps", "phonemes", "missing_phonemes", "ranges", "clips"} <= set(document)
    assert document["clips"][0]["name"] == "clip00"


def test_text_and_plots(small_db: Path, run: Run, tmp_path: Path) -> None:
    plots = tmp_path / "plots"
    before = small_db.read_bytes()
    status, out, err = run("inspect", small_db, "--plots", plots)
    assert (status, err) == (0, "")
    assert f"{small_db}: 444 units from 6 sequences" in out
    assert "phonemes without a unit:" in out and "zh" in out
    assert "  5 er                   0" in out
    drawn = sorted(plots.iterdir())
    assert [p.name for p in drawn] == ["extreme-mouths.png", "typical-mouths.png", "visemes.png"]
    for path in drawn:
        assert f"drawn: {path}" in out
        picture = cv2.imread(str(path))
        assert picture is not None and picture.std() > 10
    assert small_db.read_bytes() == before


def test_plots_into_a_folder_that_is_there(small_db: Path, run: Run, tmp_path: Path) -> None:
    status, out, _ = run("inspect", small_db, "--plots", tmp_path, "--json")
    assert status == 0
    assert sorted(json.loads(out)["plots"]) == sorted(str(p) for p in tmp_path.iterdir())
