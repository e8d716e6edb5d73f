"""Camera intrinsics: from a calibration file, or estimated over a clip.

A calibration file is what OpenCV's tools write, YAML, XML or JSON: `camera_matrix` (3 x 3),
`image_width`, `image_height` and, where the lens bends lines, `distortion_coefficients`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.motion import RIGID, average_mask
from database.errors import CorpusError
from database.mask import Camera

MATRIX_NAMES: Final = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
WIDTH_NAMES: Final = ("image_width", "image_Width", "width")
HEIGHT_NAMES: Final = ("image_height", "image_Height", "height")
DISTORTION_NAMES: Final = (
    *("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "D"),
)

LARGEST_BEND: Final = 2.0
"""Pixels that the lens may move a point of the picture's inner half, for the camera to count as
free of distortion."""

PRIOR_SPREAD: Final = 0.35
"""Standard deviation of a lens's focal length around the assumed one, in natural logarithms."""

FEWEST_FRAMES: Final = 8
MOST_FRAMES: Final = 40
LANDMARK_ERROR: Final = 0.001
"""Least error of a landmark, in parts of the face's height."""


def read_camera(path: str | Path) -> Camera:
    """Read a calibrated camera.

    Raises
    ------
    CorpusError
        If the file cannot be read, lacks a field, or describes a lens that bends lines.
    """
    file = Path(path)
    if not file.is_file():
        raise CorpusError(f"{file}: there is no such calibration file")
    try:
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError) as error:
        raise CorpusError(
            f"{file}: cannot be read as OpenCV's YAML, XML or JSON; write it with cv2.FileStorage"
        ) from error
    try:
        matrix = _field(storage, MATRIX_NAMES, file).mat()
        width = _number(storage, WIDTH_NAMES, file)
        height = _number(storage, HEIGHT_NAMES, file)
        bend = next(
            (n for name in DISTORTION_NAMES if not (n := storage.getNode(name)).empty()), None
        )
        distortion = None if bend is None else bend.mat()
    except cv2.error as error:
        raise CorpusError(f"{file}: holds a field of the wrong kind ({error.err})") from error
    finally:
        storage.release()
    if matrix is None or matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise CorpusError(f"{file}: its camera matrix is not 3 x 3 finite numbers")
    fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
    if fx <= 0 or abs(fx - fy) > 0.02 * fx:
        raise CorpusError(
            f"{file}: focal lengths {fx:g} and {fy:g} are not those of square pixels; "
            "scale the footage to square pixels and calibrate again"
        )
    camera = Camera(
        (fx + fy) / 2, float(matrix[0, 2]), float(matrix[1, 2]), round(width), round(height)
    )
    if distortion is not None and distortion.size:
        moved = _bend(camera, np.asarray(distortion, dtype=np.float64).ravel())
        if not moved <= LARGEST_BEND:
            raise CorpusError(
                f"{file}: the lens moves points by {moved:.1f} pixels; "
                "undistort the footage (cv2.undistort) and calibrate again"
            )
    return camera


def _field(storage: Any, names: Sequence[str], file: Path) -> Any:
    for name in names:
        node = storage.getNode(name)
        if not node.empty():
            return node
    raise CorpusError(f"{file}: has no {names[0]}; write it with OpenCV's calibration")


def _number(storage: Any, names: Sequence[str], file: Path) -> float:
    value = float(_field(storage, names, file).real())
    if not value >= 1:
        raise CorpusError(f"{file}: {names[0]} is {value:g}, no size of a picture")
    return value


def _bend(camera: Camera, distortion: npt.NDArray[np.float64]) -> float:
    """Pixels that a lens moves points of the picture's inner half, at most."""
    x = np.linspace(-0.25, 0.25, 9)
    grid = np.stack(np.meshgrid(x * camera.width, x * camera.height), axis=-1).reshape(-1, 2)
    space = np.column_stack([grid / camera.focal, np.ones(len(grid))])
    seen, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), np.eye(3), distortion)
    apart = (np.asarray(seen).reshape(-1, 2) - space[:, :2]) * camera.focal
    return float(np.hypot(apart[:, 0], apart[:, 1]).max())


@dataclass(frozen=True)
class FocalEstimate:
    """Focal length from a clip.

    Parameters
    ----------
    focal : float
        Pixels: what the clip and the guess of `Camera.assumed` say together.
    error : float
        Standard deviation of its natural logarithm; `PRIOR_SPREAD` where the clip says nothing.
    """

    focal: float
    error: float


def estimate_focal(meshes: npt.NDArray[np.floating], width: int, height: int) -> FocalEstimate:
    """Estimate the focal length from a head that turns and moves.

    For each of some focal lengths the person's shape and the poses are fitted to the landmarks of
    frames that differ most; a near camera makes the near parts of a face larger, and by how much
    its landmarks fit best tells how near. A head that stays frontal and far says little: then the
    guess stands.

    Parameters
    ----------
    meshes : (n, 468, 3) float
        Face meshes of a clip, pixels.
    width, height : int
        Of its pictures.

    Raises
    ------
    CorpusError
        If there are fewer than 8 frames.
    """
    if len(meshes) < FEWEST_FRAMES:
        raise CorpusError(
            f"a focal length needs at least {FEWEST_FRAMES} frames with a face, not {len(meshes)}"
        )
    guess = Camera.assumed(width, height)
    chosen = np.asarray(meshes, dtype=np.float64)[_different(meshes)]
    steps = np.linspace(-1.2, 1.2, 9)
    size = float(np.ptp(chosen[:, :, 1], axis=1).mean())
    misfit = np.empty(len(steps))
    for k, step in enumerate(steps):
        camera = Camera(guess.focal * np.exp(step), guess.cx, guess.cy, width, height)
        misfit[k] = _misfit(chosen, camera)
    noise = max(float(misfit.min()) ** 0.5, LANDMARK_ERROR * size)
    # Landmarks of a face err together, over points and frames: they count as one in a hundred.
    count = chosen.shape[0] * len(RIGID) * 2 / 100
    cost = count * misfit / noise**2 / 2 + steps**2 / (2 * PRIOR_SPREAD**2)
    likely = np.exp(cost.min() - cost)
    likely /= likely.sum()
    mean = float(likely @ steps)
    spread = float(np.sqrt(likely @ (steps - mean) ** 2 + (steps[1] - steps[0]) ** 2 / 12))
    return FocalEstimate(guess.focal * float(np.exp(mean)), spread)


def _different(meshes: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """Frames whose meshes differ most from one another: farthest first."""
    flat = np.asarray(meshes, dtype=np.float64)[:, list(RIGID), :2]
    flat = flat.reshape(len(flat), -1)
    taken = [int(np.linalg.norm(flat - np.median(flat, axis=0), axis=1).argmin())]
    nearest = np.full(len(flat), np.inf)
    for _ in range(min(MOST_FRAMES, len(flat)) - 1):
        nearest = np.minimum(nearest, np.linalg.norm(flat - flat[taken[-1]], axis=1))
        taken.append(int(nearest.argmax()))
    return np.sort(np.array(taken))


def _misfit(meshes: npt.NDArray[np.float64], camera: Camera) -> float:
    """Mean square distance of landmarks from the best shape at the best poses, pixels squared."""
    rigid = list(RIGID)
    shape = average_mask([meshes[0]], [camera]).vertices[rigid].astype(np.float64)
    seen = np.ascontiguousarray(meshes[:, rigid, :2])
    turns = [np.zeros(3)] * len(seen)
    shifts = [np.array([0.0, 0.0, camera.focal * 1.0])] * len(seen)
    error = np.inf
    for sweep in range(6):
        rows, sides = [], []
        total = 0.0
        for i, points in enumerate(seen):
            if sweep == 0:
                _, r, t = cv2.solvePnP(shape, points, camera.matrix, None, flags=cv2.SOLVEPNP_EPNP)
                turns[i] = np.asarray(r, dtype=np.float64).ravel()
                shifts[i] = np.asarray(t, dtype=np.float64).ravel()
            _, r, t = cv2.solvePnP(
                shape, points, camera.matrix, None, turns[i].copy(), shifts[i].copy(), True
            )
            turns[i] = np.asarray(r, dtype=np.float64).ravel()
            shifts[i] = np.asarray(t, dtype=np.float64).ravel()
            turn = np.asarray(cv2.Rodrigues(turns[i])[0])
            space = shape @ turn.T + shifts[i]
            flat = space[:, :2] / space[:, 2:] * camera.focal + [camera.cx, camera.cy]
            off = points - flat
            total += float((off**2).mean())
            # How a pixel moves with the shape's point, (points, 2, 3).
            scale = camera.focal / space[:, 2]
            slope = np.zeros((len(shape), 2, 3))
            for axis in (0, 1):
                ratio = space[:, axis] / space[:, 2]
                slope[:, axis] = scale[:, None] * (turn[axis] - ratio[:, None] * turn[2])
            rows.append(np.einsum("pki,pkj->pij", slope, slope))
            sides.append(np.einsum("pki,pk->pi", slope, off))
        error = total / len(seen)
        hessian = np.sum(rows, axis=0) + 1e-6 * np.eye(3)
        shape = shape + np.linalg.solve(hessian, np.sum(sides, axis=0)[..., None])[..., 0]
    return error
