"""Kernels of the lip model: sample a picture under a warp, and fit a shape to it.

Shapes are vectors of 40 here: the 20 points' x, then their y. All kernels release the GIL and
are compiled once a machine.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

FARTHEST = 1e6
"""Squared pixels that points move in one step when the fit has lost them; not a number, too."""

_FAST = {"reassoc", "contract", "nsz", "arcp"}


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def warp_points(phi: F32, shape: F64, x: F32, y: F32) -> None:
    """Where the pixels of the template lie under a shape.

    Parameters
    ----------
    phi : (20, P) float32
        Weight of each point in each pixel's place.
    shape : (40,) float64
    x, y : (P,) float32
        Filled in.
    """
    points, pixels = phi.shape
    for i in range(pixels):
        x[i] = 0.0
        y[i] = 0.0
    for k in range(points):
        row = phi[k]
        sx, sy = np.float32(shape[k]), np.float32(shape[points + k])
        for i in range(pixels):
            x[i] += row[i] * sx
            y[i] += row[i] * sy


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def sample(image: F32, x: F32, y: F32, out: F32) -> None:
    """Values of a picture at places, bilinear; beyond its edge the edge's.

    Parameters
    ----------
    image : (h, w, C) float32
    x, y : (P,) float32
    out : (C, P) float32
        Filled in.
    """
    height, width, channels = image.shape
    right, bottom = np.float32(width - 1.001), np.float32(height - 1.001)
    zero = np.float32(0.0)
    for i in range(len(x)):
        px = min(max(x[i], zero), right)
        py = min(max(y[i], zero), bottom)
        left, top = int(px), int(py)
        fx, fy = px - np.float32(left), py - np.float32(top)
        for c in range(channels):
            a = image[top, left, c]
            b = image[top, left + 1, c]
            d = image[top + 1, left, c]
            e = image[top + 1, left + 1, c]
            upper = a + fx * (b - a)
            out[c, i] = upper + fy * (d + fx * (e - d) - upper)


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def _residual(
    texture: F32, root: F32, appearance: F32, shrink: F32, weights: F32, error: F32
) -> float:
    """Whiten a texture, take the appearance out of it, and give the squared error of the rest.

    Fills `weights` (one, then the modes') and `error`, the whitened difference less the modes.
    """
    pixels = len(root)
    modes = len(shrink)
    for q in range(pixels):
        error[q] = texture[q] * root[q] - appearance[0, q]
    total = np.float32(0.0)
    for q in range(pixels):
        total += error[q] * error[q]
    weights[0] = 1.0
    for i in range(modes):
        row = appearance[i + 1]
        dot = np.float32(0.0)
        for q in range(pixels):
            dot += row[q] * error[q]
        weights[i + 1] = shrink[i] * dot
        total -= weights[i + 1] * dot
    for i in range(modes):
        row = appearance[i + 1]
        weight = weights[i + 1]
        for q in range(pixels):
            error[q] -= weight * row[q]
    return float(total)


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def _gradient(
    error: F32, weights: F32, grad_x: F32, grad_y: F32, phi: F32, slope: F32, out: F64
) -> None:
    """Derivative of the error by the template's 20 points, (40,), at this appearance.

    `slope` (2, Q) is scratch.
    """
    points, pixels = phi.shape
    values = len(error)
    for q in range(values):
        slope[0, q] = grad_x[0, q]
        slope[1, q] = grad_y[0, q]
    for i in range(1, len(grad_x)):
        weight = weights[i]
        across, down = grad_x[i], grad_y[i]
        for q in range(values):
            slope[0, q] += weight * across[q]
            slope[1, q] += weight * down[q]
    for d in range(2):
        row = slope[d]
        for q in range(values):
            row[q] *= error[q]
        for c in range(1, values // pixels):
            for i in range(pixels):
                row[i] += row[c * pixels + i]
        for k in range(points):
            dot = np.float32(0.0)
            weight_row = phi[k]
            for i in range(pixels):
                dot += weight_row[i] * row[i]
            out[d * points + k] = dot


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def fit_level(
    image: F32,
    phi: F32,
    turning: F64,
    mean: F64,
    basis: F64,
    inverse: F64,
    root: F32,
    appearance: F32,
    shrink: F32,
    grad_x: F32,
    grad_y: F32,
    hessians: F32,
    sharpness: float,
    precision: F64,
    expected: F64,
    start: F64,
    iterations: int,
    tolerance: float,
) -> tuple[F64, float, int]:
    """Fit the shape to one level of a picture: simultaneous inverse compositional Gauss-Newton.

    Appearance is solved for at each step (and held to its variance); the steepest descent
    pictures are those of the present appearance, and their Hessian a quadratic form in it that
    was worked out beforehand. The step is taken in the template and composed with the warp.

    Parameters
    ----------
    image : (h, w, C) float32
    phi : (20, P) float32
        Warp, as in `warp_points`.
    turning : (2, 20, 20) float64
        Derivatives of the warp at the template's points: by x and by y, of each point, by the
        shape's points.
    mean : (40,) float64
    basis : (40, n) float64
        Shape of whitened parameters: ``mean + basis @ p``.
    inverse : (n, 40) float64
        Its pseudo-inverse.
    root : (Q,) float32
        Whitening of the C * P texture values.
    appearance : (1 + m + l, Q) float32
        Whitened: mean, then orthonormal modes, those of light last.
    shrink : (m + l,) float32
        Share of each mode that is signal.
    grad_x, grad_y : (1 + m, Q) float32
        Derivatives of `appearance` across and down the template; light has none.
    hessians : ((m + 1) (m + 2) / 2, n * n) float32
        Of pairs (0, 0), (1, 0), (1, 1), (2, 0), ...: both halves of a pair in one.
    sharpness : float
        Weight of a squared whitened error against the prior.
    precision, expected : (n, n), (n,) float64
        Prior of the parameters.
    start : (n,) float64
    iterations : int
    tolerance : float
        Greatest motion of a point, pixels, at which the fit has converged.

    Returns
    -------
    p : (n,) float64
    energy : float
        At the best point seen.
    steps : int
    """
    channels = image.shape[2]
    points, pixels = phi.shape
    n = len(start)
    x, y = np.empty(pixels, np.float32), np.empty(pixels, np.float32)
    texture = np.empty((channels, pixels), np.float32)
    error = np.empty(channels * pixels, np.float32)
    slope = np.empty((2, channels * pixels), np.float32)
    weights = np.empty(len(appearance), np.float32)
    derivative = np.empty(2 * points)
    moved = np.empty((2 * points, n))
    hessian = np.empty(n * n, np.float32)
    p = start.copy()
    best = start.copy()
    least = np.inf
    steps = 0
    last = False
    while True:
        shape = mean + basis @ p
        warp_points(phi, shape, x, y)
        sample(image, x, y, texture)
        away = p - expected
        pull = precision @ away
        unlikely = float(away @ pull)
        misfit = _residual(texture.reshape(-1), root, appearance, shrink, weights, error)
        energy = sharpness * misfit + unlikely
        if energy < least:
            least = energy
            best[:] = p
        if last or steps == iterations:
            return best, least, steps
        _gradient(error, weights, grad_x, grad_y, phi, slope, derivative)
        hessian[:] = 0.0
        pair = 0
        for i in range(len(grad_x)):
            for j in range(i + 1):
                factor = weights[i] * weights[j]
                row = hessians[pair]
                for q in range(n * n):
                    hessian[q] += factor * row[q]
                pair += 1
        # Turns motion of the template's points into motion of the shape's, in parameters.
        for k in range(points):
            xx = turning[0, k] @ shape[:points]
            yx = turning[0, k] @ shape[points:]
            xy = turning[1, k] @ shape[:points]
            yy = turning[1, k] @ shape[points:]
            for j in range(n):
                bx, by = basis[k, j], basis[points + k, j]
                moved[k, j] = xx * bx + xy * by
                moved[points + k, j] = yx * bx + yy * by
        turn = inverse @ moved
        left = sharpness * hessian.reshape(n, n).astype(np.float64)
        left += turn.T @ precision @ turn
        right = sharpness * (basis.T @ derivative) + turn.T @ pull
        step = turn @ np.linalg.solve(left, right)
        p = p - step
        steps += 1
        change = basis @ step
        largest, total = 0.0, 0.0
        for k in range(points):
            square = change[k] ** 2 + change[points + k] ** 2
            total += square
            largest = max(largest, square)
        if not total < FARTHEST:
            return best, least, steps
        last = largest < tolerance**2
