"""The lips of all clips: a model trained on chosen frames, then fitted to every one.

It depends on all clips, since the frames are chosen among all, so it runs when they are analysed.
All of it gives the same for any number of jobs: clips are fitted one by one, and what is summed
by a library is summed on one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from analysis.aam_fit import LipFitSettings, LipFitter, fit_clip
from analysis.aam_points import (
    LEFT,
    RIGHT,
    Marks,
    contours_of_points,
    marks_in_crop,
    points_of_contours,
    read_marks,
)
from analysis.aam_training import (
    FEWEST,
    LipTrainingSettings,
    TrainedLips,
    choose_frames,
    train_lip_model,
)
from analysis.lips import LipGeometry, lip_geometry, measured
from analysis.shards import Shard, read_shard
from database.errors import CorpusError
from database.lip_model import LipModel
from database.mask import Camera, Mask, Poses
from database.pictures import decode

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

SOURCES: Final = ("mesh", "aam", "mesh-only")
"""What width, height and opening of a mouth are measured on: the face mesh's contours smoothed over
time, or a lip model's points. With either the model is kept, and so are its points, but with the
third. (On folds of GRID's `build`, 60 sentences, selection by the model's measures closed p, b
and m in 0.91 of the cases and by the mesh's in 0.95, like the recordings; heights on the raw mesh
correlated at 0.880 and 0.894. Smoothing the model's points in time changed neither.)"""

ENOUGH_MARKED: Final = 20
"""Frames marked by hand beside which none are taken from the face mesh."""


@dataclass(frozen=True)
class LipSettings:
    """How the lips of a corpus are found.

    Parameters
    ----------
    source : str
        One of `SOURCES`.
    marks : str, optional
        File of points marked by hand (`analysis.aam_points.read_marks`).
    farthest : float
        Greatest mean distance of a frame's points from where the face mesh has them, its usual
        error taken out, in parts of the mouth's width; beyond it the model is taken to be lost.
        (On GRID it is 0.013 in the median, and 0.05 in the worst of 3,600 frames.)
    training, fit
        Settings of the model and of its fit.
    """

    source: str = "mesh"
    marks: str | None = None
    farthest: float = 0.08
    training: LipTrainingSettings = field(default_factory=LipTrainingSettings)
    fit: LipFitSettings = field(default_factory=LipFitSettings)


@dataclass(frozen=True)
class FoundLips:
    """Lips of a clip's n frames, by a lip model.

    Parameters
    ----------
    points : (n, 20, 2) float32
        In the mask's frame, mm.
    found : (n,) uint8
        0 where the model was lost and the face mesh's points stand in, brought to the model's by
        what they usually differ by.
    geometry : LipGeometry
        Measured on the points.
    """

    points: F32
    found: npt.NDArray[np.uint8]
    geometry: LipGeometry


@dataclass(frozen=True)
class CorpusLips:
    """A lip model and the lips of every clip.

    Parameters
    ----------
    model : LipModel
    clips : tuple of FoundLips
    trained_on, marked : int
        Frames that the model was built on, and how many of them were marked by hand.
    """

    model: LipModel
    clips: tuple[FoundLips, ...]
    trained_on: int
    marked: int


def find_lips(
    fitter: LipFitter,
    crops: Iterable[npt.NDArray[np.uint8]],
    landmarks: npt.NDArray[np.floating],
    poses: Poses,
    mask: Mask,
    camera: Camera,
    numbers: npt.NDArray[np.integer],
    farthest: float = LipSettings.farthest,
) -> FoundLips:
    """Fit the lips of a clip; where the model is lost, the face mesh stands in.

    Parameters
    ----------
    fitter : LipFitter
    crops : iterable of (h, w, 3) uint8
    landmarks : (n, 468, 2) float
        Face mesh, pixels.
    poses : Poses of length n
    mask, camera
        What was filmed, and how.
    numbers : (n,) int
        Frame numbers, rising.
    farthest : float
        See `LipSettings`.
    """
    starts = _mesh_points(landmarks, poses, mask, camera, numbers, smoothing=1)
    fit = fit_clip(fitter, crops, starts, numbers)
    width = np.linalg.norm(starts[:, RIGHT] - starts[:, LEFT], axis=1)
    away = np.linalg.norm(fit.points - fitter.expected(starts), axis=2).mean(axis=1)
    found = fit.found & (away <= farthest * width)
    smooth = lip_geometry(landmarks, poses, mask, camera, numbers).contours
    instead = fitter.expected(points_of_contours(mask.patch.to_crop(smooth)))
    points = mask.patch.from_crop(np.where(found[:, None, None], fit.points, instead))
    return FoundLips(
        points.astype(np.float32), found.astype(np.uint8), measured(contours_of_points(points))
    )


def fit_corpus_lips(
    shards: Sequence[Shard],
    pca: Sequence[F32],
    *,
    mask: Mask,
    codec: str,
    settings: LipSettings,
    marks: Marks | None,
    jobs: int,
    tell: Callable[[str, int, int], None],
) -> CorpusLips | None:
    """Train a lip model on frames of all clips, and fit it to each.

    Parameters
    ----------
    shards : sequence of Shard
    pca : sequence of (n, K) float32
        PCA weights of each clip's frames.
    mask : Mask
    codec : str
        Of the shards' pictures.
    settings : LipSettings
    marks : Marks, optional
        Points marked by hand.
    jobs : int
        Clips fitted at a time.
    tell : callable
        Progress: stage, done, total.

    Returns
    -------
    CorpusLips or None
        None where no model is asked for, or there are too few frames for one.

    Raises
    ------
    CorpusError
        If none of the marked frames is of these clips and shows the face.
    """
    if settings.source == "mesh-only" or sum(len(p) for p in pca) < FEWEST:
        return None
    tell("training the lip model", 0, 1)
    with threadpool_limits(1):
        trained, marked = _train(shards, pca, mask, codec, settings, marks or {})
        fitter = LipFitter(trained.model, settings.fit)
    tell("training the lip model", 1, 1)
    tell("fitting lips", 0, len(shards))
    # Sent whole: large arrays in shared memory would outlive a build that is killed.
    run = Parallel(n_jobs=min(jobs, len(shards)), return_as="generator", max_nbytes=None)
    clips = []
    for found in run(
        delayed(_fit_shard)(fitter, shard, mask, codec, settings.farthest) for shard in shards
    ):
        clips.append(found)
        tell("fitting lips", len(clips), len(shards))
    return CorpusLips(trained.model, tuple(clips), len(trained.points), marked)


def _fit_shard(
    fitter: LipFitter, shard: Shard, mask: Mask, codec: str, farthest: float
) -> FoundLips:
    cv2.setNumThreads(1)
    opened = read_shard(shard.path)
    with threadpool_limits(1):
        return find_lips(
            fitter,
            (decode(data, codec) for data in opened.pictures()),
            opened["landmarks"],
            Poses(opened["rotation"], opened["translation"]),
            mask,
            _camera(opened["camera"]),
            opened["frame"],
            farthest,
        )


def _train(
    shards: Sequence[Shard],
    pca: Sequence[F32],
    mask: Mask,
    codec: str,
    settings: LipSettings,
    marks: Marks,
) -> tuple[TrainedLips, int]:
    """Build the model on marked frames, and on chosen ones of the face mesh to fill up."""
    ends = np.cumsum([len(p) for p in pca])
    total = int(ends[-1])
    chosen = set(choose_frames(np.concatenate(pca), min(settings.training.frames, total)))
    crops: list[npt.NDArray[np.uint8]] = []
    mesh: list[F64] = []
    hand: list[F64 | None] = []
    for shard, end, weights in zip(shards, ends, pca, strict=True):
        first = int(end) - len(weights)
        own = {number: points for (clip, number), points in marks.items() if clip == shard.name}
        mine = {k - first for k in chosen if first <= k < int(end)}
        if not own and not mine:
            continue
        opened = read_shard(shard.path)
        numbers = opened["frame"]
        poses = Poses(opened["rotation"], opened["translation"])
        camera = _camera(opened["camera"])
        set_by_hand = marks_in_crop(own, poses, numbers, mask, camera)
        points = _mesh_points(opened["landmarks"], poses, mask, camera, numbers, smoothing=1)
        for i, data in enumerate(opened.pictures()):
            if i in mine or i in set_by_hand:
                crops.append(decode(data, codec))
                mesh.append(points[i])
                hand.append(set_by_hand.get(i))
    marked = np.array([points is not None for points in hand])
    if marks and not marked.any():
        raise CorpusError(
            f"{settings.marks}: none of the marked frames shows the face; look at their numbers, "
            "which count from 0"
        )
    starts = np.stack(mesh)
    points = starts.copy()
    if marked.any():
        by_hand = np.stack([p for p in hand if p is not None])
        # A hand tells what the mesh errs by on this person, whose other frames then serve.
        points += (by_hand - starts[marked]).mean(axis=0)
        points[marked] = by_hand
        if marked.sum() >= ENOUGH_MARKED:
            crops = [
                crop for crop, own_points in zip(crops, hand, strict=True) if own_points is not None
            ]
            points, starts, marked = points[marked], starts[marked], marked[marked]
    trained = train_lip_model(crops, points, marked, starts, settings.training, settings.fit)
    return trained, int(marked.sum())


def _mesh_points(
    landmarks: npt.NDArray[np.floating],
    poses: Poses,
    mask: Mask,
    camera: Camera,
    numbers: npt.NDArray[np.integer],
    smoothing: int,
) -> F64:
    """The face mesh's 20 points in crop pixels, (n, 20, 2)."""
    lips = lip_geometry(landmarks, poses, mask, camera, numbers, smoothing)
    return points_of_contours(mask.patch.to_crop(lips.contours))


def _camera(numbers: npt.NDArray[np.float64]) -> Camera:
    focal, cx, cy, width, height = numbers.tolist()
    return Camera(focal, cx, cy, int(width), int(height))


def read_lip_marks(settings: LipSettings, clips: Sequence[str]) -> Marks | None:
    """Check the settings before the work begins, and read the points marked by hand.

    Parameters
    ----------
    settings : LipSettings
    clips : sequence of str
        Names of the corpus's clips.

    Raises
    ------
    CorpusError
        If lips cannot be measured on the source, or the file of marks cannot be read or marks
        none of the clips.
    """
    if settings.source not in SOURCES:
        raise CorpusError(
            f"lips are measured by one of {', '.join(SOURCES)}, not by {settings.source!r}"
        )
    if settings.marks is None:
        return None
    marks = read_marks(settings.marks)
    if not {clip for clip, _ in marks} & set(clips):
        raise CorpusError(
            f"{settings.marks}: marks no clip of this corpus; its first is "
            f"{next(iter(marks))[0]!r}, the corpus's {clips[0]!r}"
        )
    return marks
