"""The lids of one photo, found more truly than the face mesh has them.

The mesh has eyes less open than they are: left so, a lid that comes down would carry a strip of
the eye with it. Its mean error is taken out, then each lid is moved to the edge that the photo
shows (`analysis.portrait_edges`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.portrait_edges import (
    SAMPLES,
    EdgeSettings,
    back,
    insideness,
    level_crop,
    lifted,
    moved_points,
    on_edge,
    spread,
    upright,
)

F64 = npt.NDArray[np.float64]

LID_EDGES: Final = EdgeSettings(
    reach=0.08, window=0.03, spread=0.03, modesty=0.5, stiffness=10.0, edge_trust=8.0
)
"""Lengths in eye widths."""

MARGIN: Final = (0.015, 0.025)
"""Eye widths beyond the upper and the lower edge, on the lashes' roots: better too much of a lid
than of an eye."""

_OUTER_CORNER: Final = (0.055, 0.02)
_INNER_CORNER: Final = (0.025, 0.055)
"""Towards the nose and down: where the corners are, seen from the mesh's."""

_UPPER_ERROR: Final = (0.0, 0.044, 0.053, 0.010, 0.0)
_LOWER_ERROR: Final = (0.0, -0.029, -0.012, 0.020, 0.0)
"""From the outer corner to the inner one: how far up the true lid lies, across the mesh's. The
medians over thirty marked faces of the London set (DeBruine and Jones), both eyes."""


def find_lids(
    picture: npt.NDArray[np.uint8],
    upper: npt.NDArray[np.floating],
    lower: npt.NDArray[np.floating],
    *,
    outer_first: bool,
    settings: EdgeSettings = LID_EDGES,
) -> tuple[F64, F64]:
    """Find both lids of an eye.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    upper, lower : (n, 2) float
        The mesh's lids, each from the left corner to the right one, corners included.
    outer_first : bool
        Whether the left corner is the outer one.
    settings : EdgeSettings, optional

    Returns
    -------
    upper, lower : (SAMPLES, 2) float64
        In the picture's pixels.
    """
    left, right = (np.asarray(upper[k], dtype=np.float64) for k in (0, -1))
    along = right - left
    down = np.array([-along[1], along[0]])
    nose = 1 if outer_first else -1
    first, last = (_OUTER_CORNER, _INNER_CORNER)[::nose]
    left, right = (
        corner + nose * inwards * along + below * down
        for corner, (inwards, below) in ((left, first), (right, last))
    )
    # The lids go where their corners go.
    was = upright(*(np.asarray(upper[k], dtype=np.float64) for k in (0, -1)))
    to_crop = upright(left, right)
    light = level_crop(picture, to_crop)
    expected = [
        lifted(spread(moved_points(lid, was)), _error(error, outer_first))
        for lid, error in ((upper, _UPPER_ERROR), (lower, _LOWER_ERROR))
    ]
    eyeness = insideness(light, *expected, core=0.01)
    # At the corners the lids are one, and no edge is seen.
    share = np.clip(6 * (0.5 - np.abs(np.linspace(-0.5, 0.5, SAMPLES))), 0, 1)
    found = []
    for lid, side, margin in zip(expected, (1, -1), MARGIN, strict=True):
        seen = on_edge(eyeness, lid, side, settings)
        lid = lid + share[:, None] * (seen - lid)
        found.append(back(lifted(lid, side * margin * share), to_crop))
    return found[0], found[1]


def _error(error: tuple[float, ...], outer_first: bool) -> F64:
    values = np.array(error if outer_first else error[::-1])
    return np.asarray(np.interp(np.linspace(0, 1, SAMPLES), np.linspace(0, 1, len(values)), values))
