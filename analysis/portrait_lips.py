"""The lips of one photo, found more truly than the face mesh has them.

The mesh's lips err in much the same way on most people: its corners lie too high, its lower lip
ends too early. That mean error is taken out first. Then each of three curves from corner to
corner, the line between the lips, the upper edge and the lower edge, is moved to where this photo
shows it (`analysis.portrait_edges`); the line between the lips is where it is darkest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.portrait_edges import (
    PIXELS,
    SAMPLES,
    EdgeSettings,
    back,
    best_path,
    insideness,
    level_crop,
    lifted,
    moved_points,
    offsets_of,
    on_edge,
    spread,
    upright,
    values_across,
)

F64 = npt.NDArray[np.float64]

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
        return spread(contour[:11]), spread(np.concatenate([contour[:1], contour[:9:-1]]))

    upper, lower = halves(outer)
    above, below = halves(inner)
    return LipCurves(upper, (above + below) / 2, lower)


def find_lips(
    picture: npt.NDArray[np.uint8],
    contours: npt.NDArray[np.floating],
    settings: EdgeSettings | None = None,
) -> LipCurves:
    """Find the lips of a closed mouth.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    contours : (40, 2) float
        The face mesh's lips in the picture, outer then inner contour.
    settings : EdgeSettings, optional

    Returns
    -------
    LipCurves
        In the picture's pixels.
    """
    chosen = settings or EdgeSettings()
    points = np.asarray(contours, dtype=np.float64)
    to_crop = upright(points[0], points[10])
    light = level_crop(picture, to_crop)
    expected = _unbiased(curves_of(moved_points(points, to_crop)))
    seam = _on_dark_line(light.mean(axis=2), expected.seam, chosen)
    # What the seam was moved by, the edges are expected to be moved by too, in part.
    shift = (seam - expected.seam) * [0, 1]
    ends = np.abs(np.linspace(-1, 1, SAMPLES))[:, None] ** 2
    upper, lower = (c + shift * (0.5 + 0.5 * ends) for c in (expected.upper, expected.lower))
    lipness = insideness(light, upper, lower)
    upper = _met(on_edge(lipness, upper, 1, chosen), seam)
    lower = _met(on_edge(lipness, lower, -1, chosen), seam)
    return LipCurves(*(back(c, to_crop) for c in (upper, seam, lower)))


def _unbiased(curves: LipCurves) -> LipCurves:
    """The curves without the mesh's mean error."""

    def put_right(curve: F64, error: tuple[float, ...], corner: bool) -> F64:
        place = 1 - np.abs(np.linspace(-1, 1, SAMPLES))
        moved = lifted(curve, np.interp(place, np.linspace(0, 1, len(error)), error))
        if corner:
            out, down = np.array(_CORNER_ERROR) * PIXELS
            moved[0], moved[-1] = curve[0] + (-out, down), curve[-1] + (out, down)
        return moved

    return LipCurves(
        put_right(curves.upper, _UPPER_ERROR, True),
        put_right(curves.seam, _SEAM_ERROR, False),
        put_right(curves.lower, _LOWER_ERROR, True),
    )


def _on_dark_line(brightness: F64, seam: F64, settings: EdgeSettings) -> F64:
    """The darkest line near an expected one."""
    fine = cv2.GaussianBlur(brightness, (0, 0), 1.2)
    # Dark against what is above and below, so that shaded lower lips do not count.
    valley = np.asarray(fine - cv2.GaussianBlur(brightness, (0, 0), 8), dtype=np.float64)
    seen = values_across(valley, seam, offsets_of(settings))
    scale = float(seen.std()) or 1.0
    return lifted(seam, best_path(settings.seam_trust * seen / scale, settings))


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
