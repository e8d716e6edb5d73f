"""The 20 points of the lips: 12 on the outer contour, 8 on the inner one.

Both go clockwise in the picture from the left corner: left corner, five points above, right
corner, five below; inside three above and three below. Liu and Ostermann 2009, section 4.2,
figure 5.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from analysis.lips import lip_geometry
from database.errors import CorpusError
from database.lip_model import N_POINTS
from database.mask import INNER_LIPS, OUTER_LIPS, Camera, Mask, Poses

F64 = npt.NDArray[np.float64]

N_OUTER: Final = 12

OUTER_POINTS: Final = (61, 39, 37, 0, 267, 269, 291, 321, 405, 17, 181, 91)
"""Mesh points of the outer 12: where people mark lips, the bow's two peaks among them."""

INNER_POINTS: Final = (78, 81, 13, 311, 308, 402, 14, 178)
"""Mesh points of the inner 8."""

LEFT, RIGHT = 0, 6
"""The corners of the mouth."""

_CONTOUR: Final = (*OUTER_LIPS, *INNER_LIPS)
PLACES: Final = tuple(_CONTOUR.index(i) for i in (*OUTER_POINTS, *INNER_POINTS))
"""Of the 20 points among the 40 of `analysis.lips.LipGeometry.contours`."""

_KNOTS: Final = (
    tuple(OUTER_LIPS.index(i) for i in OUTER_POINTS),
    tuple(INNER_LIPS.index(i) for i in INNER_POINTS),
)

Marks = dict[tuple[str, int], F64]
"""Points marked by hand, (20, 2) pixels of the recorded picture, by clip and frame."""


def points_of_contours(contours: npt.NDArray[np.floating]) -> F64:
    """The 20 points of contours of 40, (..., 40, 2) to (..., 20, 2)."""
    return np.asarray(contours, dtype=np.float64)[..., list(PLACES), :]


def contours_of_points(points: npt.NDArray[np.floating]) -> F64:
    """Contours of 40 points through the 20: closed cubic splines.

    Parameters
    ----------
    points : (n, 20, 2) float

    Returns
    -------
    (n, 40, 2) float64
        Outer then inner contour, each from the left corner, clockwise in the picture, as
        `analysis.lips.LipGeometry` has them. The 20 points are among them.
    """
    shapes = np.asarray(points, dtype=np.float64)
    edges = (shapes[:, :N_OUTER], shapes[:, N_OUTER:])
    return np.concatenate(
        [
            # A corner is sharp: above and below it the lips are two curves.
            _half_splines(edge, np.array(knots), places)
            for edge, knots, places in zip(
                edges, _KNOTS, (len(OUTER_LIPS), len(INNER_LIPS)), strict=True
            )
        ],
        axis=1,
    )


def _half_splines(edge: F64, knots: npt.NDArray[np.int64], count: int) -> F64:
    """Two splines from corner to corner, (n, count, 2)."""
    out = np.empty((len(edge), count, 2))
    corner = len(knots) // 2
    wrapped = np.concatenate([edge, edge[:, :1]], axis=1)
    at = np.append(knots, count)
    for first, last in ((0, corner), (corner, len(knots))):
        curve = CubicSpline(at[first : last + 1], wrapped[:, first : last + 1], axis=1)
        places = np.arange(at[first], at[last])
        out[:, places] = curve(places)
    return out


def read_marks(path: str | Path) -> Marks:
    """Points marked by hand: a csv file with the columns clip, frame, point, x and y.

    Each marked frame has 20 rows, point 0 to 19; x and y are pixels of the recorded picture,
    frame counts from 0 at the database's rate.

    Raises
    ------
    CorpusError
        If the file cannot be read or a frame's points are incomplete.
    """
    file = Path(path)
    marks: dict[tuple[str, int], F64] = {}
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            needed = {"clip", "frame", "point", "x", "y"}
            if not needed <= set(reader.fieldnames or ()):
                raise CorpusError(f"{file}: line 1 must name the columns clip,frame,point,x,y")
            for row in reader:
                try:
                    key = (row["clip"].strip(), int(row["frame"]))
                    point, place = int(row["point"]), (float(row["x"]), float(row["y"]))
                except (AttributeError, TypeError, ValueError) as error:
                    raise CorpusError(
                        f"{file}: line {reader.line_num} is not clip, frame, point and two "
                        f"numbers ({error})"
                    ) from error
                if not (0 <= point < N_POINTS and np.isfinite(place).all()):
                    raise CorpusError(
                        f"{file}: line {reader.line_num}: points are 0 to {N_POINTS - 1}, x and y "
                        "finite"
                    )
                marks.setdefault(key, np.full((N_POINTS, 2), np.nan))[point] = place
    except OSError as error:
        raise CorpusError(f"{file}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise CorpusError(f"{file}: is no csv file ({error})") from error
    for (clip, frame), points in marks.items():
        lacking = np.flatnonzero(np.isnan(points).any(axis=1))
        if len(lacking):
            raise CorpusError(
                f"{file}: frame {frame} of {clip} lacks point {lacking[0]}; mark all {N_POINTS}"
            )
    if not marks:
        raise CorpusError(f"{file}: holds no marked points")
    return marks


def marks_in_crop(
    marks: Mapping[int, F64], poses: Poses, numbers: npt.ArrayLike, mask: Mask, camera: Camera
) -> dict[int, F64]:
    """Marked points of one clip in crop pixels.

    Parameters
    ----------
    marks : mapping of frame number to (20, 2) float64
        Pixels of the recorded picture.
    poses : Poses of length n
    numbers : (n,) int
        Frame numbers of the poses.
    mask, camera
        What was filmed, and how; a point is taken to lie as deep as its mesh point.

    Returns
    -------
    dict of index among the n frames to (20, 2) float64
        Frames without a pose are left out.
    """
    places = {int(number): i for i, number in enumerate(np.asarray(numbers))}
    found = {}
    for number, points in marks.items():
        i = places.get(number)
        if i is None:
            continue
        landmarks = np.zeros((1, len(mask.vertices), 2))
        landmarks[0, [*OUTER_POINTS, *INNER_POINTS]] = points
        at = Poses(poses.rotations[i : i + 1], poses.translations[i : i + 1])
        contours = lip_geometry(landmarks, at, mask, camera, [0], smoothing=1).contours
        found[i] = mask.patch.to_crop(points_of_contours(contours)[0])
    return found
