"""Who is filmed: the frame of a corpus that the person's mask is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.face import FaceFinder, FaceMesh
from analysis.motion import CropSettings, make_mask
from database.errors import FaceError, UnitselError
from database.mask import OUTER_EYE_CORNERS, Camera, Mask
from database.media import read_video

ENOUGH_VIDEOS: Final = 5
"""Videos with a face that are looked at before the best frame so far will do."""

_BETWEEN_LIPS: Final = (13, 14)
_NOSE_TIP: Final = 1


@dataclass(frozen=True)
class Person:
    """What a build knows of the person before it looks at the clips one by one.

    Parameters
    ----------
    mask : Mask
    camera : Camera
        Of the pictures that the mask was made of.
    """

    mask: Mask
    camera: Camera


def study_person(
    videos: Sequence[Path],
    finder: FaceFinder,
    *,
    focal: float | None = None,
    crop: CropSettings | None = None,
) -> Person:
    """Make the person's mask of the first good frame: frontal, upright, lips together.

    Parameters
    ----------
    videos : sequence of Path
    finder : FaceFinder
    focal : float, optional
        Focal length in pixels of the first video's pictures.
    crop : CropSettings, optional

    Returns
    -------
    Person

    Raises
    ------
    FaceError
        If no video shows a face.
    """
    best: tuple[float, FaceMesh, Camera] | None = None
    seen = 0
    for video in videos:
        finder.reset()
        met = False
        try:
            for frame in read_video(video):
                mesh = finder.find(frame.rgb)
                if mesh is None:
                    continue
                met = True
                height, width = frame.rgb.shape[:2]
                fault = _fault(mesh.points, width, height)
                if best is None or fault < best[0]:
                    best = (fault, mesh, Camera.assumed(width, height, focal))
                if fault < 1:
                    break
        except UnitselError:
            continue  # The build names unreadable clips when it comes to them.
        seen += met
        if best is not None and (best[0] < 1 or seen >= ENOUGH_VIDEOS):
            break
    if best is None:
        others = f", nor do the other {len(videos) - 1} clips" if len(videos) > 1 else ""
        raise FaceError(
            f"{videos[0]}: shows no face{others}; film one face that looks into the camera"
        )
    _, mesh, camera = best
    return Person(make_mask(mesh.points, camera, crop), camera)


def _fault(points: npt.NDArray[np.float32], width: int, height: int) -> float:
    """How far a face is from frontal, upright, closed and wholly seen; below 1 will do."""
    left, right = points[OUTER_EYE_CORNERS[0]], points[OUTER_EYE_CORNERS[1]]
    across = (right - left)[:2]
    eyes = float(np.linalg.norm(across))
    along = across / eyes
    # Turned aside: the nose's tip is not midway between the eyes.
    aside = abs(float((points[_NOSE_TIP, :2] - (left + right)[:2] / 2) @ along)) / eyes
    tilt = abs(float(np.arctan2(across[1], across[0])))
    gap = points[_BETWEEN_LIPS[1], :2] - points[_BETWEEN_LIPS[0], :2]
    opening = float(np.linalg.norm(gap)) / eyes
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    cut = bool((low < 0).any() or high[0] >= width or high[1] >= height)
    return aside / 0.3 + tilt / 0.5 + opening / 0.1 + 10.0 * cut
