"""Rigid motions as (3, 4) matrices ``[R | t]``: joined, undone, averaged, and what they see."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


def joined(a: Matrix, b: Matrix) -> Matrix:
    """First b, then a."""
    return _rows(a[:, :3] @ b[:, :3], a[:, :3] @ b[:, 3] + a[:, 3])


def inverse(a: Matrix) -> Matrix:
    """What undoes a."""
    return _rows(a[:, :3].T, -a[:, :3].T @ a[:, 3])


def to_six(a: Matrix) -> Matrix:
    """Rotation vector (radians) and shift (mm), (6,) float64."""
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(a[:, :3]))
    return np.concatenate([np.asarray(turn, dtype=np.float64).ravel(), a[:, 3]])


def from_six(six: Matrix) -> Matrix:
    """The motion of a rotation vector and a shift."""
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(six[:3], dtype=np.float64))
    return _rows(np.asarray(turn, dtype=np.float64), six[3:])


def usual_step(starts: Matrix, ends: Matrix) -> Matrix:
    """The motion C for which ends are most nearly ``joined(start, C)``, by medians.

    Parameters
    ----------
    starts, ends : (n, 3, 4) float64
    """
    steps = [to_six(joined(inverse(a), b)) for a, b in zip(starts, ends, strict=True)]
    return from_six(np.median(steps, axis=0))


def most_usual(poses: Matrix, radian: float = 100.0) -> int:
    """Place of the pose that is most like all others.

    Parameters
    ----------
    poses : (n, 3, 4) float64
    radian : float
        mm that a turn by a radian counts for: what it moves the face's rim by.
    """
    flat = (poses * np.array([radian, radian, radian, 1.0])).reshape(len(poses), -1)
    return int(np.linalg.norm(flat - np.median(flat, axis=0), axis=1).argmin())


def direction(pose: Matrix) -> Matrix:
    """From the mask's centre to the camera, in the mask's frame, a unit vector (3,)."""
    towards = -pose[:, :3].T @ pose[:, 3]
    return np.asarray(towards / np.linalg.norm(towards))


def angle(a: Matrix, b: Matrix) -> float:
    """Between unit vectors, radians."""
    return float(np.arccos(np.clip(a @ b, -1, 1)))


def _rows(turn: Matrix, shift: Matrix) -> Matrix:
    # In C order, whatever the parts', so that kernels are compiled for one layout.
    return np.ascontiguousarray(np.column_stack([turn, shift]))
