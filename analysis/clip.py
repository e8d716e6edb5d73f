"""One clip analysed: phones, face, poses, crops and lips of each of its frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.align import Aligner
from analysis.alignment import Alignment
from analysis.articulators import teeth_and_tongue
from analysis.corpus import Clip, align_clip
from analysis.face import FaceFinder
from analysis.head_motion import HeadFollower
from analysis.lips import LipGeometry, lip_geometry
from analysis.motion import MotionSettings
from analysis.reference import Reference
from analysis.texture import reduce_crop
from database.errors import FaceError, MediaError
from database.mask import Camera, Mask, Poses, cut_crop
from database.media import probe, read_video
from database.pictures import encode
from database.piece import Source
from database.sound import Sound, read_sound
from database.sound_features import BANDS, sound_features

MOST_KEPT: Final = 96_000_000
"""Bytes of pictures that are kept between the two passes over a video."""


MOST_LOST: Final = 0.2
"""Share of a clip's frames that are left out where the gradients lose the face; if it is more, the
gradients are at fault, and the feature points lead."""


@dataclass(frozen=True)
class TrackedFace:
    """A video in which the head has been followed.

    Parameters
    ----------
    frames : int
        Frames of the video, with or without a face.
    numbers : (n,) int32
        Frame numbers of the n frames in which the mask sits on a face.
    landmarks : (n, 468, 2) float32
        Raw face mesh, pixels.
    poses : Poses of length n
    camera : Camera
        The camera of this video.
    lost : (n,) bool
        Frames in which image gradients did not find the face, so that the pose is the feature
        points'; none where gradients were not asked.
    """

    frames: int
    numbers: npt.NDArray[np.int32]
    landmarks: npt.NDArray[np.float32]
    poses: Poses
    camera: Camera
    lost: npt.NDArray[np.bool_]

    def missing(self) -> list[int]:
        """Numbers of the frames without a face."""
        return sorted(set(range(self.frames)) - set(self.numbers.tolist()))

    def by_points(self) -> list[int]:
        """Numbers of the frames in which image gradients lost the face."""
        return [int(number) for number in self.numbers[self.lost]]


@dataclass(frozen=True)
class AnalysedClip:
    """Everything that a database keeps of a clip, but its PCA weights.

    Parameters
    ----------
    name : str
    media : Path
    sha256 : str
    fps : float
        Recorded frame rate.
    alignment : Alignment
    face : TrackedFace
    lips : LipGeometry
    teeth, tongue : (n,) float32
    reduced : (n, 42, 40, 3) uint8
        Crops at the size of `analysis.texture`.
    pictures : list of bytes
        Encoded crops; empty where no codec was asked for.
    sound : (steps, 26) float16
        `database.sound_features.sound_features`; no steps where the clip has no sound.
    start : float
        Seconds at which the clip begins in its media file.
    """

    name: str
    media: Path
    sha256: str
    fps: float
    alignment: Alignment
    face: TrackedFace
    lips: LipGeometry
    teeth: npt.NDArray[np.float32]
    tongue: npt.NDArray[np.float32]
    reduced: npt.NDArray[np.uint8]
    pictures: list[bytes]
    sound: npt.NDArray[np.float16]
    start: float = 0.0


class KeptFrames:
    """A video that is gone through twice: numbers and pictures of its frames.

    A short one is kept in memory meanwhile; a long one is read again, so that memory is bounded.

    Parameters
    ----------
    media : path or Piece
    fps : float, optional
        Rate to read the video at; its own by default.
    """

    def __init__(self, media: Source, fps: float | None = None) -> None:
        self._media, self._fps = media, fps
        self._kept: list[tuple[int, npt.NDArray[np.uint8]]] | None = None

    def __iter__(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        if self._kept is not None:
            yield from self._kept
            return
        kept: list[tuple[int, npt.NDArray[np.uint8]]] = []
        size = 0
        for frame in read_video(self._media, self._fps):
            size += frame.rgb.nbytes
            if size <= MOST_KEPT:
                kept.append((frame.index, frame.rgb))
            else:
                kept.clear()
            yield frame.index, frame.rgb
        if size <= MOST_KEPT:
            self._kept = kept


def track_face(
    media: Source,
    mask: Mask,
    camera: Camera,
    finder: FaceFinder,
    *,
    fps: float | None = None,
    frames: KeptFrames | None = None,
    settings: MotionSettings | None = None,
    known: Mapping[int, npt.NDArray[np.float64]] | None = None,
    reference: Reference | None = None,
) -> TrackedFace:
    """Follow the head through a video, one picture at a time.

    Parameters
    ----------
    media : path or Piece
    mask : Mask
        Of the person.
    camera : Camera
        Of the database; scaled to this video's size.
    finder : FaceFinder
    fps : float, optional
        Rate to read the video at; its own by default.
    frames : KeptFrames, optional
        The same video, if it is read once more elsewhere.
    settings : MotionSettings, optional
    known : mapping of int to (3, 4) float64, optional
        Frame numbers whose pose is known (`analysis.hand_points.pose_by_hand`): these, not the
        feature points, say where the mask sits on the face.
    reference : Reference, optional
        Of the person: says the same, alike for all clips.

    Raises
    ------
    MediaError
        If the video cannot be read.
    FaceError
        If it shows no face for long enough.
    """
    info = probe(media)
    own_camera = camera.scaled_to(info.width, info.height)
    finder.reset()
    follower = HeadFollower(mask, own_camera, settings, known, reference)
    count = 0
    for number, picture in frames or KeptFrames(media, fps):
        count = number + 1
        mesh = finder.find(picture)
        if mesh is not None:
            follower.add(number, picture, mesh.points[:, :2])
    motion = follower.finish()
    if not len(motion.numbers):
        raise FaceError(f"{media}: shows no face that can be followed, in {count} frames")
    kept = np.ones(len(motion.lost), bool)
    if 0 < motion.lost.mean() <= MOST_LOST:
        # What the mesh takes for a face there does not look like this one: a hand, a broken frame.
        kept = ~motion.lost
    return TrackedFace(
        count,
        motion.numbers[kept],
        motion.landmarks[kept],
        Poses(motion.poses.rotations[kept], motion.poses.translations[kept]),
        own_camera,
        motion.lost[kept],
    )


def cut_crops(
    media: Source,
    face: TrackedFace,
    mask: Mask,
    *,
    fps: float | None = None,
    frames: KeptFrames | None = None,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Cut the mouths out of a video that has been tracked, head motion taken out.

    A second pass: poses are anchored to the whole clip, so crops can only be cut once all are
    known.

    Yields
    ------
    (h, w, 3) uint8
        One for each of the face's frames, in order.

    Raises
    ------
    MediaError
        If the video cannot be read, or does not give the same frames again.
    """
    place = {int(number): k for k, number in enumerate(face.numbers)}
    cut = 0
    for number, picture in frames or KeptFrames(media, fps):
        k = place.get(number)
        if k is not None:
            yield cut_crop(picture, mask.patch, face.poses.matrix(k), face.camera)
            cut += 1
    if cut != len(place):
        raise MediaError(f"{media}: gave other frames when it was read again")


def analyse_clip(
    clip: Clip,
    mask: Mask,
    camera: Camera,
    finder: FaceFinder,
    aligner: Aligner,
    *,
    fps: float | None = None,
    codec: str | None = None,
    settings: MotionSettings | None = None,
    reference: Reference | None = None,
) -> AnalysedClip:
    """Analyse a clip.

    Parameters
    ----------
    clip : Clip
    mask, camera
        Of the person, of the database.
    finder, aligner
        Reused from clip to clip.
    fps : float, optional
        Rate of the database; by default the clip's own.
    codec : str, optional
        Encode the crops with this codec; without it they are only described.
    settings : MotionSettings, optional
    reference : Reference, optional
        Of the person (`analysis.person.Person`).

    Raises
    ------
    UnitselError
        Of the kind that says what is wrong with the clip.
    """
    cv2.setNumThreads(1)  # Clips are analysed side by side; threads inside would fight.
    source = clip.source
    info = probe(source)
    sound = read_sound(source) if info.has_sound else None
    alignment = align_clip(clip, sound, info.duration, aligner)
    frames = KeptFrames(source, fps)
    face = track_face(
        source,
        mask,
        camera,
        finder,
        fps=fps,
        frames=frames,
        settings=settings,
        reference=reference,
    )
    lips = lip_geometry(face.landmarks, face.poses, mask, face.camera, face.numbers)
    seen: list[tuple[float, float]] = []
    reduced: list[npt.NDArray[np.uint8]] = []
    pictures: list[bytes] = []
    for i, crop in enumerate(cut_crops(source, face, mask, fps=fps, frames=frames)):
        seen.append(teeth_and_tongue(crop, lips.contours[i], float(lips.opening[i]), mask.patch))
        reduced.append(reduce_crop(crop))
        if codec is not None:
            pictures.append(encode(crop, codec))
    return AnalysedClip(
        clip.name,
        clip.media,
        sha256_of(clip.media),
        info.fps,
        alignment,
        face,
        lips,
        np.array([teeth for teeth, _ in seen], np.float32),
        np.array([tongue for _, tongue in seen], np.float32),
        np.stack(reduced),
        pictures,
        _features_of(sound),
        clip.start,
    )


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal; kept while the file stays as it is."""
    stat = path.stat()
    return _sha256_of(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=64)
def _sha256_of(path: Path, size: int, changed: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _features_of(sound: Sound | None) -> npt.NDArray[np.float16]:
    if sound is None:
        return np.zeros((0, BANDS), dtype=np.float16)
    return sound_features(sound).astype(np.float16)
