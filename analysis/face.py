"""Faces in pictures: found by a detector, meshed by a network, followed from frame to frame.

Both networks run through OpenCV's DNN. The mesh is read off a square region around the face,
upright by the eyes; the region of the next frame comes from the mesh of this one, so that the
detector is asked only at the start and after the face was lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from analysis.models import FaceModels
from database.errors import ModelError
from database.mask import N_VERTICES, OUTER_EYE_CORNERS

Picture = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float32]

DETECTOR_SIZE = 128
MESH_SIZE = 192


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
        If OpenCV cannot load a model.
    """

    def __init__(self, models: FaceModels, settings: FaceSettings | None = None) -> None:
        self.settings = settings or FaceSettings()
        self._detector = _load(models.detector)
        self._mesh = _load(models.mesh)
        self._anchors = _anchors()
        self._previous: Points | None = None

    def reset(self) -> None:
        """Forget the last frame: the next one starts a new video."""
        self._previous = None

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
            region = self._detected(picture)
            if region is not None:
                found = self._meshed(picture, region)
                if found is not None:
                    # The detector's box is rough: once more around the mesh it led to.
                    again = _region_of_mesh(found.points, self.settings)
                    found = self._meshed(picture, again) or found
        if found is not None:
            found = self._looked_again(picture, found)
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

    def _detected(self, picture: Picture) -> _Region | None:
        height, width = picture.shape[:2]
        side = max(height, width)
        scale = DETECTOR_SIZE / side
        # Letter-boxed so that the face keeps its proportions.
        left, top = (side - width) / 2, (side - height) / 2
        to_input = np.array([[scale, 0, left * scale], [0, scale, top * scale]])
        flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        small = np.zeros((DETECTOR_SIZE, DETECTOR_SIZE, 3), np.uint8)
        w, h = max(1, round(width * scale)), max(1, round(height * scale))
        x, y = round(to_input[0, 2]), round(to_input[1, 2])
        x, y = min(x, DETECTOR_SIZE - w), min(y, DETECTOR_SIZE - h)
        small[y : y + h, x : x + w] = cv2.resize(picture, (w, h), interpolation=flags)
        blob = (small.astype(np.float32) / 127.5 - 1).transpose(2, 0, 1)[None]
        self._detector.setInput(blob)
        logits, boxes = self._detector.forward(["classificators", "regressors"])
        scores = 1 / (1 + np.exp(-np.clip(logits.reshape(-1), -50, 50)))
        best = scores >= self.settings.detection_score
        if not best.any():
            return None
        values = boxes.reshape(-1, 16)
        centres = values[:, :2] + self._anchors * DETECTOR_SIZE
        sizes = values[:, 2]
        # Of several faces the largest and surest; boxes of one face overlap, and are averaged.
        top_one = int(np.argmax(np.where(best, scores * sizes, -1)))
        near = np.linalg.norm(centres - centres[top_one], axis=1) < 0.3 * sizes[top_one]
        chosen = best & near
        weights = scores[chosen] / scores[chosen].sum()
        centre = weights @ centres[chosen]
        size = float(weights @ sizes[chosen])
        eyes = (
            values[chosen][:, 4:8].reshape(-1, 2, 2)
            + self._anchors[chosen][:, None] * DETECTOR_SIZE
        )
        right, left_eye = np.tensordot(weights, eyes, axes=1)
        angle = float(np.arctan2(left_eye[1] - right[1], left_eye[0] - right[0]))
        cx = (centre[0] - x) / w * width
        cy = (centre[1] - y) / h * height
        return _Region(
            float(cx), float(cy), size / DETECTOR_SIZE * side * self.settings.region_scale, angle
        )

    def _meshed(self, picture: Picture, region: _Region) -> FaceMesh | None:
        to_picture = region.to_picture()
        cut = cv2.warpAffine(
            picture,
            to_picture,
            (MESH_SIZE, MESH_SIZE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        blob = (cut.astype(np.float32) / 255).transpose(2, 0, 1)[None]
        self._mesh.setInput(blob)
        values, flag = self._mesh.forward(["conv2d_20", "conv2d_30"])
        if values.size < flag.size:
            values, flag = flag, values
        score = float(1 / (1 + np.exp(-np.clip(flag.reshape(-1)[0], -50, 50))))
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


def _anchors() -> npt.NDArray[np.float64]:
    """Anchor centres of the short-range detector, (896, 2), in parts of the input's side."""
    centres = []
    for cells, repeats in ((16, 2), (8, 6)):
        line = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(line, line, indexing="ij")
        centres.append(np.repeat(np.stack([x.ravel(), y.ravel()], axis=1), repeats, axis=0))
    return np.concatenate(centres)


def _load(path: object) -> Any:
    try:
        # The classic engine: OpenCV 5's new one loses every output but the last.
        return cv2.dnn.readNetFromTFLite(str(path), cv2.dnn.ENGINE_CLASSIC)
    except cv2.error as error:
        raise ModelError(f"{path}: OpenCV cannot load it ({error.err or error})") from error
