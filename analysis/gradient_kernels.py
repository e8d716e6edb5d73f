"""Aligning a textured surface with a picture, compiled.

The surface is n points X in the mask's frame with their grey values T and the gradients g of
those values (grey values a millimetre, along the mask's axes). Moving the surface by a small
turn w and shift v shows the picture

    T(X + w x X + v) = T + (X x g) . w + g . v,

so one row of the Jacobian is (X x g, g): it belongs to the mask and stays while the head moves
(inverse compositional). Each region of the surface has a light of its own: a gain that changes
evenly across and down and with the surface's slope, and an offset. A picture that is blurred more,
or less, than the texture differs from it by some of the texture's Laplacian, and that is a
region's too. All are solved for together with the motion.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

Single = npt.NDArray[np.float32]
Double = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

TUKEY: Final = 4.685
"""Residuals beyond so many standard deviations have no weight (95 % efficiency for noise)."""

BORDER: Final = 2
"""Pixels at a picture's edge that nothing is read from."""

SPREAD: Final = 30.0
"""mm: what makes turns as large as shifts in the equations."""

BRIGHT: Final = 100.0
"""Grey values: what makes an offset as large as a gain."""

PLACES: Final = 4
"""Numbers that say where a point lies in its region and how it is turned."""

BLUR: Final = 1 + PLACES
"""Place of the blur among a region's numbers."""

LIGHTS: Final = BLUR + 2
"""Numbers that a region's light has: a gain, its changes with place and slope, a blur (what it
adds of the texture's curvature), an offset."""

RESIDUAL: Final = 6 + LIGHTS
"""Column of the residual behind those of motion and light."""

WIDTH: Final = RESIDUAL + 1
"""Columns in all."""

LEAST_POINTS: Final = 60
"""Points that must be seen."""


@njit(cache=True, nogil=True, forceinline=True)
def _cubic(picture: Single, x: float, y: float) -> float:
    """Value between pixels, by Catmull-Rom splines; at least `BORDER` inside."""
    j, i = int(x), int(y)
    u, v = np.float32(x - j), np.float32(y - i)
    half = np.float32(0.5)
    a0 = half * u * (u * (np.float32(2.0) - u) - np.float32(1.0))
    a1 = half * (u * u * (np.float32(3.0) * u - np.float32(5.0)) + np.float32(2.0))
    a2 = half * u * (u * (np.float32(4.0) - np.float32(3.0) * u) + np.float32(1.0))
    a3 = half * u * u * (u - np.float32(1.0))
    b0 = half * v * (v * (np.float32(2.0) - v) - np.float32(1.0))
    b1 = half * (v * v * (np.float32(3.0) * v - np.float32(5.0)) + np.float32(2.0))
    b2 = half * v * (v * (np.float32(4.0) - np.float32(3.0) * v) + np.float32(1.0))
    b3 = half * v * v * (v - np.float32(1.0))
    p, q, r, s = picture[i - 1], picture[i], picture[i + 1], picture[i + 2]
    value: float = (
        b0 * (a0 * p[j - 1] + a1 * p[j] + a2 * p[j + 1] + a3 * p[j + 2])
        + b1 * (a0 * q[j - 1] + a1 * q[j] + a2 * q[j + 1] + a3 * q[j + 2])
        + b2 * (a0 * r[j - 1] + a1 * r[j] + a2 * r[j + 1] + a3 * r[j + 2])
        + b3 * (a0 * s[j - 1] + a1 * s[j] + a2 * s[j + 1] + a3 * s[j + 2])
    )
    return value


@njit(cache=True, nogil=True)
def sample_points(
    picture: Single, camera: Double, pose: Double, points: Single, values: Single, gradient: Single
) -> int:
    """Read a picture, and its gradient along the mask's axes, where the surface's points are seen.

    Parameters
    ----------
    picture : (h, w) float32
    camera : (3,) float64
        Focal length and principal point of this picture, pixels.
    pose : (3, 4) float64
    points : (n, 3) float32
    values : (n,) float32
        Filled; NaN outside the picture.
    gradient : (n, 3) float32
        Filled, or left alone if it has no rows.

    Returns
    -------
    int
        Points inside the picture.
    """
    h, w = picture.shape
    f, cx, cy = camera[0], camera[1], camera[2]
    step = 0.5
    inside = 0
    for i in range(points.shape[0]):
        px, py, pz = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        x = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz + pose[0, 3]
        y = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz + pose[1, 3]
        z = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz + pose[2, 3]
        u, v = f * x / z + cx, f * y / z + cy
        margin = BORDER + step
        if not (margin <= u < w - 1 - margin and margin <= v < h - 1 - margin):
            values[i] = np.nan
            continue
        inside += 1
        values[i] = _cubic(picture, u, v)
        if gradient.shape[0]:
            du = (_cubic(picture, u + step, v) - _cubic(picture, u - step, v)) / (2 * step)
            dv = (_cubic(picture, u, v + step) - _cubic(picture, u, v - step)) / (2 * step)
            # Through the projection into the camera's frame, then turned into the mask's.
            gx, gy = du * f / z, dv * f / z
            gz = -(gx * x + gy * y) / z
            for k in range(3):
                gradient[i, k] = pose[0, k] * gx + pose[1, k] * gy + pose[2, k] * gz
    return inside


@njit(cache=True, nogil=True)
def _scale(residuals: Single, some: Single) -> float:
    """Standard deviation of most residuals, from the median of a sample of their sizes."""
    n = 0
    step = max(1, residuals.shape[0] // some.shape[0])
    for i in range(0, residuals.shape[0], step):
        r = residuals[i]
        if n < some.shape[0] and not math.isnan(r):
            some[n] = abs(r)
            n += 1
    if n == 0:
        return 0.0
    return 1.4826 * float(np.partition(some[:n], n // 2)[n // 2])


@njit(cache=True, nogil=True)
def _turn(w: Double) -> Double:
    """Rotation matrix of a rotation vector (Rodrigues), (3, 3)."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    out: Double = np.eye(3)
    k = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-12:
        out += k
        return out
    out += math.sin(angle) / angle * k
    out += (1 - math.cos(angle)) / (angle * angle) * (k @ k)
    return out


@njit(cache=True, nogil=True)
def _solve(matrix: Double, right: Double) -> bool:
    """Solve a positive definite system in place (Cholesky); False if it is not one."""
    n = right.shape[0]
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not (0.0 < pivot < np.inf):
            return False
        pivot = math.sqrt(pivot)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / pivot
        total = right[j]
        for k in range(j):
            total -= matrix[j, k] * right[k]
        right[j] = total / pivot
    for j in range(n - 1, -1, -1):
        total = right[j]
        for k in range(j + 1, n):
            total -= matrix[k, j] * right[k]
        right[j] = total / matrix[j, j]
    return True


@njit(cache=True, nogil=True, forceinline=True)
def _gain(light: Double, r: int, place: Single, i: int) -> float:
    gain: float = light[r, 0]
    for k in range(PLACES):
        gain += light[r, 1 + k] * place[i, k]
    return gain


@njit(cache=True, nogil=True)
def _residuals(
    values: Single,
    texture: Single,
    curvature: Single,
    certainty: Single,
    region: Index,
    place: Single,
    light: Double,
    residual: Single,
) -> int:
    """Fill in how values differ from the lit texture, times certainty; NaN where unknown."""
    seen = 0
    for i in range(values.shape[0]):
        if certainty[i] <= 0 or math.isnan(values[i]):
            residual[i] = np.nan
            continue
        seen += 1
        r = region[i]
        shown = _gain(light, r, place, i) * texture[i] + light[r, LIGHTS - 1]
        shown += light[r, BLUR] * curvature[i]
        residual[i] = (values[i] - shown) * certainty[i]
    return seen


@njit(cache=True, nogil=True)
def _likeness(values: Single, residual: Single, certainty: Single) -> float:
    """Correlation of values with the lit texture, weighted by certainty; nothing left out."""
    w = a = b = aa = bb = ab = 0.0
    for i in range(values.shape[0]):
        if math.isnan(residual[i]):
            continue
        c = certainty[i] * certainty[i]
        one = np.float64(values[i])
        two = one - residual[i] / certainty[i]
        w += c
        a += c * one
        b += c * two
        aa += c * one * one
        bb += c * two * two
        ab += c * one * two
    if w <= 0:
        return 0.0
    spread = (aa - a * a / w) * (bb - b * b / w)
    return (ab - a * b / w) / math.sqrt(spread) if spread > 0 else 0.0


@njit(cache=True, nogil=True)
def _sum_up(
    residual: Single,
    cut: float,
    points: Single,
    region: Index,
    place: Single,
    texture: Single,
    curvature: Single,
    gradient: Single,
    certainty: Single,
    light: Double,
    sums: Double,
) -> float:
    """Products of the Jacobian's rows, of the light's and of the residual, robustly weighted.

    Parameters
    ----------
    sums : (regions, WIDTH, WIDTH) float64
        Filled, a sum for each region: rows and columns are motion (6), light (`LIGHTS`) and the
        residual; of equal products only those on and right of the diagonal.

    Returns
    -------
    float
        Sum of the robust weights.
    """
    row = np.zeros(WIDTH)
    sums[:] = 0.0
    kept = 0.0
    for i in range(points.shape[0]):
        e = residual[i]
        if math.isnan(e) or abs(e) >= cut:
            continue
        q = e / cut
        robust = (1 - q * q) ** 2
        kept += robust
        r = region[i]
        c = certainty[i]
        t = texture[i]
        a = _gain(light, r, place, i)
        gx, gy, gz = a * gradient[i, 0], a * gradient[i, 1], a * gradient[i, 2]
        x, y, z = points[i, 0] / SPREAD, points[i, 1] / SPREAD, points[i, 2] / SPREAD
        row[0], row[1], row[2] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
        row[3], row[4], row[5] = gx, gy, gz
        row[6] = t
        for k in range(PLACES):
            row[7 + k] = t * place[i, k]
        row[6 + BLUR] = curvature[i]
        row[RESIDUAL - 1] = BRIGHT
        row[RESIDUAL] = e / c
        weight = robust * c * c
        total = sums[r]
        for j in range(RESIDUAL):
            s = weight * row[j]
            for k in range(j, WIDTH):
                total[j, k] += s * row[k]
    return kept


@njit(cache=True, nogil=True)
def _assemble(sums: Double, normal: Double, right: Double) -> None:
    """Normal equations of the motion and every region's light, from `_sum_up`."""
    normal[:] = 0.0
    right[:] = 0.0
    for r in range(sums.shape[0]):
        at = 6 + LIGHTS * r
        for j in range(RESIDUAL):
            to = j if j < 6 else at + j - 6
            for k in range(j, RESIDUAL):
                # Only the lower triangle, which is all that `_solve` reads.
                normal[k if k < 6 else at + k - 6, to] += sums[r, j, k]
            right[to] += sums[r, j, RESIDUAL]
    for j in range(right.shape[0]):
        # A region that is not seen leaves its light alone.
        normal[j, j] += 1e-6 * normal[j, j] + 1e-6


@njit(cache=True, nogil=True)
def fit_pose(
    picture: Single,
    camera: Double,
    pose: Double,
    points: Single,
    region: Index,
    place: Single,
    texture: Single,
    curvature: Single,
    gradient: Single,
    certainty: Single,
    light: Double,
    noise: float,
    steps: int,
    enough: float,
    report: Double,
) -> int:
    """Move a pose, in place, to where the surface looks like the picture.

    Gauss-Newton on Tukey's robust error of the grey values, weighted by how certain each is.

    Parameters
    ----------
    picture, camera, pose, points
        As for `sample_points`; the pose is changed.
    region : (n,) int64
        Region of each point.
    place : (n, PLACES) float32
        What a point's light depends on, about -1 to 1 in its region.
    texture, curvature, gradient : (n,), (n,), (n, 3) float32
        Grey values, their Laplacian in the picture (pixels), and their gradient.
    certainty : (n,) float32
        One over the standard deviation of a point's grey value; 0 leaves the point out.
    light : (regions, LIGHTS) float64
        Of each region: gain, its changes with place, blur, and offset; the start, changed in
        place.
    noise : float
        Least standard deviation of residuals, in units of `certainty`.
    steps : int
        Most Gauss-Newton steps.
    enough : float
        Ends once a step moves no point by more than about so many pixels.
    report : (3,) float64
        Filled, as of the last step's start, with the scale of the residuals, the share of weight
        that the robust error leaves and the correlation of the picture with the lit texture
        (certain points, not robust).

    Returns
    -------
    int
        Steps taken; -1 if the surface is not seen or the equations are singular.
    """
    n, regions = points.shape[0], light.shape[0]
    values = np.empty(n, np.float32)
    residual = np.empty(n, np.float32)
    some = np.empty(400, np.float32)
    none = np.empty((0, 3), np.float32)
    sums = np.empty((regions, WIDTH, WIDTH))
    size = 6 + LIGHTS * regions
    normal = np.empty((size, size))
    move = np.empty(size)
    certain = 0
    for i in range(n):
        certain += certainty[i] > 0
    for step in range(steps):
        sample_points(picture, camera, pose, points, values, none)
        seen = _residuals(values, texture, curvature, certainty, region, place, light, residual)
        if seen < 0.3 * certain or seen < LEAST_POINTS:
            return -1
        scale = max(_scale(residual, some), noise)
        kept = _sum_up(
            residual,
            TUKEY * scale,
            points,
            region,
            place,
            texture,
            curvature,
            gradient,
            certainty,
            light,
            sums,
        )
        report[0], report[1] = scale, kept / seen
        report[2] = _likeness(values, residual, certainty)
        _assemble(sums, normal, move)
        if not _solve(normal, move):
            return -1
        for r in range(regions):
            at = 6 + LIGHTS * r
            for k in range(LIGHTS - 1):
                light[r, k] += move[at + k]
            light[r, LIGHTS - 1] += BRIGHT * move[at + LIGHTS - 1]
        # The picture shows the surface moved by `move`: the pose lacks its inverse.
        turn = _turn(-move[:3] / SPREAD)
        shift = -(turn @ move[3:6].copy())
        whole_turn = np.ascontiguousarray(pose[:, :3])
        pose[:, 3] += whole_turn @ shift
        pose[:, :3] = whole_turn @ turn
        pixels = camera[0] / max(pose[2, 3], 1.0)
        reach = 2 * math.sqrt(move[0] ** 2 + move[1] ** 2 + move[2] ** 2)
        reach += math.sqrt(move[3] ** 2 + move[4] ** 2) + 0.1 * abs(move[5])
        if reach * pixels < enough:
            return step + 1
    return steps
