"""The person's mask, and the head's pose in every frame by feature points.

The mask is the mean face mesh of several good frames, made metric by the distance of the outer
eye corners. A pose is the one at which the mask's rigid points (forehead, brows' bones, nose, eye
corners: what speech does not move) fall on the landmarks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.smoothing import smoothed
from database.errors import CorpusError, FaceError
from database.mask import (
    OUTER_EYE_CORNERS,
    Camera,
    Mask,
    MouthPatch,
    Poses,
    project,
)
from database.mask_surface import surface_depth

EYE_CORNER_DISTANCE: Final = 88.9
"""mm between the outer eye corners: the adult mean, which makes the mesh metric."""

MOUTH_CORNERS: Final = (61, 291)
FOREHEAD_TOP: Final = 10
CHIN: Final = 152

SYMMETRIC_PAIRS: Final = ((33, 263), (133, 362), (234, 454), (61, 291), (98, 327), (127, 356))
"""Points that mirror each other: they tell the direction across the face."""

RIGID: Final = (
    *(10, 109, 338, 67, 297, 103, 332, 54, 284, 151, 108, 337, 69, 299, 9, 8, 168),
    *(6, 197, 195, 5, 4, 1, 122, 351, 188, 412, 174, 399, 196, 419, 236, 456),
    *(33, 133, 263, 362, 246, 466, 130, 359, 112, 341, 243, 463, 193, 417, 245, 465),
    *(21, 251, 162, 389, 127, 356, 34, 264, 139, 368, 98, 327, 2, 94, 19),
)
"""Mesh points that speech leaves in place."""

AVERAGING_ROUNDS: Final = 3
"""How often meshes are laid on their mean, and the mean taken anew."""

CROP_WIDTH, CROP_HEIGHT = 288, 304
"""Pixels of a crop from footage that carries them (paper, section 7.1)."""


METHODS: Final = ("gradients", "points")
"""Ways of finding poses."""


@dataclass(frozen=True)
class GradientSettings:
    """How head motion is found from image gradients (analysis/gradient_motion.py).

    Parameters
    ----------
    spacing : float
        Pixels between points of the surface.
    least_spacing : float
        mm between points of the surface, at least: no more points than help.
    blur : float
        Pixels (standard deviation) by which pictures are blurred.
    steps : int
        Most Gauss-Newton steps at each level of the pyramid.
    enough : float
        Pixels; smaller steps end the search.
    passes : int
        How often all frames are aligned with the texture of all.
    key_angle : float
        Degrees from the nearest key view at which a frame becomes a key.
    learnt_from : int
        Frames at most that a key's texture is learnt from, spread over those near it.
    least_likeness : float
        Correlation of frame and texture below which the face is lost.
    least_kept : float
        Share of the surface that must look like the texture, else the face is lost.
    largest_dissent : float
        Distance from the feature points' pose at which the face is lost, in parts of the distance
        between the outer eye corners.
    """

    spacing: float = 1.3
    least_spacing: float = 1.8
    blur: float = 0.3
    steps: int = 10
    enough: float = 0.03
    passes: int = 1
    key_angle: float = 20.0
    learnt_from: int = 50
    least_likeness: float = 0.85
    least_kept: float = 0.5
    largest_dissent: float = 0.1


@dataclass(frozen=True)
class MotionSettings:
    """How poses are found.

    Parameters
    ----------
    method : str
        "gradients", from the mask's texture (analysis/gradient_motion.py), which starts from and
        is checked by feature points; or "points", from feature points alone.
    smoothing : int
        Landmarks are smoothed over this many frames (odd; 1 for none) before a pose is fitted;
        the network's points jitter more than heads do.
    largest_error : float
        Greatest median distance of rigid points from their landmarks for a pose to count, in
        parts of the distance between the outer eye corners.
    gradients : GradientSettings
    """

    method: str = "gradients"
    smoothing: int = 7
    largest_error: float = 0.12
    gradients: GradientSettings = field(default_factory=GradientSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise CorpusError(
                f"motion method {self.method!r} is not known; use {' or '.join(METHODS)}"
            )


@dataclass(frozen=True)
class CropSettings:
    """What part of the mask a crop shows.

    Parameters
    ----------
    width_in_mouths : float
        Width of the crop in widths of the resting mouth.
    shift : float
        How far the crop's middle lies below the mouth's, in widths of the resting mouth: room
        for the chin of an open mouth.
    largest : int
        Greatest width of a crop in pixels; footage that carries less gets less.
    """

    width_in_mouths: float = 2.0
    shift: float = 0.15
    largest: int = CROP_WIDTH


def make_mask(
    mesh: npt.NDArray[np.floating], camera: Camera, settings: CropSettings | None = None
) -> Mask:
    """The person's mask from the face mesh of one frame.

    Parameters
    ----------
    mesh : (468, 3) float
        Pixels, as `analysis.face` gives it: face near frontal, mouth at rest.
    camera : Camera
    settings : CropSettings, optional

    Returns
    -------
    Mask
        Metric; the scale is set by the distance between the outer eye corners.
    """
    return average_mask([mesh], [camera], settings)


def average_mask(
    meshes: Sequence[npt.NDArray[np.floating]],
    cameras: Sequence[Camera],
    settings: CropSettings | None = None,
) -> Mask:
    """The person's mask from the face meshes of several frames: what most of them agree on.

    Parameters
    ----------
    meshes : sequence of (468, 3) float
        Pixels, each as `make_mask` wants it.
    cameras : sequence of Camera
        That filmed each.
    settings : CropSettings, optional

    Returns
    -------
    Mask
        Metric; the scale is set by the distance between the outer eye corners.
    """
    upright, scales = zip(
        *(_upright(m, c) for m, c in zip(meshes, cameras, strict=True)), strict=True
    )
    shapes = np.stack(upright)
    middle = shapes[0]
    for _ in range(AVERAGING_ROUNDS):
        middle = np.median([_laid_on(shape, middle) for shape in shapes], axis=0)
        middle = (middle - middle[list(RIGID)].mean(axis=0)) @ _face_axes(middle).T
        left, right = middle[list(OUTER_EYE_CORNERS)]
        middle *= EYE_CORNER_DISTANCE / np.linalg.norm(right - left)
    vertices = middle.astype(np.float32)
    return Mask(
        vertices, _mouth_patch(vertices, float(np.median(scales)), settings or CropSettings())
    )


def _upright(
    mesh: npt.NDArray[np.floating], camera: Camera
) -> tuple[npt.NDArray[np.float64], float]:
    """One frame's mesh in millimetres and in the face's own axes; millimetres a pixel."""
    points = np.asarray(mesh, dtype=np.float64)
    eyes = float(np.linalg.norm(points[OUTER_EYE_CORNERS[0]] - points[OUTER_EYE_CORNERS[1]]))
    mm_per_pixel = EYE_CORNER_DISTANCE / eyes
    distance = camera.focal * mm_per_pixel
    z = distance + points[:, 2] * mm_per_pixel
    xy = (points[:, :2] - [camera.cx, camera.cy]) * z[:, None] / camera.focal
    space = np.column_stack([xy, z])
    return (space - space[list(RIGID)].mean(axis=0)) @ _face_axes(space).T, mm_per_pixel


def _laid_on(
    shape: npt.NDArray[np.float64], other: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """A shape moved, turned and scaled so that its rigid points lie on another's (Kabsch)."""
    rigid = list(RIGID)
    a, b = shape[rigid] - shape[rigid].mean(axis=0), other[rigid] - other[rigid].mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    turn = u @ flip @ vt
    scale = np.sqrt((b**2).sum() / (a**2).sum())
    return np.asarray(
        scale * (shape - shape[rigid].mean(axis=0)) @ turn + other[rigid].mean(axis=0)
    )


def _face_axes(space: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rows: the face's right-hand axes (across, down, away) in the camera's frame, (3, 3)."""
    across = np.sum([space[b] - space[a] for a, b in SYMMETRIC_PAIRS], axis=0)
    across /= np.linalg.norm(across)
    down = space[CHIN] - space[FOREHEAD_TOP]
    down -= across * (down @ across)
    down /= np.linalg.norm(down)
    return np.stack([across, down, np.cross(across, down)])


def _mouth_patch(
    vertices: npt.NDArray[np.float32], mm_per_pixel: float, settings: CropSettings
) -> MouthPatch:
    corners = vertices[list(MOUTH_CORNERS)]
    mouth = float(np.linalg.norm(corners[1] - corners[0]))
    width = settings.width_in_mouths * mouth
    # A tenth more than the recorded scale, so that resampling loses little.
    pixels = min(settings.largest, 4 * int(np.ceil(1.05 * width / mm_per_pixel / 4)))
    rows = CROP_HEIGHT if pixels == CROP_WIDTH else round(pixels * CROP_HEIGHT / CROP_WIDTH)
    height = width * rows / pixels
    middle = corners.mean(axis=0)[:2] + [0, settings.shift * mouth]
    gx = np.linspace(middle[0] - width / 2, middle[0] + width / 2, 25)
    gy = np.linspace(middle[1] - height / 2, middle[1] + height / 2, 27)
    plane = np.stack(np.meshgrid(gx, gy), axis=-1)
    z = surface_depth(vertices, plane, reach=0.75 * max(width, height))
    return MouthPatch(
        np.concatenate([plane, z[..., None]], axis=-1).astype(np.float32), pixels, rows
    )


def estimate_poses(
    landmarks: npt.NDArray[np.floating],
    mask: Mask,
    camera: Camera,
    settings: MotionSettings | None = None,
) -> tuple[Poses, npt.NDArray[np.bool_]]:
    """Head pose in each frame of an unbroken run.

    Parameters
    ----------
    landmarks : (n, 468, 2) float
        Face mesh of consecutive frames, pixels.
    mask, camera
        What was filmed, and how.
    settings : MotionSettings, optional

    Returns
    -------
    poses : Poses of length n
    good : (n,) bool
        False where the mask does not fit the landmarks.

    Raises
    ------
    FaceError
        If no pose can be computed at all.
    """
    chosen = settings or MotionSettings()
    n = len(landmarks)
    rigid = np.asarray(landmarks, dtype=np.float64)[:, list(RIGID), :2]
    rigid = np.ascontiguousarray(smoothed(rigid, chosen.smoothing), dtype=np.float64)
    model = mask.vertices[list(RIGID)].astype(np.float64)
    eyes = np.linalg.norm(
        np.diff(np.asarray(landmarks)[:, list(OUTER_EYE_CORNERS), :2], axis=1)[:, 0], axis=1
    )
    rotations = np.zeros((n, 3), np.float32)
    translations = np.zeros((n, 3), np.float32)
    good = np.zeros(n, bool)
    r = np.zeros(3)
    t = np.array([0.0, 0.0, camera.focal * EYE_CORNER_DISTANCE / float(np.median(eyes))])
    t[:2] = (rigid[0].mean(axis=0) - [camera.cx, camera.cy]) * t[2] / camera.focal
    for i in range(n):
        found, r_next, t_next = cv2.solvePnP(
            model, rigid[i], camera.matrix, None, r.copy(), t.copy(), True, cv2.SOLVEPNP_ITERATIVE
        )
        if not found or not np.isfinite(r_next).all() or t_next[2] <= 0:
            continue
        r, t = np.asarray(r_next, dtype=np.float64).ravel(), np.asarray(t_next).ravel()
        rotations[i], translations[i] = r, t
        pose = Poses(rotations[i : i + 1], translations[i : i + 1]).matrix(0)
        error = np.median(np.linalg.norm(project(model, pose, camera) - rigid[i], axis=1))
        good[i] = error <= chosen.largest_error * eyes[i]
    if not good.any():
        raise FaceError("the mask fits the face in no frame")
    return Poses(rotations, translations), good
