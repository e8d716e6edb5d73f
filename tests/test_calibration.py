"""Intrinsics from a file, and estimated from a head that turns."""

import cv2
import numpy as np
import pytest

from analysis.calibration import PRIOR_SPREAD, estimate_focal, read_camera
from analysis.motion import make_mask
from database.errors import CorpusError
from database.mask import Camera, project

MATRIX = np.array([[812.5, 0, 181.0], [0, 813.5, 140.5], [0, 0, 1]])


def write(path, matrix=MATRIX, distortion=None, **sizes):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"image_width": 360, "image_height": 288, **sizes}.items():
        if value is not None:
            storage.write(name, value)
    if matrix is not None:
        storage.write("camera_matrix", matrix)
    if distortion is not None:
        storage.write("distortion_coefficients", np.array(distortion))
    storage.release()
    return path


@pytest.mark.parametrize("kind", ["yml", "yaml", "json", "xml"])
def test_a_calibrated_camera_is_read(tmp_path, kind):
    camera = read_camera(write(tmp_path / f"camera.{kind}", distortion=[0.0, 0, 0, 0, 0]))
    assert camera == Camera(813.0, 181.0, 140.5, 360, 288)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"matrix": None}, "has no camera_matrix"),
        ({"matrix": MATRIX[:2]}, "not 3 x 3"),
        ({"matrix": np.diag([800.0, 600.0, 1.0])}, "square pixels"),
        ({"image_width": None}, "has no image_width"),
        ({"image_height": 0}, "no size of a picture"),
        ({"distortion": [-0.9, 0.2, 0, 0, 0]}, "undistort the footage"),
    ],
)
def test_what_is_no_calibration(tmp_path, change, says):
    path = write(tmp_path / "camera.yml", **change)
    with pytest.raises(CorpusError, match=says) as caught:
        read_camera(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"nonsense", b"%YAML:1.0\n---\n- [", b"{]"])
def test_what_is_no_file_of_opencv(tmp_path, content):
    path = tmp_path / "camera.yml"
    path.write_bytes(content)
    with pytest.raises(CorpusError, match=r"camera\.yml"):
        read_camera(path)
    with pytest.raises(CorpusError, match="no such"):
        read_camera(tmp_path / "missing.yml")


@pytest.fixture(scope="module")
def shape(face_models, puppet):
    from analysis.face import FaceFinder

    picture = puppet.portrait()
    points = FaceFinder(face_models).find(picture).points
    return make_mask(points, Camera.assumed(512, 600)).vertices.astype(np.float64)


def meshes(shape, focal, amount, noise=0.3, n=30):
    """A clip's face meshes: a head that turns before a camera, its face 70 pixels across."""
    rng = np.random.default_rng(1)
    camera = Camera.assumed(360, 288, focal)
    waves = np.sin(rng.uniform(1, 3, 6)[:, None] * np.arange(n) / 6 + rng.uniform(0, 6, 6)[:, None])
    distance = focal * 88.9 / 71
    out = []
    for i in range(n):
        turn, _ = cv2.Rodrigues(np.radians([15, 20, 8]) * amount * waves[:3, i])
        place = np.array([30, 20, 80]) * amount * waves[3:, i] + [0, 0, distance]
        pose = np.column_stack([turn, place])
        depth = shape @ turn[2] * focal / distance
        out.append(np.column_stack([project(shape, pose, camera), depth]))
    return np.array(out) + rng.normal(0, noise, (n, 468, 3))


@pytest.mark.parametrize("focal", [400, 720, 1100])
def test_the_focal_length_of_a_turning_head(shape, focal):
    found = estimate_focal(meshes(shape, focal, 1.0), 360, 288)
    assert found.error < 0.8 * PRIOR_SPREAD
    assert abs(np.log(found.focal / focal)) < 0.25
    if focal != 720:
        # Nearer the truth than the guess, which is 720.
        assert abs(np.log(found.focal / focal)) < 0.6 * abs(np.log(720 / focal))


def test_a_still_head_leaves_the_guess(shape):
    found = estimate_focal(meshes(shape, 1100, 0.05), 360, 288)
    assert found.focal == pytest.approx(720, rel=0.1)
    assert found.error > 0.9 * PRIOR_SPREAD
    with pytest.raises(CorpusError, match="at least 8 frames"):
        estimate_focal(meshes(shape, 720, 1.0, n=5), 360, 288)
