"""Fits the lip model to crops.

The model is an active appearance model after Liu and Ostermann 2009, section 4.2; the fit is
inverse compositional (Baker and Matthews 2004) with the appearance solved for at each step
(Gross, Matthews and Baker 2005) and priors on both.

* **Shape**: the principal components of the training shapes, and besides them what they do not
  span: the mouth moved, turned, scaled, and bent smoothly by a little. All of it is Gaussian, so
  the components say what is likely and forbid nothing.
* **Appearance**: principal components on the template, each pixel weighted by how well they
  explain it; teeth and tongue, which they explain badly, count less.

Nothing is smoothed over time: the frame before is only a place to start from.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

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
from analysis.aam_kernels import fit_level
from analysis.aam_points import LEFT, RIGHT
from database.lip_model import N_POINTS, LipLevel, LipModel

LOST: Final = 5.0
"""Times the usual squared error at which the lips were not found: a hand, another face."""


@dataclass(frozen=True)
class LipFitSettings:
    """How a shape is fitted.

    Parameters
    ----------
    iterations : tuple of int
        Most steps on each level, finest first.
    tolerance : float
        A level has converged when no point moves further, pixels of the level.
    sharpness : float
        What a texture value counts: neighbours err alike, so it is less than one measurement.
    shift, turn, scale : float
        Standard deviation of the whole mouth's place (parts of its width), angle (radians) and
        size besides what the training shapes span: the head's pose is not exact.
    bend : float
        Standard deviation of smooth bending, in parts of the mouth's width.
    reach : float
        Distance over which bending is alike, in parts of the mouth's width.
    anchor : float
        Weight of the face mesh as a measurement beside the picture; 0 takes it as a start only.
    """

    iterations: tuple[int, ...] = (10, 8)
    tolerance: float = 0.005
    sharpness: float = 0.075
    shift: float = 0.03
    turn: float = 0.03
    scale: float = 0.03
    bend: float = 0.012
    reach: float = 0.35
    anchor: float = 0.0


@dataclass(frozen=True)
class LipFit:
    """Lips found in n crops.

    Parameters
    ----------
    points : (n, 20, 2) float32
        Crop pixels.
    energy : (n,) float32
        Squared error that the model leaves, in relation to the usual one.
    followed : (n,) bool
        True where the frame before was the better start, False where the face mesh was.
    found : (n,) bool
        False where the model is lost; the points are then the face mesh's, as the model would
        have them.
    """

    points: F32
    energy: F32
    followed: npt.NDArray[np.bool_]
    found: npt.NDArray[np.bool_]


def shape_basis(model: LipModel, settings: LipFitSettings) -> F64:
    """Shapes by whitened parameters, (40, n): the components, and what lies beyond them."""
    mean = np.asarray(model.mean_shape, dtype=np.float64)
    width = float(np.linalg.norm(mean[RIGHT] - mean[LEFT]))
    modes = model.shape_modes.astype(np.float64)
    covariance = (modes.T * model.shape_variances) @ modes
    rest = mean - mean.mean(axis=0)
    wholes = (
        (settings.shift * width, np.tile([1.0, 0.0], (N_POINTS, 1))),
        (settings.shift * width, np.tile([0.0, 1.0], (N_POINTS, 1))),
        (settings.turn, np.stack([-rest[:, 1], rest[:, 0]], axis=1)),
        (settings.scale, rest),
    )
    for deviation, motion in wholes:
        vector = deviation * to_vector(motion)
        covariance += np.outer(vector, vector)
    apart = ((mean[:, None] - mean) ** 2).sum(axis=2) / (settings.reach * width) ** 2
    bending = (settings.bend * width) ** 2 * np.exp(-0.5 * apart)
    covariance += np.kron(np.eye(2), bending)
    variances, vectors = np.linalg.eigh(covariance)
    kept = variances > 1e-6 * variances[-1]
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(variances[kept]))[:, ::-1])


@dataclass(frozen=True)
class _Prepared:
    """What the kernel takes of a level."""

    phi: F32
    turning: F64
    mean: F64
    basis: F64
    inverse: F64
    root: F32
    appearance: F32
    shrink: F32
    grad_x: F32
    grad_y: F32
    hessians: F32


class LipFitter:
    """Fits a model to crops.

    Parameters
    ----------
    model : LipModel
    settings : LipFitSettings, optional
    """

    def __init__(self, model: LipModel, settings: LipFitSettings | None = None) -> None:
        self.model = model
        self.settings = settings or LipFitSettings()
        basis = shape_basis(model, self.settings)
        self._inverse = np.linalg.pinv(basis)
        self._mean = to_vector(model.mean_shape)
        self._levels = [
            _prepare(model, level, basis / 2**i, i) for i, level in enumerate(model.levels)
        ]
        # The mesh's own covariance may lack rank: a tenth of a pixel is added.
        covariance = model.start_covariance.astype(np.float64) + 0.01 * np.eye(2 * N_POINTS)
        measured = self.settings.anchor * np.linalg.solve(covariance, basis).T
        self._precision = np.ascontiguousarray(np.eye(basis.shape[1]) + measured @ basis)
        self._gain = np.linalg.solve(self._precision, measured)

    def expected(self, start: npt.NDArray[np.floating]) -> F64:
        """The face mesh's points as the model would have them.

        Parameters
        ----------
        start : (20, 2) float
            Face mesh, crop pixels.

        Returns
        -------
        (20, 2) float64
            Crop pixels.
        """
        scale = self.model.scale
        return np.asarray(np.asarray(start, dtype=np.float64) + self.model.start_bias / scale)

    def fit(
        self,
        crop: npt.NDArray[np.uint8],
        start: npt.NDArray[np.floating],
        previous: npt.NDArray[np.floating] | None = None,
    ) -> tuple[F64, float, bool]:
        """Fit the lips of a crop.

        Parameters
        ----------
        crop : (h, w, 3) uint8
        start : (20, 2) float
            Face mesh, crop pixels.
        previous : (20, 2) float, optional
            Lips of the frame before, crop pixels. The coarsest level is fitted from both, and
            the finer ones from the better.

        Returns
        -------
        points : (20, 2) float64
            Crop pixels.
        energy : float
            In relation to the usual one.
        followed : bool
            Whether `previous` was the better start.
        """
        images = pyramid(crop, self.model.scale, len(self._levels), self.model.blur)
        return self.fit_images(images, start, previous)

    def fit_images(
        self,
        images: list[F32],
        start: npt.NDArray[np.floating],
        previous: npt.NDArray[np.floating] | None = None,
    ) -> tuple[F64, float, bool]:
        """The same for a crop's `pyramid`."""
        anchor = self._whiten(self.expected(start))
        expected = self._gain @ (self._vector(self.expected(start)) - self._mean)
        coarsest = len(self._levels) - 1
        best, least = self._fit_level(coarsest, images, anchor, expected)
        followed = False
        if previous is not None:
            other, energy = self._fit_level(coarsest, images, self._whiten(previous), expected)
            if energy < least:
                best, least, followed = other, energy, True
        for level in range(coarsest - 1, -1, -1):
            best, least = self._fit_level(level, images, best, expected)
        finest = to_points(self._mean + self._levels[0].basis @ best)
        points = (finest + 0.5) / self.model.scale - 0.5
        return points, least / self.model.energy, followed

    def _vector(self, points: npt.NDArray[np.floating]) -> F64:
        """Points in crop pixels as a vector in the finest level's."""
        return to_vector((np.asarray(points, dtype=np.float64) + 0.5) * self.model.scale - 0.5)

    def _whiten(self, points: npt.NDArray[np.floating]) -> F64:
        return np.asarray(self._inverse @ (self._vector(points) - self._mean))

    def _fit_level(
        self, level: int, images: list[F32], start: F64, expected: F64
    ) -> tuple[F64, float]:
        a, s = self._levels[level], self.settings
        p, energy, _ = fit_level(
            images[level],
            a.phi,
            a.turning,
            a.mean,
            a.basis,
            a.inverse,
            a.root,
            a.appearance,
            a.shrink,
            a.grad_x,
            a.grad_y,
            a.hessians,
            s.sharpness,
            self._precision,
            expected,
            start,
            s.iterations[min(level, len(s.iterations) - 1)],
            s.tolerance,
        )
        return p, energy


def fit_clip(
    fitter: LipFitter,
    crops: Iterable[npt.NDArray[np.uint8]],
    starts: npt.ArrayLike,
    numbers: npt.ArrayLike,
) -> LipFit:
    """Fit the lips of a clip's crops, each from the face mesh and from the frame before.

    Parameters
    ----------
    fitter : LipFitter
    crops : iterable of (h, w, 3) uint8
        In the order of time.
    starts : (n, 20, 2) float
        Face mesh, crop pixels (`analysis.aam_points.points_of_contours`).
    numbers : (n,) int
        Frame numbers, rising: over a gap nothing is followed.
    """
    at = np.asarray(starts, dtype=np.float64)
    frames = np.asarray(numbers)
    points = np.empty((len(at), N_POINTS, 2), np.float32)
    energy = np.empty(len(at), np.float32)
    followed = np.zeros(len(at), bool)
    found = np.zeros(len(at), bool)
    previous = None
    for i, crop in enumerate(crops):
        if i and frames[i] != frames[i - 1] + 1:
            previous = None
        points[i], energy[i], followed[i] = fitter.fit(crop, at[i], previous)
        found[i] = energy[i] <= LOST
        if found[i]:
            previous = points[i]
        else:
            points[i], previous = fitter.expected(at[i]), None
    return LipFit(points, energy, followed, found)


def _prepare(model: LipModel, level: LipLevel, basis: F64, number: int) -> _Prepared:
    rows, columns = np.nonzero(level.region)
    x, y = columns + float(level.origin[0]), rows + float(level.origin[1])
    template = at_level(model.template, number)
    phi, _ = spline_weights(template, np.stack([x, y], axis=1))
    _, turning = spline_weights(template, template)
    inside = level.region.astype(bool)

    def values(boxes: F32) -> F64:
        """Boxes (m, 2, h, w) as rows of the region's values."""
        return np.asarray(boxes[:, :, inside].reshape(len(boxes), -1), dtype=np.float64)

    root = 1 / np.sqrt(values(level.noise[None])[0])
    boxes = np.concatenate([level.mean[None], level.modes])
    down, across = np.gradient(boxes.astype(np.float64), axis=(2, 3))
    light = np.linalg.qr((light_of(x, y) * root).T)[0].T
    appearance, grad_x, grad_y = (
        values(b) * root for b in (boxes, np.asarray(across), np.asarray(down))
    )
    appearance = np.concatenate([appearance, light])
    shrink = np.concatenate([level.variances / (level.variances + 1.0), np.ones(len(light))])
    return _Prepared(
        phi=np.ascontiguousarray(phi, np.float32),
        turning=np.ascontiguousarray(turning),
        mean=to_vector(at_level(model.mean_shape, number)),
        basis=np.ascontiguousarray(basis),
        inverse=np.ascontiguousarray(np.linalg.pinv(basis)),
        root=root.astype(np.float32),
        appearance=appearance.astype(np.float32),
        shrink=shrink.astype(np.float32),
        grad_x=grad_x.astype(np.float32),
        grad_y=grad_y.astype(np.float32),
        hessians=_hessians(phi, basis, grad_x, grad_y, appearance[1:], shrink),
    )


def _hessians(phi: F64, basis: F64, grad_x: F64, grad_y: F64, modes: F64, shrink: F64) -> F32:
    """Hessians of all pairs of appearance weights, as the kernel adds them up.

    First by the template's points, where a pair is one product of gradients for each pixel and
    a product of two points' weights, then by the parameters.
    """
    n, pixels = basis.shape[1], phi.shape[1]
    across, down = (g.astype(np.float32) for g in (grad_x, grad_y))
    weights = phi.astype(np.float32)
    both = (weights[:, None] * weights[None]).reshape(-1, pixels).T
    rows, columns = np.tril_indices(len(across))

    def pairs(a: F32, b: F32) -> F64:
        """Sums over the texture of all pairs' products, by two points, (pairs, 20, 20)."""
        out = np.empty((len(rows), N_POINTS, N_POINTS))
        for first in range(0, len(rows), 64):
            part = slice(first, first + 64)
            product = (a[rows[part]] * b[columns[part]]).reshape(-1, CHANNELS, pixels).sum(axis=1)
            out[part] = (product @ both).reshape(-1, N_POINTS, N_POINTS)
        return out

    crossed = pairs(across, down)
    by_points = np.concatenate(
        [
            np.concatenate([pairs(across, across), crossed], axis=2),
            np.concatenate([pairs(down, across), pairs(down, down)], axis=2),
        ],
        axis=1,
    )
    # What the appearance explains is no error.
    spread = np.tile(weights.T, (CHANNELS, 1))
    scaled = (np.sqrt(shrink)[:, None] * modes).astype(np.float32)
    halves = [[(scaled * g[i]) @ spread for i in range(len(g))] for g in (across, down)]
    explained = np.concatenate([np.stack(half) for half in halves], axis=2).astype(np.float64)
    explained = explained @ basis
    out = basis.T @ by_points @ basis
    out -= explained[rows].transpose(0, 2, 1) @ explained[columns]
    out = np.where((rows == columns)[:, None, None], out, out + out.transpose(0, 2, 1))
    return np.ascontiguousarray(out.reshape(-1, n * n), dtype=np.float32)
