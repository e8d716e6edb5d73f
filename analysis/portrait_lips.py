"""The lips of one photo, found more truly than the face mesh has them.

The mesh's lips err in much the same way on most people: its corners lie too high, its lower lip
ends too early. That mean error is taken out first. Then each of three curves from corner to
corner, the line between the lips, the upper edge and the lower edge, is moved to where this photo
shows it: across each curve places are tried, and the path of best places that stays smooth and
near the expected one is found (dynamic programming). The line between the lips is where it is
darkest. An edge is where what tells lips from skin changes most, which each photo says itself: the
discriminant (Fisher's) of brightness and redness between what lies inside the expected edges and
the skin around.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

F64 = npt.NDArray[np.float64]

MOUTH_PIXELS: Final = 200
"""Width of the mouth at which it is looked at; all lengths below are in mouth widths."""

CROP: Final = (340, 260)

SAMPLES: Final = 41
"""Places along a curve from corner to corner."""

STEP: Final = 0.0025
"""Between the places tried across a curve."""

MEETING: Final = 4
"""Places over which an edge runs into its corner."""

_CORNER_ERROR: Final = (0.003, 0.0185)
"""Outwards and down: where the left corner is, seen from the mesh's."""

_SEAM_ERROR: Final = (-0.040, -0.042, -0.036, -0.027, -0.020, -0.014, -0.010, -0.010, -0.012,
                      -0.015, -0.017)  # fmt: skip
_UPPER_ERROR: Final = (-0.052, -0.057, -0.054, -0.048, -0.042, -0.032, -0.026, -0.024, -0.022,
                       -0.023, -0.023)  # fmt: skip
_LOWER_ERROR: Final = (0.0, -0.001, -0.017, -0.024, -0.021, -0.018, -0.018, -0.018, -0.020,
                       -0.020, -0.019)  # fmt: skip
"""From the left corner to the middle: how far up the true curve lies, across the mesh's. The
medians over thirty marked faces of the London set (DeBruine and Jones), made symmetric."""


@dataclass(frozen=True)
class LipEdgeSettings:
    """How far lips are moved, and what for; lengths in mouth widths.

    Parameters
    ----------
    reach : float
        Farthest place tried on each side.
    window : float
        Depth on each side of an edge over which lips and skin are compared.
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


@dataclass(frozen=True)
class LipCurves:
    """Three curves from the left corner of the mouth to the right one.

    Parameters
    ----------
    upper, seam, lower : (SAMPLES, 2) float64
        Upper edge, the line between the lips, lower edge; pixels.
    """

    upper: F64
    seam: F64
    lower: F64


def curves_of(contours: npt.NDArray[np.floating]) -> LipCurves:
    """Curves through 40 contour points, the seam in the middle of the inner contours.

    Parameters
    ----------
    contours : (40, 2) float
        Outer then inner contour, in the order of `database.mask.OUTER_LIPS`.
    """
    points = np.asarray(contours, dtype=np.float64)
    outer, inner = points[:20], points[20:]

    def halves(contour: F64) -> tuple[F64, F64]:
        return _spread(contour[:11]), _spread(np.concatenate([contour[:1], contour[:9:-1]]))

    upper, lower = halves(outer)
    above, below = halves(inner)
    return LipCurves(upper, (above + below) / 2, lower)


def find_lips(
    picture: npt.NDArray[np.uint8],
    contours: npt.NDArray[np.floating],
    settings: LipEdgeSettings | None = None,
) -> LipCurves:
    """Find the lips of a closed mouth.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    contours : (40, 2) float
        The face mesh's lips in the picture, outer then inner contour.
    settings : LipEdgeSettings, optional

    Returns
    -------
    LipCurves
        In the picture's pixels.
    """
    chosen = settings or LipEdgeSettings()
    to_crop = _upright(np.asarray(contours, dtype=np.float64))
    crop = _cut(picture, to_crop)
    expected = _unbiased(curves_of(_moved(contours, to_crop)))
    light = np.log(crop.astype(np.float64) + 8)
    brightness = light.mean(axis=2)
    seam = _on_dark_line(brightness, expected.seam, chosen)
    # What the seam was moved by, the edges are expected to be moved by too, in part.
    shift = (seam - expected.seam)[:, 1:] * [0, 1]
    ends = np.abs(np.linspace(-1, 1, SAMPLES))[:, None] ** 2
    upper, lower = (c + shift * (0.5 + 0.5 * ends) for c in (expected.upper, expected.lower))
    lipness = _lipness(light, upper, lower)
    upper = _on_edge(lipness, upper, 1, chosen)
    lower = _on_edge(lipness, lower, -1, chosen)
    upper, lower = _met(upper, seam), _met(lower, seam)
    back = cv2.invertAffineTransform(to_crop)
    return LipCurves(*(_moved(c, back) for c in (upper, seam, lower)))


def _upright(contours: F64) -> F64:
    """(2, 3) map of the picture to a crop in which the mouth is level and of known width."""
    left, right = contours[0], contours[10]
    along = right - left
    x, y = along * (MOUTH_PIXELS / (along @ along))
    turn = np.array([[x, y], [-y, x]])
    return np.column_stack([turn, np.array(CROP) / 2 - turn @ (left + right) / 2])


def _cut(picture: npt.NDArray[np.uint8], to_crop: F64) -> npt.NDArray[np.uint8]:
    scale = float(np.hypot(*to_crop[0, :2]))
    seen = picture
    if scale < 1:
        # Only around the mouth: photos are large.
        seen = cv2.GaussianBlur(picture, (0, 0), 0.45 / scale)
    cut = cv2.warpAffine(
        seen, to_crop, CROP, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(cut, dtype=np.uint8)


def _moved(points: npt.NDArray[np.floating], by: npt.NDArray[np.floating]) -> F64:
    return np.asarray(np.asarray(points) @ by[:, :2].T + by[:, 2], dtype=np.float64)


def _spread(points: F64) -> F64:
    """A smooth curve through points, evenly sampled along it, (SAMPLES, 2)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.concatenate([[0], np.cumsum(steps)])
    curve = CubicSpline(length, points)
    return np.asarray(curve(np.linspace(0, length[-1], SAMPLES)))


def _normals(curve: F64) -> F64:
    """Unit vectors across a curve that goes right, upwards."""
    along = np.gradient(curve, axis=0)
    up = np.column_stack([along[:, 1], -along[:, 0]])
    return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))


def _unbiased(curves: LipCurves) -> LipCurves:
    """The curves without the mesh's mean error."""

    def put_right(curve: F64, error: tuple[float, ...], corner: bool) -> F64:
        half = np.linspace(0, 1, len(error))
        place = 1 - np.abs(np.linspace(-1, 1, SAMPLES))
        up = np.interp(place, half, error) * MOUTH_PIXELS
        moved = curve + _normals(curve) * up[:, None]
        if corner:
            out, down = np.array(_CORNER_ERROR) * MOUTH_PIXELS
            moved[0], moved[-1] = curve[0] + (-out, down), curve[-1] + (out, down)
        return moved

    return LipCurves(
        put_right(curves.upper, _UPPER_ERROR, True),
        put_right(curves.seam, _SEAM_ERROR, False),
        put_right(curves.lower, _LOWER_ERROR, True),
    )


def _across(image: F64, curve: F64, offsets: F64) -> F64:
    """Values of an image at offsets (mouth widths, upwards) across a curve, (SAMPLES, offsets)."""
    places = curve[:, None] + _normals(curve)[:, None] * (offsets * MOUTH_PIXELS)[:, None]
    x, y = (np.ascontiguousarray(places[..., k], dtype=np.float32) for k in (0, 1))
    seen = cv2.remap(
        image.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(seen, dtype=np.float64)


def _offsets(settings: LipEdgeSettings) -> F64:
    n = round(settings.reach / STEP)
    return np.arange(-n, n + 1) * STEP


def _best_path(cost: F64, offsets: F64, settings: LipEdgeSettings) -> F64:
    """Offsets of the cheapest path through (SAMPLES, offsets), bends paid for."""
    bend = settings.stiffness * ((offsets[:, None] - offsets) / settings.spread) ** 2
    cost = cost + settings.modesty * (offsets / settings.spread) ** 2
    total, came = cost[0], []
    for row in cost[1:]:
        through = total[:, None] + bend
        came.append(through.argmin(axis=0))
        total = through.min(axis=0) + row
    at = [int(total.argmin())]
    for back in reversed(came):
        at.append(int(back[at[-1]]))
    return np.asarray(offsets[at[::-1]])


def _on_dark_line(brightness: F64, seam: F64, settings: LipEdgeSettings) -> F64:
    """The darkest line near an expected one."""
    offsets = _offsets(settings)
    fine = cv2.GaussianBlur(brightness, (0, 0), 1.2)
    # Dark against what is above and below, so that shaded lower lips do not count.
    valley = fine - cv2.GaussianBlur(brightness, (0, 0), 8)
    seen = _across(valley, seam, offsets)
    scale = float(seen.std()) or 1.0
    path = _best_path(settings.seam_trust * seen / scale, offsets, settings)
    return np.asarray(seam + _normals(seam) * (path * MOUTH_PIXELS)[:, None])


def _met(edge: F64, seam: F64) -> F64:
    """An edge that ends in the corners, on the height of the line between the lips."""
    out = edge.copy()
    for corner, inwards in ((0, 1), (-1, -1)):
        end = out[corner].copy()
        line = seam[corner] - seam[corner + 4 * inwards]
        # The seam stops inside the corner: it is drawn on as it goes.
        end[1] = seam[corner, 1] + line[1] / (line[0] or 1) * (end[0] - seam[corner, 0])
        first = corner + MEETING * inwards
        for i in range(MEETING):
            at = corner + i * inwards
            t = (out[at, 0] - out[first, 0]) / ((end[0] - out[first, 0]) or 1)
            on_chord = out[first, 1] + t * (end[1] - out[first, 1])
            out[at, 1] = t * on_chord + (1 - t) * out[at, 1]
        out[corner] = end
    return out


def _lipness(light: F64, upper: F64, lower: F64) -> F64:
    """How much each pixel looks like lips and not like skin, (h, w); 1 apart on the average."""
    height, width = light.shape[:2]
    features = np.stack([light.mean(axis=2), light[..., 0] - light[..., 1]], axis=-1)
    features = cv2.GaussianBlur(features, (0, 0), 1.0)
    outline = np.rint(np.concatenate([upper, lower[::-1]])).astype(np.int32)
    inside = np.zeros((height, width), np.uint8)
    cv2.fillPoly(inside, [outline], 1)
    size = round(0.05 * MOUTH_PIXELS)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * size + 1, 2 * size + 1))
    lips = cv2.erode(inside, disc[size // 2 : -size // 2, size // 2 : -size // 2]) > 0
    ring = (cv2.dilate(inside, disc, iterations=3) > 0) & (cv2.dilate(inside, disc) == 0)
    a, b = features[lips], features[ring]
    within = (np.cov(a.T) + np.cov(b.T)) / 2
    within += 0.1 * np.trace(within) / 2 * np.eye(2) + 1e-6 * np.eye(2)
    apart = a.mean(axis=0) - b.mean(axis=0)
    direction = np.linalg.solve(within, apart)
    size_of = max(float(direction @ apart), 1e-9)
    return np.asarray(features @ direction / size_of)


def _on_edge(lipness: F64, edge: F64, inside: int, settings: LipEdgeSettings) -> F64:
    """The edge of the lips near an expected one; `inside` is 1 where the lips lie below it."""
    offsets = _offsets(settings)
    depth = round(settings.window / STEP)
    reach = np.arange(-len(offsets) // 2 - depth + 1, len(offsets) // 2 + depth + 1) * STEP
    seen = _across(lipness, edge, reach)
    heaped = np.concatenate([np.zeros((SAMPLES, 1)), np.cumsum(seen, axis=1)], axis=1)
    means = (heaped[:, depth:] - heaped[:, :-depth]) / depth
    below, above = means[:, : len(offsets)], means[:, depth : depth + len(offsets)]
    change = inside * (below - above)
    path = _best_path(-settings.edge_trust * change, offsets, settings)
    return np.asarray(edge + _normals(edge) * (path * MOUTH_PIXELS)[:, None])
