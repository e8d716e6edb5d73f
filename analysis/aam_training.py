"""Training of the lip model: frames are chosen, their points refined, and the model built.

The training points are rough, whether they come from the face mesh or from a hand. While the
model is built they are moved to where the model of the *other* training frames finds them, as
far as their own accuracy allows, and the model is built again. What all of them would move by
together is taken back: the model sharpens the points, it does not redefine them.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.cluster.vq import kmeans2
from scipy.ndimage import gaussian_filter

from analysis.aam import (
    CHANNELS,
    F32,
    F64,
    at_level,
    light_of,
    pyramid,
    spline_weights,
    to_points,
    to_vector,
)
from analysis.aam_fit import LipFitSettings, LipFitter
from analysis.aam_kernels import sample, warp_points
from analysis.aam_points import LEFT, N_OUTER, RIGHT
from database.errors import FaceError
from database.lip_model import LEVELS, N_POINTS, LipLevel, LipModel

FEWEST: Final = 8
"""Training frames without which there is no model."""

_UPPER: Final = (N_OUTER + 1, N_OUTER + 2, N_OUTER + 3)
_LOWER: Final = (N_OUTER + 7, N_OUTER + 6, N_OUTER + 5)
_LOWER_LIP: Final = (*range(RIGHT + 1, N_OUTER), *_LOWER)


@dataclass(frozen=True)
class LipTrainingSettings:
    """How a lip model is built.

    Parameters
    ----------
    frames : int
        Training frames chosen.
    width : float
        Greatest width of the mouth on the finest level, pixels; footage that carries less is
        fitted at its own resolution.
    blur : float
        Standard deviation of the smoothing of each level, pixels; sampling between pixels is
        linear, and should find nothing sharper.
    modes : int
        Most components of the appearance.
    rough_modes : int
        The same, of the models that refine the training points.
    shape_share : float
        Share of the shape's variance that its components explain.
    rim : float
        Skin around the lips that belongs to the template, in parts of the mouth's width.
    trust : float
        How much a pixel's weight heeds how well the components explain it, 0 to 1.
    opening : float
        Least distance of the template's inner lips, in parts of the mouth's width.
    rounds : int
        Times that the training points are refined.
    folds : int
        Parts of the training frames, each fitted with the model of the others.
    mesh_error, mark_error : float
        Standard deviation of a training point from the face mesh and from a hand, in parts of
        the mouth's width.
    alike : float
        Weight of the points given, beside the picture: a hand and the mesh err alike in
        neighbouring points, so that 20 points are fewer measurements.
    stiffness : float
        Bending allowed while the points are refined, in relation to that of a fit.
    """

    frames: int = 40
    width: float = 64.0
    blur: float = 0.3
    modes: int = 16
    rough_modes: int = 8
    shape_share: float = 0.98
    rim: float = 0.25
    trust: float = 0.5
    opening: float = 0.10
    rounds: int = 3
    folds: int = 4
    mesh_error: float = 0.02
    mark_error: float = 0.006
    alike: float = 0.25
    stiffness: float = 0.5


def choose_frames(weights: npt.NDArray[np.floating], count: int, sample: int = 4000) -> list[int]:
    """Frames that span the mouth's pictures.

    The frames nearest the centres of so many clusters. The clusters start from frames that lie
    as far from each other as can be, so that rare mouths have their own.

    Parameters
    ----------
    weights : (n, K) float
        PCA weights of the frames.
    count : int
    sample : int
        Frames looked at, spread evenly.

    Returns
    -------
    list of int
        Rising.
    """
    looked = np.unique(np.linspace(0, len(weights) - 1, min(sample, len(weights))).astype(int))
    values = np.asarray(weights, dtype=np.float64)[looked]
    if len(values) <= count:
        return [int(i) for i in looked]
    chosen = [int(np.argmin(((values - values.mean(axis=0)) ** 2).sum(axis=1)))]
    away = ((values - values[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, ((values - values[chosen[-1]]) ** 2).sum(axis=1))
    with warnings.catch_warnings():
        # Frames that are all alike leave clusters without any.
        warnings.simplefilter("ignore", UserWarning)
        centres, _ = kmeans2(values, values[chosen], iter=20, minit="matrix")
    nearest = {int(((values - centre) ** 2).sum(axis=1).argmin()) for centre in centres}
    return sorted(int(looked[i]) for i in nearest)


@dataclass(frozen=True)
class TrainedLips:
    """A model and the points that it was built on.

    Parameters
    ----------
    model : LipModel
    points : (n, 20, 2) float64
        Refined, crop pixels.
    moved : tuple of float
        Root mean square motion of the points in each round, crop pixels.
    """

    model: LipModel
    points: F64
    moved: tuple[float, ...]


def train_lip_model(
    crops: Sequence[npt.NDArray[np.uint8]],
    points: npt.NDArray[np.floating],
    marked: npt.ArrayLike | None = None,
    starts: npt.NDArray[np.floating] | None = None,
    settings: LipTrainingSettings | None = None,
    fit: LipFitSettings | None = None,
) -> TrainedLips:
    """Build a lip model.

    Parameters
    ----------
    crops : sequence of (h, w, 3) uint8
    points : (n, 20, 2) float
        Their points, crop pixels.
    marked : (n,) bool, optional
        True where the points were set by hand; from the face mesh by default.
    starts : (n, 20, 2) float, optional
        The face mesh's points, where `points` are others.
    settings : LipTrainingSettings, optional
    fit : LipFitSettings, optional

    Returns
    -------
    TrainedLips

    Raises
    ------
    FaceError
        If there are too few frames.
    """
    chosen, fitting = settings or LipTrainingSettings(), fit or LipFitSettings()
    given = np.asarray(points, dtype=np.float64)
    if len(given) < FEWEST:
        raise FaceError(
            f"a lip model needs {FEWEST} frames of the face, not {len(given)}; film more"
        )
    by_hand = np.zeros(len(given), bool) if marked is None else np.asarray(marked, dtype=bool)
    mesh = given if starts is None else np.asarray(starts, dtype=np.float64)
    scale = min(1.0, chosen.width / _mouth_width(given))
    images = [pyramid(crop, scale, LEVELS, chosen.blur) for crop in crops]
    finest, begun = _to_level(given, scale), _to_level(mesh, scale)
    refined = finest
    moved = []
    rough = replace(fitting, anchor=chosen.alike, bend=chosen.stiffness * fitting.bend)
    few = replace(chosen, modes=min(chosen.modes, chosen.rough_modes))
    for _ in range(chosen.rounds):
        before = refined
        found, _ = _cross_fitted(images, before, finest, by_hand, scale, few, rough)
        # What all of them move by is no error of the single frame.
        refined = found - (found - finest).mean(axis=0)
        moved.append(float(np.sqrt(((refined - before) ** 2).sum(axis=2).mean())) / scale)
    plain = replace(fitting, anchor=0.0)
    _, energies = _cross_fitted(images, refined, refined, by_hand, scale, chosen, plain)
    model = _build(images, refined, begun, scale, chosen)
    usual = replace(model, energy=float(np.median(energies)))
    return TrainedLips(usual, _to_crop(refined, scale), tuple(moved))


def _mouth_width(points: F64) -> float:
    return float(np.median(np.linalg.norm(points[:, RIGHT] - points[:, LEFT], axis=1)))


def _to_level(points: F64, scale: float) -> F64:
    return np.asarray((points + 0.5) * scale - 0.5)


def _to_crop(points: F64, scale: float) -> F64:
    return np.asarray((points + 0.5) / scale - 0.5)


def _cross_fitted(
    images: list[list[F32]],
    present: F64,
    given: F64,
    by_hand: npt.NDArray[np.bool_],
    scale: float,
    settings: LipTrainingSettings,
    fit: LipFitSettings,
) -> tuple[F64, F64]:
    """Points where the model of other frames finds them, and with how much error.

    Parameters
    ----------
    images
        Pyramids of n crops.
    present : (n, 20, 2) float64
        Points that the models are built on, and the fits start from; pixels of the finest
        level.
    given : (n, 20, 2) float64
        What stands for a measurement, if `fit` heeds one.
    by_hand : (n,) bool
        How good a measurement it is.
    """
    n = len(images)
    parts = min(settings.folds, n)
    found, energies = np.empty_like(present), np.empty(n)
    for part in range(parts):
        mine = np.arange(n) % parts == part
        others = [images[i] for i in np.flatnonzero(~mine)]
        model = _build(others, present[~mine], present[~mine], scale, settings)
        for hand in (False, True):
            rows = np.flatnonzero(mine & (by_hand == hand))
            if not len(rows):
                continue
            error = settings.mark_error if hand else settings.mesh_error
            variance = np.float32((error * _mouth_width(given)) ** 2)
            covariance = np.eye(2 * N_POINTS, dtype=np.float32) * variance
            fitter = LipFitter(replace(model, start_covariance=covariance), fit)
            for i in rows:
                start, was = (_to_crop(points[i], scale) for points in (given, present))
                points, energies[i], _ = fitter.fit_images(images[i], start, was)
                found[i] = _to_level(points, scale)
    return found, energies


def _build(
    images: list[list[F32]],
    shapes: F64,
    starts: F64,
    scale: float,
    settings: LipTrainingSettings,
) -> LipModel:
    """A model of pictures with points, all in pixels of the finest level."""
    vectors = to_vector(shapes)
    mean = vectors.mean(axis=0)
    _, singular, modes = np.linalg.svd(vectors - mean, full_matrices=False)
    variances = singular**2 / (len(vectors) - 1)
    share = np.cumsum(variances) / variances.sum() if variances.sum() > 0 else np.ones(1)
    kept = int(np.searchsorted(share, settings.shape_share)) + 1
    template = _opened(shapes.mean(axis=0), settings.opening)
    away = vectors - to_vector(starts)
    bias = away.mean(axis=0)
    covariance = (away - bias).T @ (away - bias) / (len(away) - 1)
    levels = [
        _appearance([pictures[i] for pictures in images], shapes, template, i, settings)
        for i in range(LEVELS)
    ]
    return LipModel(
        scale=scale,
        blur=settings.blur,
        energy=1.0,
        mean_shape=shapes.mean(axis=0).astype(np.float32),
        shape_modes=modes[:kept].astype(np.float32),
        shape_variances=variances[:kept].astype(np.float32),
        template=template.astype(np.float32),
        start_bias=to_points(bias).astype(np.float32),
        start_covariance=covariance.astype(np.float32),
        levels=tuple(levels),
    )


def _opened(shape: F64, opening: float) -> F64:
    """A shape with its lips at least so far apart: the lower lip is moved down."""
    out = shape.copy()
    width = float(np.linalg.norm(shape[RIGHT] - shape[LEFT]))
    least = (shape[list(_LOWER), 1] - shape[list(_UPPER), 1]).min()
    lack = opening * width - least
    if lack > 0:
        out[list(_LOWER_LIP), 1] += lack
    return out


def _appearance(
    images: list[F32], shapes: F64, template: F64, number: int, settings: LipTrainingSettings
) -> LipLevel:
    """Principal components of the pictures, drawn onto the template."""
    base = at_level(template, number)
    rim = settings.rim * float(np.linalg.norm(base[RIGHT] - base[LEFT]))
    low = np.floor(base.min(axis=0) - rim - 2).astype(int)
    high = np.ceil(base.max(axis=0) + rim + 2).astype(int)
    columns, rows = high - low + 1
    y, x = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1].astype(np.float64)
    region = _region(base[:N_OUTER] - low, (int(rows), int(columns)), rim)
    inside = region.astype(bool)
    phi, _ = spline_weights(base, np.stack([x.ravel(), y.ravel()], axis=1))
    weights = np.ascontiguousarray(phi, np.float32)
    boxes = np.empty((len(images), CHANNELS, int(rows), int(columns)))
    px, py = np.empty(x.size, np.float32), np.empty(x.size, np.float32)
    for i, image in enumerate(images):
        warp_points(weights, to_vector(at_level(shapes[i], number)), px, py)
        out = np.empty((CHANNELS, x.size), np.float32)
        sample(image, px, py, out)
        boxes[i] = out.reshape(CHANNELS, int(rows), int(columns))
    light = light_of(x[inside], y[inside])
    light_boxes = _light_boxes(x, y, inside)

    def values(of: F64) -> F64:
        return np.asarray(of[:, :, inside].reshape(len(of), -1))

    noise = np.ones(boxes.shape[1:])
    count = min(settings.modes, len(images) - 2)
    # Pixels are weighed alike at first, then by how well the first components explain them.
    for last in (False, True):
        root = 1 / np.sqrt(values(noise[None])[0])
        # Light first, so that no component describes it.
        lights = np.linalg.lstsq((light * root).T, (values(boxes) * root).T, rcond=None)[0]
        lit = boxes - np.tensordot(lights.T, light_boxes, axes=1)
        mean = lit.mean(axis=0)
        away = lit - mean
        # Few pictures of many values: by way of their products among themselves.
        whitened = values(away) * root
        squares, left = np.linalg.eigh(whitened @ whitened.T)
        left = left[:, ::-1][:, :count]
        singular = np.sqrt(np.maximum(squares[::-1][:count], 1e-12))
        modes = np.tensordot((left / singular).T, away, axes=1)
        if not last:
            rest = away - np.tensordot(left * singular, modes, axes=1)
            unexplained = (rest**2).sum(axis=0) / (len(images) - 1 - count)
            noise = _noise(unexplained, inside, settings.trust)
    return LipLevel(
        origin=low.astype(np.int32),
        region=region,
        mean=mean.astype(np.float32),
        modes=modes.astype(np.float32),
        variances=(singular**2 / (len(images) - 1)).astype(np.float32),
        noise=noise.astype(np.float32),
    )


def _noise(unexplained: F64, inside: npt.NDArray[np.bool_], trust: float) -> F64:
    """Variance to weigh pixels by, from what is unexplained in them, (2, h, w)."""
    smooth = np.stack([gaussian_filter(channel, 1.0) for channel in unexplained])
    level = np.array([channel[inside].mean() for channel in smooth])[:, None, None] + 1e-8
    return np.asarray(level * (0.05 + smooth / level) ** trust)


def _light_boxes(x: F64, y: F64, inside: npt.NDArray[np.bool_]) -> F64:
    """`analysis.aam.light_of` over the whole box, (6, 2, h, w)."""
    base = np.stack([np.ones_like(x), x - x[inside].mean(), y - y[inside].mean()])
    out = np.zeros((CHANNELS * 3, CHANNELS, *x.shape))
    for c in range(CHANNELS):
        out[3 * c : 3 * c + 3, c] = base
    return out


def _region(outer: F64, shape: tuple[int, int], rim: float) -> npt.NDArray[np.uint8]:
    """The lips and a rim of skin around them."""
    drawn = np.zeros(shape, np.uint8)
    cv2.fillPoly(drawn, [np.round(outer * 16).astype(np.int32)], (1,), shift=4)
    side = 2 * max(1, round(rim)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(drawn, disc), dtype=np.uint8)
