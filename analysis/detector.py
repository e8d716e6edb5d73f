"""Faces in a picture, as squares: the detector over the whole picture, then over parts of it.

The detector sees a picture of 128 x 128 pixels, so a face that is less than about a tenth of
the picture's width is lost on it. Where that matters, it is asked again about overlapping parts
of a half and a quarter of the picture's longer side.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.network import Network

Picture = npt.NDArray[np.uint8]

DETECTOR_SIZE: Final = 128

TILES: Final = (2, 4)
"""Sides of the parts searched in turn: the picture's longer side divided by these."""

TILE_SCORE: Final = 0.7
"""Least probability of a face in a part: a picture has many parts, and each may err."""

SAME_FACE: Final = 0.3
"""Boxes nearer to each other than this, in parts of their size, are of one face."""


@dataclass(frozen=True)
class FaceBox:
    """A face as the detector sees it.

    Parameters
    ----------
    x, y : float
        Middle, pixels.
    size : float
        Side of the square around eyes and mouth, pixels.
    angle : float
        Turn of the line between the eyes, radians.
    score : float
        Probability that this is a face.
    """

    x: float
    y: float
    size: float
    angle: float
    score: float

    def distance(self, x: float, y: float) -> float:
        """How far a place is from the middle, in parts of the size."""
        return float(np.hypot(self.x - x, self.y - y)) / self.size


class FaceDetector:
    """Finds the faces in a picture.

    Parameters
    ----------
    model : path
        Short-range face detector.
    score : float
        Least probability.

    Raises
    ------
    ModelError
        If the model cannot be loaded.
    """

    def __init__(self, model: object, score: float) -> None:
        self._network = Network(model, ["classificators", "regressors"])
        self._anchors = _anchors()
        self._score = score

    def faces(self, picture: Picture) -> list[FaceBox]:
        """Faces of the whole picture, the largest and surest first.

        Parameters
        ----------
        picture : (h, w, 3) uint8
            RGB.
        """
        return self._found(picture, self._score)

    def small_faces(self, picture: Picture) -> list[FaceBox]:
        """Faces of the picture's parts: of the largest parts that show any."""
        height, width = picture.shape[:2]
        for parts in TILES:
            side = max(height, width) // parts
            if side < DETECTOR_SIZE // 2:
                break
            found: list[FaceBox] = []
            for left, top in _tiles(width, height, side):
                found += self.faces_in(picture, left, top, side)
            if found:
                return _one_each(found)
        return []

    def faces_in(self, picture: Picture, left: int, top: int, side: int) -> list[FaceBox]:
        """Faces of one square part of the picture; it may reach beyond the picture's edges."""
        x, y = max(0, left), max(0, top)
        part = picture[y : max(y, top + side), x : max(x, left + side)]
        if min(part.shape[:2]) < 2:
            return []
        return [
            FaceBox(f.x + x, f.y + y, f.size, f.angle, f.score)
            for f in self._found(part, max(self._score, TILE_SCORE))
        ]

    def _found(self, picture: Picture, score: float) -> list[FaceBox]:
        height, width = picture.shape[:2]
        side = max(height, width)
        scale = DETECTOR_SIZE / side
        # Letter-boxed so that the face keeps its proportions.
        left, top = (side - width) / 2, (side - height) / 2
        flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        small = np.zeros((DETECTOR_SIZE, DETECTOR_SIZE, 3), np.uint8)
        w, h = max(1, round(width * scale)), max(1, round(height * scale))
        x, y = (
            min(round(left * scale), DETECTOR_SIZE - w),
            min(round(top * scale), DETECTOR_SIZE - h),
        )
        small[y : y + h, x : x + w] = cv2.resize(picture, (w, h), interpolation=flags)
        logits, boxes = self._network.run(small.astype(np.float32) / 127.5 - 1)
        scores = 1 / (1 + np.exp(-np.clip(logits, -50, 50)))
        left_over = scores >= score
        values = boxes.reshape(-1, 16)
        centres = values[:, :2] + self._anchors * DETECTOR_SIZE
        sizes = values[:, 2]
        faces = []
        while left_over.any():
            # The largest and surest first; boxes of one face overlap, and are averaged.
            top_one = int(np.argmax(np.where(left_over, scores * sizes, -1)))
            near = np.linalg.norm(centres - centres[top_one], axis=1) < SAME_FACE * sizes[top_one]
            chosen = left_over & near
            chosen[top_one] = True
            weights = scores[chosen] / scores[chosen].sum()
            centre = weights @ centres[chosen]
            size = float(weights @ sizes[chosen])
            eyes = (
                values[chosen][:, 4:8].reshape(-1, 2, 2)
                + self._anchors[chosen][:, None] * DETECTOR_SIZE
            )
            right, left_eye = np.tensordot(weights, eyes, axes=1)
            angle = float(np.arctan2(left_eye[1] - right[1], left_eye[0] - right[0]))
            cx = float((centre[0] - x) / w * width)
            cy = float((centre[1] - y) / h * height)
            if size > 0:
                faces.append(
                    FaceBox(cx, cy, size / DETECTOR_SIZE * side, angle, float(scores[chosen].max()))
                )
            left_over &= ~chosen
        return _one_each(faces)


def people(faces: list[FaceBox]) -> list[FaceBox]:
    """Faces of those who matter, each once: at least a third as large as the largest."""
    found = _one_each(faces)
    largest = max((f.size for f in found), default=0.0)
    return [f for f in found if f.size >= largest / 3]


def _one_each(faces: list[FaceBox]) -> list[FaceBox]:
    """Faces without those that overlap a larger or surer one."""
    kept: list[FaceBox] = []
    for face in sorted(faces, key=lambda f: -f.score * f.size):
        if all(k.distance(face.x, face.y) > 0.5 for k in kept):
            kept.append(face)
    return kept


def _tiles(width: int, height: int, side: int) -> Iterator[tuple[int, int]]:
    """Corners of squares of a side that cover a picture, each overlapping the next by half."""

    def places(length: int) -> list[int]:
        if length <= side:
            return [0]
        steps = -(-2 * (length - side) // side)
        return [round(i * (length - side) / steps) for i in range(steps + 1)]

    for top in places(height):
        for left in places(width):
            yield left, top


def _anchors() -> npt.NDArray[np.float64]:
    """Anchor centres of the short-range detector, (896, 2), in parts of the input's side."""
    centres = []
    for cells, repeats in ((16, 2), (8, 6)):
        line = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(line, line, indexing="ij")
        centres.append(np.repeat(np.stack([x.ravel(), y.ravel()], axis=1), repeats, axis=0))
    return np.concatenate(centres)
