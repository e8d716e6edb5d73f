"""Faces in pictures: found by a detector, meshed by a network, followed from frame to frame.

The mesh is read off a square region around the face, upright by the eyes; the region of the next
frame comes from the mesh of this one, so that the detector is asked only at the start and after the
face was lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.detector import FaceBox, FaceDetector, people
from analysis.faces import Company
from analysis.models import FaceModels
from analysis.network import Network
from database.mask import N_VERTICES, OUTER_EYE_CORNERS

Picture = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float32]

MESH_SIZE = 192

AROUND: Final = 4.0
"""Side of the part in which a lost face is looked for first, in parts of its size."""

LOOK_ROUND: Final = 12
"""Frames of following after which it is looked again who else is there."""

LONGEST_PAUSE: Final = 15
"""Frames without a search of the picture's parts after several that found nothing."""


@dataclass(frozen=True)
class FaceSettings:
    """Thresholds of finding and following.

    Parameters
    ----------
    detection_score, mesh_score : float
        Least probability of a face for a detection and for a mesh to count.
    region_scale : float
        Side of the meshed region in relation to the detector's box or the mesh's extent.
    smallest : float
        Least width of a face in pixels between the outer eye corners.
    face : str
        Which face, where there are several; see `analysis.faces.choose`.
    looks : sequence of (scale, radians)
        The mesh is read off the region and again off slightly larger or smaller, turned ones,
        and averaged: the network's errors differ from one to the next, the face does not. (On
        GRID two more looks raise the agreement of mouth heights with an estimate from pixels
        alone from 0.96 to 0.97 and take a fifth off the jitter at rest.)
    """

    detection_score: float = 0.5
    mesh_score: float = 0.5
    region_scale: float = 1.5
    smallest: float = 12.0
    face: str = "main"
    looks: tuple[tuple[float, float], ...] = ((0.93, -0.06), (1.07, 0.06))


@dataclass(frozen=True)
class FaceMesh:
    """A face in a picture.

    Parameters
    ----------
    points : (468, 3) float32
        Pixels; z in the scale of x and y, smaller is nearer.
    score : float
        Probability that this is a face.
    """

    points: Points
    score: float


@dataclass(frozen=True)
class _Region:
    """A square in the picture: centre, side in pixels, turn in radians."""

    x: float
    y: float
    side: float
    angle: float

    def to_picture(self) -> npt.NDArray[np.float64]:
        """Map from mesh-input pixels into the picture, (2, 3)."""
        s = self.side / MESH_SIZE
        c, n = s * np.cos(self.angle), s * np.sin(self.angle)
        half = (MESH_SIZE - 1) / 2
        return np.array(
            [
                [c, -n, self.x - half * (c - n)],
                [n, c, self.y - half * (n + c)],
            ]
        )


class FaceFinder:
    """Finds the face in a picture and follows it through a video.

    Parameters
    ----------
    models : FaceModels
    settings : FaceSettings, optional

    Raises
    ------
    ModelError
        If a model cannot be loaded.
    """

    def __init__(self, models: FaceModels, settings: FaceSettings | None = None) -> None:
        self.settings = settings or FaceSettings()
        self._detector = FaceDetector(models.detector, self.settings.detection_score)
        self._mesh = Network(models.mesh, ["conv2d_20", "conv2d_30"])
        self.reset()

    def reset(self) -> None:
        """Forget the last frame and who was seen: the next frame starts a new video."""
        self._previous: Points | None = None
        self._company = Company(self.settings.face)
        self._followed = self._pause = self._wait = 0

    def find(self, picture: Picture) -> FaceMesh | None:
        """The face of the next frame, or None.

        Parameters
        ----------
        picture : (h, w, 3) uint8
            RGB.
        """
        found = None
        if self._previous is not None:
            found = self._meshed(picture, _region_of_mesh(self._previous, self.settings))
        if found is None:
            found = self._searched(picture)
        elif self._followed % LOOK_ROUND == 0:
            self._company.look_round(self._detector.faces(picture))
        if found is not None:
            found = self._looked_again(picture, found)
            x, y = found.points[:, :2].mean(axis=0)
            self._company.follow(float(x), float(y))
        self._followed = 0 if found is None else self._followed + 1
        self._previous = None if found is None else found.points
        return found

    def _looked_again(self, picture: Picture, found: FaceMesh) -> FaceMesh:
        region = _region_of_mesh(found.points, self.settings)
        meshes = [found.points]
        for scale, turn in self.settings.looks:
            other = _Region(region.x, region.y, region.side * scale, region.angle + turn)
            mesh = self._meshed(picture, other)
            if mesh is not None:
                meshes.append(mesh.points)
        return FaceMesh(np.mean(meshes, axis=0, dtype=np.float32), found.score)

    def _searched(self, picture: Picture) -> FaceMesh | None:
        """The wanted face without a hint from the last frame."""
        height, width = picture.shape[:2]
        seen: list[FaceBox] = []
        for faces in self._sightings(picture):
            left = list(faces)
            seen += faces
            while (chosen := self._company.pick(left, width, height)) is not None:
                side = chosen.size * self.settings.region_scale
                found = self._meshed(picture, _Region(chosen.x, chosen.y, side, chosen.angle))
                if found is not None:
                    self._company.settle(chosen, seen)
                    self._pause = self._wait = 0
                    # The detector's box is rough: once more around the mesh it led to.
                    again = _region_of_mesh(found.points, self.settings)
                    return self._meshed(picture, again) or found
                left.remove(chosen)
                seen.remove(chosen)
        return None

    def _sightings(self, picture: Picture) -> Iterator[list[FaceBox]]:
        """Faces of the picture, then of ever smaller parts of it."""
        last = self._company.wanted
        whole = self._detector.faces(picture)
        counts = last is None and self._company.counts
        if not counts:
            yield whole
        if last is not None:
            side = round(AROUND * last.size)
            corner = round(last.x - side / 2), round(last.y - side / 2)
            yield self._detector.faces_in(picture, *corner, side)
        if self._pause > 0:
            self._pause -= 1
            return
        # A picture without the face costs dozens of looks, so the next ones are spared them.
        self._wait = min(2 * self._wait + 1, LONGEST_PAUSE)
        self._pause = self._wait
        small = self._detector.small_faces(picture)
        yield people(whole + small) if counts else small

    def _meshed(self, picture: Picture, region: _Region) -> FaceMesh | None:
        to_picture = region.to_picture()
        cut = cv2.warpAffine(
            picture,
            to_picture,
            (MESH_SIZE, MESH_SIZE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        values, flag = self._mesh.run(cut.astype(np.float32) * np.float32(1 / 255))
        score = float(1 / (1 + np.exp(-np.clip(flag[0], -50, 50))))
        points = values.reshape(N_VERTICES, 3).astype(np.float64)
        out = np.empty_like(points)
        # The network counts pixel edges from zero, we pixel centres.
        out[:, :2] = (points[:, :2] - 0.5) @ to_picture[:, :2].T + to_picture[:, 2]
        out[:, 2] = points[:, 2] * region.side / MESH_SIZE
        eyes = np.linalg.norm(out[OUTER_EYE_CORNERS[1], :2] - out[OUTER_EYE_CORNERS[0], :2])
        if score < self.settings.mesh_score or eyes < self.settings.smallest:
            return None
        return FaceMesh(out.astype(np.float32), score)


def _region_of_mesh(points: Points, settings: FaceSettings) -> _Region:
    eyes = points[OUTER_EYE_CORNERS[1], :2] - points[OUTER_EYE_CORNERS[0], :2]
    angle = float(np.arctan2(eyes[1], eyes[0]))
    c, s = np.cos(-angle), np.sin(-angle)
    turned = points[:, :2] @ np.array([[c, -s], [s, c]]).T
    low, high = turned.min(axis=0), turned.max(axis=0)
    centre = np.array([[c, s], [-s, c]]) @ ((low + high) / 2)
    side = float((high - low).max()) * settings.region_scale
    return _Region(float(centre[0]), float(centre[1]), side, angle)
