"""Edges of lips and lids in one photo: found across curves that are expected near them.

What is looked at is a crop in which the mouth or the eye lies level and is `PIXELS` wide; lengths
are in parts of that. Across each expected curve places are tried, and the path of best places that
stays smooth and near the expected one is found (dynamic programming). An edge is where what tells
inside from outside changes most, which each photo says itself: the discriminant (Fisher's) of
brightness and colour between what lies inside the expected edges and the skin around.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

F64 = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]

PIXELS: Final = 200
"""Width at which a mouth or an eye is looked at."""

CROP: Final = (340, 260)

SAMPLES: Final = 41
"""Places along a curve from corner to corner."""

STEP: Final = 0.0025
"""Between the places tried across a curve."""

DARK: Final = 8.0
"""Levels added before the logarithm, so that noise in the dark does not count."""


@dataclass(frozen=True)
class EdgeSettings:
    """How far edges are moved, and what for; lengths in parts of the crop's width.

    Parameters
    ----------
    reach : float
        Farthest place tried on each side.
    window : float
        Depth on each side of an edge over which inside and outside are compared.
    spread : float
        Standard deviation of the error that is expected.
    modesty : float
        Weight against a place far from the expected one.
    stiffness : float
        Weight against a curve that bends away from the expected one.
    seam_trust, edge_trust : float
        Weight of what is seen, for the line between the lips and for the edges.
    """

    reach: float = 0.08
    window: float = 0.035
    spread: float = 0.03
    modesty: float = 0.3
    stiffness: float = 20.0
    seam_trust: float = 1.5
    edge_trust: float = 4.0


def upright(left: F64, right: F64) -> F64:
    """(2, 3) map of the picture to a crop in which the line between two corners is level."""
    along = right - left
    x, y = along * (PIXELS / (along @ along))
    turn = np.array([[x, y], [-y, x]])
    return np.column_stack([turn, np.array(CROP) / 2 - turn @ (left + right) / 2])


def level_crop(picture: UInt8Array, to_crop: F64) -> F64:
    """Logarithms of a picture's levels in the crop of `upright`, (h, w, 3)."""
    scale = float(np.hypot(*to_crop[0, :2]))
    seen = picture if scale >= 1 else cv2.GaussianBlur(picture, (0, 0), 0.45 / scale)
    cut = cv2.warpAffine(
        seen, to_crop, CROP, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(np.log(np.asarray(cut, dtype=np.float64) + DARK))


def moved_points(points: npt.NDArray[np.floating], by: npt.NDArray[Any]) -> F64:
    """Points under a (2, 3) map."""
    return np.asarray(np.asarray(points) @ by[:, :2].T + by[:, 2], dtype=np.float64)


def back(points: F64, to_crop: F64) -> F64:
    """Points of the crop in the picture."""
    return moved_points(points, np.asarray(cv2.invertAffineTransform(to_crop)))


def spread(points: F64) -> F64:
    """A smooth curve through points, evenly sampled along it, (SAMPLES, 2)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.concatenate([[0], np.cumsum(steps)])
    curve = CubicSpline(length, points)
    return np.asarray(curve(np.linspace(0, length[-1], SAMPLES)))


def across(curve: F64) -> F64:
    """Unit vectors across a curve that goes right, upwards."""
    along = np.gradient(curve, axis=0)
    up = np.column_stack([along[:, 1], -along[:, 0]])
    return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))


def lifted(curve: F64, up: npt.NDArray[np.floating]) -> F64:
    """A curve of the crop moved upwards across itself, by parts of `PIXELS` at each place."""
    return np.asarray(curve + across(curve) * (np.asarray(up) * PIXELS)[:, None])


def values_across(image: F64, curve: F64, offsets: npt.NDArray[np.floating]) -> F64:
    """Values of an image at offsets upwards across a curve, (SAMPLES, offsets)."""
    places = curve[:, None] + across(curve)[:, None] * (offsets * PIXELS)[:, None]
    x, y = (np.ascontiguousarray(places[..., k], dtype=np.float32) for k in (0, 1))
    seen = cv2.remap(
        image.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(seen, dtype=np.float64)


def offsets_of(settings: EdgeSettings) -> F64:
    """The offsets that are tried."""
    n = round(settings.reach / STEP)
    return np.asarray(np.arange(-n, n + 1) * STEP)


def best_path(cost: F64, settings: EdgeSettings) -> F64:
    """Offsets of the cheapest path, bends and distance paid for, (SAMPLES,).

    Parameters
    ----------
    cost : (SAMPLES, offsets) float64
        Of what is seen at `offsets_of` across each place.
    settings : EdgeSettings
    """
    offsets = offsets_of(settings)
    bend = settings.stiffness * ((offsets[:, None] - offsets) / settings.spread) ** 2
    cost = cost + settings.modesty * (offsets / settings.spread) ** 2
    total, came = cost[0], []
    for row in cost[1:]:
        through = total[:, None] + bend
        came.append(through.argmin(axis=0))
        total = through.min(axis=0) + row
    at = [int(total.argmin())]
    for before in reversed(came):
        at.append(int(before[at[-1]]))
    return np.asarray(offsets[at[::-1]])


def insideness(light: F64, upper: F64, lower: F64, *, core: float = 0.025) -> F64:
    """How much each pixel looks like what lies between two curves and not like the skin around.

    Parameters
    ----------
    light : (h, w, 3) float64
        `level_crop`.
    upper, lower : (SAMPLES, 2) float64
        From corner to corner.
    core : float
        How far inside the curves pixels count as certain, in parts of `PIXELS`.

    Returns
    -------
    (h, w) float64
        Inside and outside are 1 apart on the average.
    """
    red, green, blue = (light[..., k] for k in range(3))
    features = np.stack([light.mean(axis=2), red - green, green - blue], axis=-1)
    features = np.asarray(cv2.GaussianBlur(features, (0, 0), 1.0), dtype=np.float64)
    outline = np.rint(np.concatenate([upper, lower[::-1]])).astype(np.int32)
    between = np.zeros(light.shape[:2], np.uint8)
    cv2.fillPoly(between, [outline], 1)
    inside = cv2.erode(between, _disc(core)) > 0
    if not inside.any():
        inside = between > 0
    near = cv2.dilate(between, _disc(0.05))
    around = (cv2.dilate(between, _disc(0.15)) > 0) & (near == 0)
    a, b = features[inside], features[around]
    within = (np.cov(a.T) + np.cov(b.T)) / 2
    within += (0.07 * np.trace(within) + 1e-6) * np.eye(3)
    apart = a.mean(axis=0) - b.mean(axis=0)
    direction = np.linalg.solve(within, apart)
    return np.asarray(features @ direction / max(float(direction @ apart), 1e-9))


def _disc(radius: float) -> npt.NDArray[Any]:
    size = 2 * round(radius * PIXELS) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))


def on_edge(inner: F64, edge: F64, side: int, settings: EdgeSettings) -> F64:
    """The edge near an expected one.

    Parameters
    ----------
    inner : (h, w) float64
        `insideness`.
    edge : (SAMPLES, 2) float64
        The expected one.
    side : int
        1 where the inside lies below it, -1 where above.
    settings : EdgeSettings
    """
    n = len(offsets_of(settings))
    depth = round(settings.window / STEP)
    reach = (np.arange(n + 2 * depth) - (n // 2 + depth - 0.5)) * STEP
    seen = values_across(inner, edge, reach)
    heaped = np.concatenate([np.zeros((SAMPLES, 1)), np.cumsum(seen, axis=1)], axis=1)
    means = (heaped[:, depth:] - heaped[:, :-depth]) / depth
    below, above = means[:, :n], means[:, depth : depth + n]
    return lifted(edge, best_path(-settings.edge_trust * side * (below - above), settings))
