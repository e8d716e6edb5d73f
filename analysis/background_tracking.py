"""A video or photo made ready to be a background: head followed, own mouth and light measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.clip import cut_crops, track_face
from analysis.face import FaceFinder
from analysis.head_motion import SHORTEST_RUN, HeadFollower
from analysis.lips import lip_geometry
from analysis.reference import Reference
from database.errors import FaceError
from database.mask import Camera, Mask, Poses, cut_crop
from database.media import probe
from database.photo import is_photo, read_photo

FloatArray = npt.NDArray[np.float32]

CHIN: Final = 152
"""Lowest mesh point of the chin."""

SKIN_SHARE: Final = 0.2
"""Upper part of the mouth's crop: cheeks and the lip's skin, where no lips come."""

SHORTEST_SECONDS: Final = 0.5
"""A face must be seen for so long on end; forth and back over less looks like a fault."""


@dataclass(frozen=True)
class TrackedBackground:
    """A background's n frames with a face.

    Parameters
    ----------
    path : Path
    still : bool
        Whether it is a photo; n is 1 then.
    fps : float
    numbers : (n,) int32
        Frame numbers.
    poses : Poses of length n
    opening, chin, light : (n,) float32
        Its own mouth and light; as in `database.stored_backgrounds.DESCRIBED`.
    """

    path: Path
    still: bool
    fps: float
    numbers: npt.NDArray[np.int32]
    poses: Poses
    opening: FloatArray
    chin: FloatArray
    light: FloatArray


def track_background(
    path: Path,
    mask: Mask,
    camera: Camera,
    finder: FaceFinder,
    reference: Reference | None = None,
    *,
    fps: float = 25.0,
) -> TrackedBackground:
    """Follow the head through a video, or find it in a photo.

    Parameters
    ----------
    path : Path
    mask : Mask
        Of the person.
    camera : Camera
        Of the database; scaled to this picture's size.
    finder : FaceFinder
    reference : Reference, optional
        Of the person.
    fps : float
        Rate that a photo is shown at.

    Raises
    ------
    MediaError
        If the file cannot be read.
    FaceError
        If it shows no face for long enough.
    """
    if is_photo(path):
        return _track_photo(path, mask, camera, finder, reference, fps)
    info = probe(path)
    face = track_face(path, mask, camera, finder, reference=reference)
    runs = np.split(face.numbers, np.flatnonzero(np.diff(face.numbers) != 1) + 1)
    longest = max(len(run) for run in runs)
    if longest < SHORTEST_SECONDS * info.fps:
        raise FaceError(
            f"{path}: shows a face in no more than {longest} frames on end, "
            f"{longest / info.fps:.2f} s; a background needs {SHORTEST_SECONDS:g} s, or give one "
            "picture (JPEG, PNG)"
        )
    lips = lip_geometry(face.landmarks, face.poses, mask, face.camera, face.numbers)
    light = [skin_light(crop) for crop in cut_crops(path, face, mask)]
    return TrackedBackground(
        path,
        False,
        info.fps,
        face.numbers,
        face.poses,
        lips.opening,
        chin_heights(face.landmarks, face.poses, mask, face.camera),
        np.array(light, np.float32),
    )


def chin_heights(
    landmarks: npt.NDArray[np.floating], poses: Poses, mask: Mask, camera: Camera
) -> FloatArray:
    """Where the chin's lowest point is, head motion taken out.

    Parameters
    ----------
    landmarks : (n, 468, 2) float
        Face mesh, pixels.
    poses : Poses of length n
    mask, camera
        The chin is taken to lie as deep as its mask vertex.

    Returns
    -------
    (n,) float32
        Height in the mask's frame, mm, downwards.
    """
    depth = float(mask.vertices[CHIN, 2])
    out = np.empty(len(landmarks), np.float32)
    for i, (x, y) in enumerate(landmarks[:, CHIN, :2]):
        pose = poses.matrix(i)
        ray = np.array([(x - camera.cx) / camera.focal, (y - camera.cy) / camera.focal, 1.0])
        ray, origin = pose[:, :3].T @ ray, pose[:, :3].T @ pose[:, 3]
        out[i] = ray[1] * (depth + origin[2]) / ray[2] - origin[1]
    return out


def skin_light(crop: npt.NDArray[np.uint8]) -> float:
    """Brightness of a mouth crop's upper part, where lips and jaw hardly come: log level."""
    rows = max(1, round(SKIN_SHARE * len(crop)))
    return float(np.log(crop[:rows].mean() + 1))


def _track_photo(
    path: Path,
    mask: Mask,
    camera: Camera,
    finder: FaceFinder,
    reference: Reference | None,
    fps: float,
) -> TrackedBackground:
    picture = read_photo(path)
    own_camera = camera.scaled_to(picture.shape[1], picture.shape[0])
    finder.reset()
    follower = HeadFollower(mask, own_camera, reference=reference)
    # A video of equal frames, as many as a run must have: the last ones are the surest.
    for number in range(SHORTEST_RUN):
        mesh = finder.find(picture)
        if mesh is not None:
            follower.add(number, picture, mesh.points[:, :2])
    motion = follower.finish()
    if not len(motion.numbers):
        raise FaceError(
            f"{path}: shows no face that the person's mask fits; give a photo of the person, "
            "looking at the camera, the whole head in it"
        )
    poses = Poses(motion.poses.rotations[-1:], motion.poses.translations[-1:])
    landmarks = motion.landmarks[-1:]
    lips = lip_geometry(landmarks, poses, mask, own_camera, [0])
    crop = cut_crop(picture, mask.patch, poses.matrix(0), own_camera)
    return TrackedBackground(
        path,
        True,
        fps,
        np.zeros(1, np.int32),
        poses,
        lips.opening,
        chin_heights(landmarks, poses, mask, own_camera),
        np.array([skin_light(crop)], np.float32),
    )
