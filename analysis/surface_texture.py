"""What the mask's rigid surface looks like: read off one frame, averaged over many, blended.

A texture is grey values of the surface's points, their gradients along the mask's axes, and how
certain each value is. It is kept at two levels of a pyramid, full size and half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.gradient_kernels import BLUR, LIGHTS, sample_points
from analysis.photometric import REGIONS, Surface
from analysis.rigid import Matrix, angle, direction
from database.mask import OUTER_EYE_CORNERS, Camera
from database.schema import RIGID_COARSE

Single = npt.NDArray[np.float32]

WORKING_EYES: Final = 110.0
"""Pixels between the outer eye corners that pictures are reduced to, where they have more."""

LEVEL_STEPS: Final = (1, RIGID_COARSE)
"""Of the surface's points every one at full size, every so many at half."""

THIN_STEP: Final = 3
"""Of the points at full size, every so many will do for a first alignment."""

LEAST_GAIN: Final = 0.2
"""A region is not thought to be lit less than this, in parts of the key's light."""

SHADE: Final = 0.5
"""Part of a picture's broad shades that is taken off: they move with the light, not the head."""

SHADE_SIZE: Final = 4.0
"""Pixels (standard deviation) over which a shade is broad."""

Level = tuple[Single, Matrix]
"""A grey picture and its camera (focal length and principal point, pixels)."""

Levels = tuple[Level, Level]
"""A picture at full size and at half."""


def face_picture(
    picture: npt.NDArray[np.uint8], landmarks: npt.NDArray[np.floating], camera: Camera
) -> tuple[npt.NDArray[np.uint8], Matrix]:
    """Cut the face out of a frame, grey, and no larger than motion needs.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    landmarks : (468, 2) float
        Face mesh of this frame, pixels.
    camera : Camera
        Of the whole picture.

    Returns
    -------
    grey : (h, w) uint8
    camera : (3,) float64
        Focal length and principal point in this picture's pixels.
    """
    eyes = landmarks[OUTER_EYE_CORNERS[1], :2] - landmarks[OUTER_EYE_CORNERS[0], :2]
    apart = max(float(np.hypot(*eyes)), 1.0)
    low, high = landmarks[:, :2].min(axis=0), landmarks[:, :2].max(axis=0)
    margin = 0.25 * apart
    height, width = picture.shape[:2]
    left, top = np.clip(np.floor(low - margin), 0, [width - 1, height - 1]).astype(int)
    right, bottom = np.clip(np.ceil(high + margin), [left + 1, top + 1], [width, height]).astype(
        int
    )
    part = np.ascontiguousarray(picture[top:bottom, left:right])
    grey = np.asarray(cv2.cvtColor(part, cv2.COLOR_RGB2GRAY), np.uint8)
    across = down = 1.0
    if apart > WORKING_EYES:
        h, w = grey.shape
        size = (max(1, round(w * WORKING_EYES / apart)), max(1, round(h * WORKING_EYES / apart)))
        across, down = size[0] / w, size[1] / h
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    # Across and down differ by the rounding of a size, a few thousandths at most.
    focal = camera.focal * (across * down) ** 0.5
    x, y = (camera.cx - left + 0.5) * across - 0.5, (camera.cy - top + 0.5) * down - 0.5
    return grey, np.array([focal, x, y])


def picture_levels(grey: npt.NDArray[np.uint8], camera: Matrix, blur: float) -> Levels:
    """A picture blurred by so many pixels, its broad shades softened, and at half the size."""
    picture = grey.astype(np.float32)
    fine = cv2.GaussianBlur(picture, (0, 0), blur) - SHADE * cv2.GaussianBlur(
        picture, (0, 0), SHADE_SIZE
    )
    coarse = cv2.pyrDown(fine)
    return (np.asarray(fine, np.float32), camera), (np.asarray(coarse, np.float32), camera / 2)


@dataclass(frozen=True)
class Texture:
    """What the surface looks like at one level of the pyramid.

    Parameters
    ----------
    points, region, place
        Of the surface's points that this level uses.
    values : (n,) float32
        Grey values.
    curvature : (n,) float32
        Their Laplacian in the picture: what a blur adds.
    gradient : (n, 3) float32
        Grey values a millimetre, along the mask's axes.
    certainty : (n,) float32
        One over the standard deviation of a value, 0 where nothing is known.
    """

    points: Single
    region: npt.NDArray[np.int64]
    place: Single
    values: Single
    curvature: Single
    gradient: Single
    certainty: Single

    @cached_property
    def thinned(self) -> Texture:
        """The same with few of its points."""
        return Texture(
            np.ascontiguousarray(self.points[::THIN_STEP]),
            np.ascontiguousarray(self.region[::THIN_STEP]),
            np.ascontiguousarray(self.place[::THIN_STEP]),
            np.ascontiguousarray(self.values[::THIN_STEP]),
            np.ascontiguousarray(self.curvature[::THIN_STEP]),
            np.ascontiguousarray(self.gradient[::THIN_STEP]),
            np.ascontiguousarray(self.certainty[::THIN_STEP]),
        )


@dataclass(frozen=True)
class KeyView:
    """A view of the head, and what the surface looks like from there.

    Parameters
    ----------
    direction : (3,) float64
        From the mask's centre to the camera, in the mask's frame.
    levels : pair of Texture
        At full size and at half.
    """

    direction: Matrix
    levels: tuple[Texture, Texture]


def view_of_frame(surface: Surface, shown: Levels, pose: Matrix, light: Matrix) -> KeyView:
    """A key view with the texture of one frame, whose pose and light are known.

    Parameters
    ----------
    surface : Surface
    shown : Levels
    pose : (3, 4) float64
    light : (regions, lights) float64
        In relation to the other views', so that all are lit alike.
    """
    facing = _facing(surface, pose)
    levels = []
    for (grey, camera), step in zip(shown, LEVEL_STEPS, strict=True):
        points, region, place = _thinned(surface, step)
        values, curvature = np.empty((2, len(points)), np.float32)
        gradient = np.zeros((len(points), 3), np.float32)
        _read((grey, camera), pose, points, values, curvature, gradient)
        _relight(values, curvature, gradient, light, region, place)
        seen = ~np.isnan(values)
        certainty = np.where(seen, facing[::step], 0).astype(np.float32)
        known = np.nan_to_num(values)
        bent = np.nan_to_num(curvature)
        levels.append(Texture(points, region, place, known, bent, gradient, certainty))
    return KeyView(direction(pose), (levels[0], levels[1]))


def view_of_many(
    surface: Surface,
    towards: Matrix,
    shown: Sequence[Levels],
    poses: Sequence[Matrix],
    lights: Sequence[Matrix],
) -> KeyView:
    """A key view with the mean texture of aligned frames.

    Parameters
    ----------
    surface : Surface
    towards : (3,) float64
        Direction of the view.
    shown, poses, lights : n of each
        Frames, their poses, and their light (regions, LIGHTS).
    """
    facing = _facing(surface, poses[len(poses) // 2])
    fine, coarse = (
        _mean_texture(surface, [s[level] for s in shown], poses, lights, step, facing[::step])
        for level, step in enumerate(LEVEL_STEPS)
    )
    return KeyView(towards, (fine, coarse))


def _mean_texture(
    surface: Surface,
    shown: Sequence[Level],
    poses: Sequence[Matrix],
    lights: Sequence[Matrix],
    step: int,
    facing: Single,
) -> Texture:
    """Robust mean of what frames show, in the same light, and how certain it is."""
    points, region, place = _thinned(surface, step)
    values, curvature = np.empty((2, len(shown), len(points)), np.float32)
    gradient = np.zeros((len(shown), len(points), 3), np.float32)
    for f, (level, pose) in enumerate(zip(shown, poses, strict=True)):
        _read(level, pose, points, values[f], curvature[f], gradient[f])
        _relight(values[f], curvature[f], gradient[f], lights[f], region, place)
    seen = ~np.isnan(values)
    values, curvature = np.where(seen, values, 0), np.where(seen, curvature, 0)
    middle = np.median(values, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(values - middle), axis=0), 1.0)
    weight = np.maximum(0, 1 - ((values - middle) / (4.685 * spread)) ** 2) ** 2 * seen
    total = np.maximum(weight.sum(axis=0), 1e-6)
    mean = (weight * values).sum(axis=0) / total
    variance = (weight * (values - mean) ** 2).sum(axis=0) / total
    often = seen.mean(axis=0) > 0.5
    # A grey value is never surer than a step of the picture's own scale.
    certainty = np.where(often, facing / np.sqrt(1 + variance), 0)
    bent = (weight * curvature).sum(axis=0) / total
    slope = np.einsum("fp,fpk->pk", weight, gradient) / total[:, None]
    return Texture(
        points,
        region,
        place,
        mean.astype(np.float32),
        bent.astype(np.float32),
        np.ascontiguousarray(slope, np.float32),
        certainty.astype(np.float32),
    )


def texture_seen(views: Sequence[KeyView], pose: Matrix, level: int, reach: float) -> Texture:
    """The texture to be seen at a pose: a blend of the key views around it.

    Parameters
    ----------
    views : sequence of KeyView
    pose : (3, 4) float64
    level : int
        0 for full size, 1 for half.
    reach : float
        Radians from its direction at which a view counts no more; the nearest always does.
    """
    if len(views) == 1:
        return views[0].levels[level]
    angles = np.array([angle(view.direction, direction(pose)) for view in views])
    weights = np.maximum(0, 1 - angles / reach)
    if np.count_nonzero(weights) < 2:
        return views[int(angles.argmin())].levels[level]
    chosen = [(w, v.levels[level]) for w, v in zip(weights, views, strict=True) if w > 0]
    textures = [t for _, t in chosen]
    share = np.stack([w * (t.certainty > 0) for w, t in chosen])
    share = (share / np.maximum(share.sum(axis=0), 1e-9)).astype(np.float32)
    return Texture(
        textures[0].points,
        textures[0].region,
        textures[0].place,
        np.asarray(sum(s * t.values for s, t in zip(share, textures, strict=True))),
        np.asarray(sum(s * t.curvature for s, t in zip(share, textures, strict=True))),
        np.asarray(sum(s[:, None] * t.gradient for s, t in zip(share, textures, strict=True))),
        np.asarray(sum(s * t.certainty for s, t in zip(share, textures, strict=True))),
    )


def plain_light() -> Matrix:
    """The light in which a texture was seen, for every region, (regions, LIGHTS)."""
    light = np.zeros((len(REGIONS), LIGHTS))
    light[:, 0] = 1
    return light


def _read(
    level: Level,
    pose: Matrix,
    points: Single,
    values: Single,
    curvature: Single,
    gradient: Single,
) -> None:
    """Read grey values, their Laplacian and their gradient where the points are seen."""
    grey, camera = level
    at = np.ascontiguousarray(pose)
    sample_points(grey, camera, at, points, values, gradient)
    bend = np.asarray(cv2.Laplacian(grey, cv2.CV_32F), np.float32)
    sample_points(bend, camera, at, points, curvature, np.empty((0, 3), np.float32))


def _relight(
    values: Single,
    curvature: Single,
    gradient: Single,
    light: Matrix,
    region: npt.NDArray[np.int64],
    place: Single,
) -> None:
    """Take a frame's light off what it shows, in place."""
    lit = light[region].astype(np.float32)
    gain = np.maximum(lit[:, 0] + (lit[:, 1:BLUR] * place).sum(axis=1), LEAST_GAIN)
    values -= lit[:, -1] + lit[:, BLUR] * curvature
    values /= gain
    curvature /= gain
    gradient /= gain[:, None]


def _thinned(surface: Surface, step: int) -> tuple[Single, npt.NDArray[np.int64], Single]:
    return (
        np.ascontiguousarray(surface.points[::step]),
        np.ascontiguousarray(surface.region[::step]),
        np.ascontiguousarray(surface.place[::step]),
    )


def _facing(surface: Surface, pose: Matrix) -> Single:
    """1 for points turned to the camera, less to 0 for those seen edge on, (n,)."""
    cosine = surface.normals @ direction(pose).astype(np.float32)
    return np.asarray(np.clip((cosine - 0.15) / 0.25, 0, 1), np.float32)
