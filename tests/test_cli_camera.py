"""``unitsel build`` told of the camera and of points marked by hand."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.face import FaceFinder
from analysis.hand_points import MESH_POINTS
from database.media import probe, read_video
from database.reader import open_database

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def corpus_of_one(puppet_corpus: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "corpus"
    folder.mkdir()
    for path in puppet_corpus.glob("hopper1.*"):
        shutil.copy(path, folder)
    return folder


def test_points_and_a_calibrated_camera_rule_the_mask(
    corpus_of_one: Path, tmp_path: Path, finder: FaceFinder, run: Run
) -> None:
    video = corpus_of_one / "hopper1.mp4"
    info = probe(video)
    picture = next(iter(read_video(video))).rgb
    found = finder.find(picture)
    assert found is not None
    marked = {n: found.points[list(i), :2].mean(axis=0).tolist() for n, i in MESH_POINTS.items()}
    points, camera = tmp_path / "points.json", tmp_path / "camera.yml"
    points.write_text(json.dumps({"clip": "hopper1", "frame": 0, "points": marked}))
    # Calibrated at twice the size of the footage.
    focal = 3.0 * info.width
    matrix = np.array([[focal, 0, info.width], [0, focal, info.height], [0, 0, 1]], float)
    storage = cv2.FileStorage(str(camera), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", matrix)
    storage.write("image_width", 2 * info.width)
    storage.write("image_height", 2 * info.height)
    storage.release()
    output = tmp_path / "me.h5"
    told = ("--points", points, "--camera", camera)
    status, out, err = run("build", corpus_of_one, "-o", output, "--jobs", 1, *told)
    assert (status, err) == (0, ""), out
    with open_database(output) as db:
        assert (db.camera.width, db.camera.height) == (info.width, info.height)
        assert db.camera.focal == pytest.approx(focal / 2)


def test_one_camera_is_enough(tmp_path: Path, run: Run) -> None:
    output = tmp_path / "a.h5"
    status, _, err = run("build", tmp_path, "-o", output, "--focal", 700, "--camera", "a.yml")
    assert status != 0 and "not allowed with" in err
    status, _, err = run("build", tmp_path, "-o", output, "--camera", tmp_path / "a.yml")
    assert status != 0 and "no such calibration file" in err and err.count("\n") == 1


def test_points_of_another_clip(corpus_of_one: Path, tmp_path: Path, run: Run) -> None:
    points = tmp_path / "points.json"
    names = {name: [1.0, 2.0] for name in MESH_POINTS}
    points.write_text(json.dumps({"clip": "other", "frame": 0, "points": names}))
    output = tmp_path / "me.h5"
    status, out, err = run("build", corpus_of_one, "-o", output, "--points", points)
    assert status != 0 and not output.exists()
    assert "'other'" in err and err.count("\n") == 1, out
