"""The Talk Mask laid over a photo's face (Image Talk, section 5.2), without a hand's touch.

Most vertices are the face mesh's. Lips and lids are those of `analysis.portrait_lips` and
`analysis.portrait_lids`, and what is around them moves along, less with distance. The rings
around the face are the generic mask's, stretched as the face is, and cut at the photo's edges.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.portrait_edges import EdgeSettings, spread
from analysis.portrait_lids import find_lids
from analysis.portrait_lips import LipCurves, curves_of, find_lips
from database.mask import INNER_LIPS as MESH_INNER
from database.mask import OUTER_LIPS as MESH_OUTER
from database.portrait_mesh import (
    FRAME,
    GENERIC,
    HEAD,
    INNER_CORNERS,
    INNER_LIPS,
    LEFT_EYE,
    LOWER_INNER,
    MESH_INDEX,
    MOUTH_CORNERS,
    N_MASK,
    OUTER_LIPS,
    RIGHT_EYE,
    SKIN_TRIANGLES,
    UPPER_INNER,
    Indices,
)
from database.talk_mask import TalkMask

F64 = npt.NDArray[np.float64]

OPEN: Final = 0.12
"""Distance of the mesh's inner lips, in mouth widths, from which a mouth counts as open. On closed
ones it may be 0.11: the mesh takes shine and shadow of full lips for their edges."""

THINNEST: Final = 0.012
"""Units: a lip is nowhere thinner than this, the corners' ends apart."""

FALLOFF: Final = 0.12
"""Units: how far around lips and eyes the skin follows when their points are put right."""

BEYOND: Final = 0.05
"""Units that the rings keep outside the face where the photo ends."""

_PLACED: Final = frozenset(np.concatenate([OUTER_LIPS, INNER_LIPS, LEFT_EYE, RIGHT_EYE]).tolist())

_HELD: Final = _PLACED | frozenset(FRAME.tolist())
_NEIGHBOURS: Final = [
    np.setdiff1d(SKIN_TRIANGLES[np.any(v == SKIN_TRIANGLES, axis=1)], [v]) for v in range(N_MASK)
]

ROUNDS: Final = 60
"""Times that folded triangles are eased, at most."""

LEAST_AREA: Final = 2e-5
"""Twice the least area of a triangle, units squared."""


def fit_mask(
    picture: npt.NDArray[np.uint8],
    mesh: npt.NDArray[np.floating],
    settings: EdgeSettings | None = None,
) -> TalkMask:
    """Lay the mask over a face.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    mesh : (468, 2 or 3) float
        Face mesh in the picture.
    settings : EdgeSettings, optional

    Returns
    -------
    TalkMask
    """
    points = np.asarray(mesh, dtype=np.float64)[:, :2]
    contours = points[[*MESH_OUTER, *MESH_INNER]]
    vertices = np.where(MESH_INDEX[:, None] >= 0, points[MESH_INDEX], np.nan)
    before = vertices.copy()
    curves = find_lips(picture, contours, settings)
    _place_lips(vertices, contours, curves, is_open(mesh))
    _place_lids(picture, vertices)
    unit = float(np.linalg.norm(points[263] - points[33]))
    _draw_along(vertices, before, OUTER_LIPS, unit)
    for eye in (LEFT_EYE, RIGHT_EYE):
        _draw_along(vertices, before, eye, unit)
    height, width = picture.shape[:2]
    _place_rings(vertices, width, height)
    _unfold(vertices, unit)
    return TalkMask(vertices, width, height)


def is_open(mesh: npt.NDArray[np.floating]) -> bool:
    """Whether the mouth of a face mesh is open."""
    points = np.asarray(mesh, dtype=np.float64)[:, :2]
    inner = points[list(MESH_INNER)]
    above, below = inner[1:10], inner[:10:-1]
    gap = np.linalg.norm(below - above, axis=1).max()
    return bool(gap > OPEN * np.linalg.norm(points[MESH_OUTER[10]] - points[MESH_OUTER[0]]))


def _place_lips(vertices: F64, contours: F64, curves: LipCurves, opened: bool) -> None:
    """Put the lips' vertices on the curves, each as far along as it was on the mesh's."""
    old = curves_of(contours)
    upper = np.concatenate([OUTER_LIPS[:11]])
    lower = np.concatenate([OUTER_LIPS[:1], OUTER_LIPS[:9:-1]])
    was = {int(v): vertices[v].copy() for v in (*OUTER_LIPS, *INNER_LIPS)}
    for row, before, after in ((upper, old.upper, curves.upper), (lower, old.lower, curves.lower)):
        vertices[row] = _along(np.array([was[int(v)] for v in row]), before, after)
    vertices[MOUTH_CORNERS] = (curves.upper[[0, -1]] + curves.lower[[0, -1]]) / 2
    if opened:
        _keep_inside(vertices, curves)
        return
    seam = np.stack([was[int(v)] for v in INNER_LIPS])
    above, below = seam[:9], np.concatenate([seam[:1], seam[:7:-1]])
    row = _along((above + below) / 2, old.seam, curves.seam)
    vertices[INNER_CORNERS] = row[[0, -1]]
    vertices[UPPER_INNER] = vertices[LOWER_INNER] = row[1:-1]
    _keep_inside(vertices, curves)


def _keep_inside(vertices: F64, curves: LipCurves) -> None:
    """Keep the inner lips apart from the outer edges, so that no triangle is turned over."""
    left, right = vertices[MOUTH_CORNERS]
    x = (right - left) / np.linalg.norm(right - left)
    frame = np.array([x, [-x[1], x[0]]])
    inner = (vertices[INNER_LIPS] - left) @ frame.T
    edges = [(c - left) @ frame.T for c in (curves.upper, curves.lower)]
    end = float(np.linalg.norm(right - left))
    thin = THINNEST / 0.55 * end
    inner[:, 0] = np.clip(inner[:, 0], 1.5 * thin, end - 1.5 * thin)
    above, below = (np.interp(inner[:, 0], e[:, 0], e[:, 1]) for e in edges)
    # Towards the corners the lips end, and so does what is kept of them.
    kept = np.minimum(thin, (below - above) / 3)
    inner[:, 1] = np.clip(inner[:, 1], above + kept, np.maximum(below - kept, above + kept))
    vertices[INNER_LIPS] = inner @ frame + left
    # The edges run into the corners above and below the line that ends there, not along it.
    for corner, inside, above_it, below_it in ((0, 20, 1, 19), (10, 28, 9, 11)):
        a, b = ((vertices[v] - left) @ frame.T for v in (corner, inside))
        for v, side in ((above_it, -1), (below_it, 1)):
            at = (vertices[v] - left) @ frame.T
            line = a[1] + (b[1] - a[1]) * (at[0] - a[0]) / (b[0] - a[0])
            at[1] = side * max(side * at[1], side * line + thin / 3)
            vertices[v] = at @ frame + left


def _along(points: F64, old: F64, new: F64) -> F64:
    """Points near one curve, moved to the same places along another."""
    axis = old[-1] - old[0]
    place = np.clip((points - old[0]) @ axis / (axis @ axis), 0, 1)
    axis = new[-1] - new[0]
    at = (new - new[0]) @ axis / (axis @ axis)
    return np.stack([np.interp(place, at, new[:, k]) for k in (0, 1)], axis=-1)


def _place_lids(picture: npt.NDArray[np.uint8], vertices: F64) -> None:
    """Put the lids' vertices on the lids, each as far along as it was on the mesh's."""
    for eye, outer_first in ((LEFT_EYE, True), (RIGHT_EYE, False)):
        upper, lower = eye[:8], np.concatenate([eye[:1], eye[:6:-1]])
        if not outer_first:
            upper, lower = upper[::-1], lower[::-1]
        old = vertices[upper].copy(), vertices[lower].copy()
        found = find_lids(picture, *old, outer_first=outer_first)
        for rows, was, curve in zip((upper, lower), old, found, strict=True):
            vertices[rows[1:-1]] = _along(was, spread(was), curve)[1:-1]
        vertices[upper[[0, -1]]] = (found[0][[0, -1]] + found[1][[0, -1]]) / 2


def _draw_along(vertices: F64, before: F64, source: Indices, unit: float) -> None:
    """Move what is around a contour as that was moved, less and less outwards.

    Lips, eyes and rings have their own places, and keep them.
    """
    moved = vertices[source] - before[source]
    for v in range(N_MASK):
        if MESH_INDEX[v] < 0 or v in _PLACED:
            continue
        away = np.linalg.norm(before[source] - before[v], axis=1) / unit
        nearest = float(away.min())
        near = np.exp(-(((away - nearest) / FALLOFF) ** 2))
        share = np.exp(-((nearest / FALLOFF) ** 2))
        vertices[v] += share * (near @ moved) / near.sum()


def _place_rings(vertices: F64, width: int, height: int) -> None:
    """The rings around the face, from the generic mask stretched over it."""
    known = MESH_INDEX >= 0
    model = np.column_stack([GENERIC, np.ones(N_MASK)])
    solved, *_ = np.linalg.lstsq(model[known], vertices[known], rcond=None)
    ring = np.concatenate([HEAD, FRAME])
    vertices[ring] = model[ring] @ solved
    unit = float(np.linalg.norm(solved[0]))
    face = vertices[known]
    # To the outer edges of the outer pixels.
    low = np.minimum(-0.5, face.min(axis=0) - BEYOND * unit)
    high = np.maximum((width - 0.5, height - 0.5), face.max(axis=0) + BEYOND * unit)
    vertices[ring] = np.clip(vertices[ring], low, high)


def _unfold(vertices: F64, unit: float) -> None:
    """Draw the far cheek of a face that is turned a little out from behind itself.

    Vertices of triangles that are turned over go towards the middle of their neighbours, round
    after round, until none is; lips, eyes and frame stay.
    """
    for _ in range(ROUNDS):
        a, b, c = (vertices[SKIN_TRIANGLES[:, k]] for k in range(3))
        u, v = b - a, c - a
        flat = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < LEAST_AREA * unit**2
        loose = [v for v in np.unique(SKIN_TRIANGLES[flat]).tolist() if v not in _HELD]
        if not loose:
            return
        places = [vertices[_NEIGHBOURS[v]].mean(axis=0) for v in loose]
        vertices[loose] = 0.5 * vertices[loose] + 0.5 * np.array(places)
