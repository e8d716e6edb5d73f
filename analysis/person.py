"""Who is filmed: the person's mask, from several good frames, and where it sits on the face."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.calibration import FEWEST_FRAMES
from analysis.calibration import estimate_focal as focal_of
from analysis.face import FaceFinder
from analysis.gradient_motion import FacePicture, GradientTracker
from analysis.hand_points import HandPoints, mask_through
from analysis.motion import CropSettings, MotionSettings, average_mask, estimate_poses
from analysis.reference import Reference
from analysis.rigid import Matrix
from analysis.surface_texture import face_picture
from database.errors import FaceError, UnitselError
from database.mask import OUTER_EYE_CORNERS, Camera, Mask
from database.media import read_video
from database.piece import Source

ENOUGH_VIDEOS: Final = 6
"""Videos with a face that are looked at."""

FRAMES_OF_VIDEO: Final = 4
"""Good frames that are taken from each."""

FRAMES_APART: Final = 4
"""Frames between two that are taken: neighbours err alike."""

LONGEST_LOOK: Final = 100
"""Frames of a video that are looked at once a good one has been found anywhere."""

_BETWEEN_LIPS: Final = (13, 14)
_NOSE_TIP: Final = 1


@dataclass(frozen=True)
class Person:
    """Who is filmed, and with what camera.

    Parameters
    ----------
    mask : Mask
    camera : Camera
        Of the first video with a face.
    reference : Reference or None
        What the person's rigid surface looks like; given to `analysis.clip.track_face`, it puts
        the mask on the same place of the face in all clips. None where gradients are not used.
    frames : int
        Good frames that the mask is the mean of.
    """

    mask: Mask
    camera: Camera
    reference: Reference | None
    frames: int


@dataclass(frozen=True)
class _Sight:
    """A frame that may serve."""

    fault: float
    points: npt.NDArray[np.float32]
    picture: FacePicture
    camera: Camera


def study_person(
    videos: Sequence[Source],
    finder: FaceFinder,
    *,
    focal: float | None = None,
    crop: CropSettings | None = None,
    camera: Camera | None = None,
    estimate_focal: bool = False,
    settings: MotionSettings | None = None,
    hand: HandPoints | None = None,
) -> Person:
    """Make the person's mask of good frames of the first videos: frontal, upright, lips together.

    Where no frame is good, the best one serves alone.

    Parameters
    ----------
    videos : sequence of path or Piece
    finder : FaceFinder
    focal : float, optional
        Focal length in pixels of the first video's pictures.
    crop : CropSettings, optional
    camera : Camera, optional
        Calibrated (`analysis.calibration.read_camera`); scaled to each video's size.
    estimate_focal : bool
        Estimate the focal length over the first videos (`analysis.calibration.estimate_focal`),
        where neither it nor a camera is given.
    settings : MotionSettings, optional
    hand : HandPoints, optional
        Six points marked in a frame of the first video: the mask is moved to pass through them,
        and sits on the face, in all clips, as they say.

    Raises
    ------
    FaceError
        If no video shows a face, or the marked frame does not.
    CorpusError
        If the points do not lie on a face.
    """
    if estimate_focal and focal is None and camera is None:
        camera = _estimated_camera(videos, finder)
    good: list[_Sight] = []
    best: _Sight | None = None
    seen = 0
    for video in videos:
        taken: list[_Sight] = []
        before, met = -FRAMES_APART, False
        finder.reset()
        try:
            for frame in read_video(video):
                if frame.index >= LONGEST_LOOK and (good or taken):
                    break
                mesh = finder.find(frame.rgb)
                if mesh is None:
                    continue
                height, width = frame.rgb.shape[:2]
                if camera is None:
                    camera = Camera.assumed(width, height, focal)
                if not met and not seen:
                    camera = camera.scaled_to(width, height)
                own = camera.scaled_to(width, height)
                met = True
                fault = _fault(mesh.points, width, height)
                usable = fault < 1 and frame.index - before >= FRAMES_APART
                if not usable and best is not None and fault >= best.fault:
                    continue
                picture = face_picture(frame.rgb, mesh.points, own)
                sight = _Sight(fault, mesh.points, picture, own)
                if usable:
                    taken.append(sight)
                    before = frame.index
                else:
                    best = sight
                if len(taken) == FRAMES_OF_VIDEO:
                    break
        except UnitselError:
            continue  # The build names unreadable clips when it comes to them.
        good += taken
        seen += met
        if seen >= ENOUGH_VIDEOS:
            break
    if not good and best is not None:
        good = [best]
    if not good or camera is None:
        others = f", nor do the other {len(videos) - 1} clips" if len(videos) > 1 else ""
        raise FaceError(
            f"{videos[0]}: shows no face{others}; film one face that looks into the camera"
        )
    mask = average_mask([s.points for s in good], [s.camera for s in good], crop)
    chosen = settings or MotionSettings()
    known: Matrix | None = None
    if hand is not None:
        marked = _marked(videos[0], hand, finder, camera)
        mask, known = mask_through(mask, hand, marked.camera)
        good = [marked, *good]
    reference = None
    if chosen.method == "gradients":
        reference = _reference(good, mask, chosen, {} if known is None else {0: known})
    return Person(mask, camera, reference, len(good))


def _estimated_camera(videos: Sequence[Source], finder: FaceFinder) -> Camera | None:
    """A camera whose focal length the first videos tell; None if they show too little."""
    meshes: list[npt.NDArray[np.float32]] = []
    size: tuple[int, int] | None = None
    seen = 0
    for video in videos:
        finder.reset()
        before = len(meshes)
        try:
            for frame in itertools.islice(read_video(video), LONGEST_LOOK):
                height, width = frame.rgb.shape[:2]
                mesh = finder.find(frame.rgb)
                if mesh is not None and size in (None, (width, height)):
                    size = (width, height)
                    meshes.append(mesh.points)
        except UnitselError:
            continue  # The build names unreadable clips when it comes to them.
        seen += len(meshes) > before
        if seen >= ENOUGH_VIDEOS:
            break
    if size is None or len(meshes) < FEWEST_FRAMES:
        return None
    return Camera.assumed(*size, focal_of(np.stack(meshes), *size).focal)


def _marked(video: Source, points: HandPoints, finder: FaceFinder, camera: Camera) -> _Sight:
    """The frame in which points were marked."""
    finder.reset()
    for frame in read_video(video):
        if frame.index < points.frame:
            continue
        mesh = finder.find(frame.rgb)
        if mesh is None:
            raise FaceError(f"{video}: frame {points.frame} shows no face; mark another frame")
        height, width = frame.rgb.shape[:2]
        own = camera.scaled_to(width, height)
        return _Sight(0.0, mesh.points, face_picture(frame.rgb, mesh.points, own), own)
    raise FaceError(f"{video}: has no frame {points.frame}; frames are counted from 0")


def _reference(
    sights: Sequence[_Sight], mask: Mask, settings: MotionSettings, known: Mapping[int, Matrix]
) -> Reference | None:
    """Texture of the person from the frames that the mask was made of."""
    starts = np.zeros((len(sights), 3, 4))
    trusted = np.zeros(len(sights), bool)
    for i, sight in enumerate(sights):
        try:
            poses, fits = estimate_poses(sight.points[None, :, :2], mask, sight.camera, settings)
        except FaceError:
            continue
        starts[i], trusted[i] = poses.matrix(0), fits[0]
    if not trusted.any():
        return None
    tracker = GradientTracker(mask, settings.gradients)
    tracker.follow([s.picture for s in sights], starts, trusted, known)
    return tracker.reference


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
