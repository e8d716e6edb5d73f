"""Head motion of a video, by the method that is asked for, run by run and block by block.

A run is a stretch of frames with a face in each. The pictures of a run are held a block at a
time, so that memory does not grow with the video.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.gradient_motion import FacePicture, GradientTracker
from analysis.motion import MotionSettings, estimate_poses
from analysis.reference import Reference
from analysis.surface_texture import face_picture
from database.errors import FaceError
from database.mask import Camera, Mask, Poses

SHORTEST_RUN: Final = 3
"""Frames: a face seen for less is a false alarm, and no pose can be smoothed over it."""

BLOCK: Final = 200
"""Frames whose pictures are held at a time."""


@dataclass(frozen=True)
class HeadMotion:
    """Where the head was in the n frames in which it could be followed.

    Parameters
    ----------
    numbers : (n,) int32
        Frame numbers, rising.
    landmarks : (n, 468, 2) float32
        Raw face mesh, pixels.
    poses : Poses of length n
    lost : (n,) bool
        Where image gradients did not find the face: the pose is the feature points'.
    """

    numbers: npt.NDArray[np.int32]
    landmarks: npt.NDArray[np.float32]
    poses: Poses
    lost: npt.NDArray[np.bool_]


class HeadFollower:
    """Takes the frames of a video in order and tells the head's motion at the end.

    Parameters
    ----------
    mask : Mask
    camera : Camera
        Of the video.
    settings : MotionSettings, optional
    known : mapping of int to (3, 4) float64, optional
        Poses that are known, by frame number.
    reference : Reference, optional
        Of the person; see `analysis.gradient_motion`.
    """

    def __init__(
        self,
        mask: Mask,
        camera: Camera,
        settings: MotionSettings | None = None,
        known: Mapping[int, npt.NDArray[np.float64]] | None = None,
        reference: Reference | None = None,
    ) -> None:
        self._settings = settings or MotionSettings()
        self._mask, self._camera, self._known = mask, camera, dict(known or {})
        self._tracker: GradientTracker | None = None
        if self._settings.method == "gradients":
            self._tracker = GradientTracker(mask, self._settings.gradients, reference)
        self._numbers: list[int] = []
        self._points: list[npt.NDArray[np.float32]] = []
        self._pictures: list[FacePicture] = []
        self._done: list[HeadMotion] = []

    def add(
        self,
        number: int,
        picture: npt.NDArray[np.uint8],
        landmarks: npt.NDArray[np.float32],
    ) -> None:
        """Take a frame that shows a face.

        Parameters
        ----------
        number : int
            Greater than the last one's.
        picture : (h, w, 3) uint8
            RGB.
        landmarks : (468, 2) float32
            Its face mesh, pixels.
        """
        if self._numbers and number != self._numbers[-1] + 1:
            self._end_block()
        self._numbers.append(number)
        self._points.append(np.array(landmarks, np.float32))
        if self._tracker is not None:
            self._pictures.append(face_picture(picture, landmarks, self._camera))
            if len(self._numbers) == BLOCK + SHORTEST_RUN:
                # Enough are left over for a run of their own.
                self._end_block(BLOCK)

    def finish(self) -> HeadMotion:
        """Motion in all frames that were taken and could be followed."""
        self._end_block()
        if not self._done:
            return _nothing()
        return HeadMotion(
            np.concatenate([m.numbers for m in self._done]),
            np.concatenate([m.landmarks for m in self._done]),
            Poses(
                np.concatenate([m.poses.rotations for m in self._done]),
                np.concatenate([m.poses.translations for m in self._done]),
            ),
            np.concatenate([m.lost for m in self._done]),
        )

    def _end_block(self, count: int | None = None) -> None:
        """Follow the first frames that wait (all, if not said), and forget them."""
        n = len(self._numbers) if count is None else count
        numbers, points, pictures = self._numbers[:n], self._points[:n], self._pictures[:n]
        self._numbers, self._points = self._numbers[n:], self._points[n:]
        self._pictures = self._pictures[n:]
        if n < SHORTEST_RUN:
            return
        landmarks = np.stack(points)
        try:
            poses, good = estimate_poses(landmarks, self._mask, self._camera, self._settings)
        except FaceError:
            return
        lost = np.zeros(n, bool)
        if self._tracker is not None:
            starts = np.stack([poses.matrix(i) for i in range(n)])
            known = {k: self._known[at] for k, at in enumerate(numbers) if at in self._known}
            followed = self._tracker.follow(pictures, starts, good, known)
            lost = followed.lost
            good = good | ~lost
            poses = _as_poses(followed.poses)
        self._done.append(
            HeadMotion(
                np.array(numbers, np.int32)[good],
                landmarks[good],
                Poses(poses.rotations[good], poses.translations[good]),
                lost[good],
            )
        )


def _as_poses(matrices: npt.NDArray[np.float64]) -> Poses:
    turns = [np.asarray(cv2.Rodrigues(m[:, :3])[0]).ravel() for m in matrices.copy()]
    return Poses(np.array(turns, np.float32), matrices[:, :, 3].astype(np.float32))


def _nothing() -> HeadMotion:
    none = np.zeros((0, 3), np.float32)
    return HeadMotion(
        np.zeros(0, np.int32),
        np.zeros((0, 468, 2), np.float32),
        Poses(none, none),
        np.zeros(0, bool),
    )
