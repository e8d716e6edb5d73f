"""Six points marked by hand (four eye corners, two nostrils), which rule where the mask sits.

They stand in a JSON file with the clip and the frame in which they were marked, pixel centres at
integers, left and right those of the picture::

    {"clip": "bbaf2n", "frame": 0, "points": {
     "left eye, outer": [113.5, 160.2], "left eye, inner": [132.0, 161.1],
     "right eye, inner": [158.3, 161.0], "right eye, outer": [178.9, 160.4],
     "left nostril": [139.2, 193.5], "right nostril": [153.0, 193.8]}}
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.rigid import Matrix, direction
from database.errors import CorpusError
from database.mask import Camera, Mask, project

MESH_POINTS: Final[dict[str, tuple[int, ...]]] = {
    "left eye, outer": (33,),
    "left eye, inner": (133,),
    "right eye, inner": (362,),
    "right eye, outer": (263,),
    "left nostril": (60, 75),
    "right nostril": (290, 305),
}
"""Names of the six points, and the mesh points whose mean each is."""

LARGEST_MISFIT: Final = 0.15
"""Greatest distance of a point from the mask at its best pose, in parts of the distance between
the outer eye corners, beyond which they are not this person's."""

REACH: Final = 20.0
"""mm over which a point's correction fades out on the mask."""


@dataclass(frozen=True)
class HandPoints:
    """Six points of one frame.

    Parameters
    ----------
    clip : str
        Name of the clip.
    frame : int
        Counted from 0.
    points : six pairs of float
        Pixels, in the order of `MESH_POINTS`.
    source : str
        Name of the file they come from, for messages.
    """

    clip: str
    frame: int
    points: tuple[tuple[float, float], ...]
    source: str = "points marked by hand"

    @property
    def array(self) -> npt.NDArray[np.float64]:
        """The points, (6, 2) float64."""
        return np.array(self.points, dtype=np.float64)


def read_hand_points(path: str | Path) -> HandPoints:
    """Read a file of six points.

    Raises
    ------
    CorpusError
        If it cannot be read or is not such a file.
    """
    file = Path(path)
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise CorpusError(f"{file}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise CorpusError(f"{file}: is no JSON ({error}); see the form in the README") from error
    if not isinstance(found, dict) or not isinstance(found.get("points"), dict):
        raise CorpusError(f'{file}: must hold {{"clip": ..., "frame": ..., "points": {{...}}}}')
    clip = found.get("clip")
    if not isinstance(clip, str) or not clip:
        raise CorpusError(f"{file}: clip must be the name of a clip of the corpus, not {clip!r}")
    frame = found.get("frame", 0)
    if not isinstance(frame, int) or isinstance(frame, bool) or frame < 0:
        raise CorpusError(f"{file}: frame must be a whole number from 0, not {frame!r}")
    rows = []
    for name in MESH_POINTS:
        value = found["points"].get(name)
        numbers = isinstance(value, list) and len(value) == 2
        if not numbers or not all(isinstance(v, int | float) and np.isfinite(v) for v in value):
            raise CorpusError(f'{file}: point "{name}" must be two numbers [x, y], not {value!r}')
        rows.append((float(value[0]), float(value[1])))
    extra = sorted(set(found["points"]) - set(MESH_POINTS))
    if extra:
        raise CorpusError(f'{file}: does not know the point "{extra[0]}"; see the README')
    return HandPoints(clip, frame, tuple(rows), file.name)


def pose_by_hand(hand: HandPoints, mask: Mask, camera: Camera) -> Matrix:
    """The pose at which the mask's eye corners and nostrils fall on the points, (3, 4).

    Raises
    ------
    CorpusError
        If there is none.
    """
    model = _on_mask(mask)
    points = hand.array
    eyes = float(np.linalg.norm(points[3] - points[0]))
    try:
        _, r, t = cv2.solvePnP(model, points, camera.matrix, None, flags=cv2.SOLVEPNP_SQPNP)
        r, t = cv2.solvePnPRefineLM(model, points, camera.matrix, None, r, t)
    except cv2.error:
        r, t = np.full(3, np.nan), np.full(3, np.nan)  # All on one place, say.
    turn = np.asarray(cv2.Rodrigues(np.asarray(r))[0], dtype=np.float64)
    pose = np.ascontiguousarray(np.column_stack([turn, np.asarray(t).ravel()]))
    off = np.linalg.norm(project(model, pose, camera) - points, axis=1)
    # The mask must also be seen from its front, which is towards -z.
    fits = pose[2, 3] > 0 and direction(pose)[2] < -0.5
    if not fits or not off.max() <= LARGEST_MISFIT * eyes:
        raise CorpusError(
            f"{hand.source}: the points do not lie on a face like this mask's; "
            "left and right are those of the picture"
        )
    return pose


def mask_through(mask: Mask, hand: HandPoints, camera: Camera) -> tuple[Mask, Matrix]:
    """The mask moved smoothly so that it passes through the points, and its pose there.

    Raises
    ------
    CorpusError
        If the points do not lie on a face.
    """
    vertices = mask.vertices.astype(np.float64)
    pose = pose_by_hand(hand, mask, camera)
    for _ in range(3):
        now = replace(mask, vertices=vertices.astype(np.float32))
        model = _on_mask(now)
        depth = model @ pose[2, :3] + pose[2, 3]
        rays = (hand.array - [camera.cx, camera.cy]) * depth[:, None] / camera.focal
        space = np.column_stack([rays, depth])
        wanted = (space - pose[:, 3]) @ pose[:, :3]
        # Gaussians that together give each point its correction.
        kernel = _near(model, model)
        weights = np.linalg.solve(kernel + 1e-3 * np.eye(len(model)), wanted - model)
        vertices = vertices + _near(vertices, model) @ weights
        pose = pose_by_hand(hand, replace(mask, vertices=vertices.astype(np.float32)), camera)
    return replace(mask, vertices=vertices.astype(np.float32)), pose


def _on_mask(mask: Mask) -> npt.NDArray[np.float64]:
    """The six points on the mask, (6, 3)."""
    rows = [
        mask.vertices[list(ids)].astype(np.float64).mean(axis=0) for ids in MESH_POINTS.values()
    ]
    return np.stack(rows)


def _near(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-square / (2 * REACH**2)))
