"""Overlays of lips on mouths that are open, closed, round and wide, to be looked at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from database.mask import OUTER_LIPS

OURS, MESH = (80, 255, 80), (255, 80, 80)
TALL = 450
"""Pixels of a tile's height."""


def write_overlays(
    path: Path,
    crops: npt.NDArray[np.uint8],
    ours: npt.NDArray[np.floating],
    mesh: npt.NDArray[np.floating],
) -> None:
    """Write a picture: four rows of mouths, the lip model in green and the face mesh in red.

    Parameters
    ----------
    path : Path
        PNG; its folder is made.
    crops : (n, h, w, 3) uint8
    ours, mesh : (n, 40, 2) float
        Contours, crop pixels.
    """
    outer = np.asarray(mesh)[:, : len(OUTER_LIPS)]
    width, height = (np.ptp(outer[..., k], axis=1) for k in (0, 1))
    rows = []
    for name, measure in (
        ("closed", -height),
        ("open", height),
        ("round", height / width - 0.02 * width),
        ("wide", width),
    ):
        # Not the few most extreme, of which some are no mouths at all.
        picked = np.argsort(-measure)[(np.linspace(0.002, 0.1, 5) * len(crops)).astype(int)]
        rows.append(np.hstack([_tile(crops[i], ours[i], mesh[i], name) for i in picked]))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1])
    print(f"overlays: {path} (the lip model green, the face mesh red)")


def _tile(
    crop: npt.NDArray[np.uint8],
    ours: npt.NDArray[np.floating],
    mesh: npt.NDArray[np.floating],
    name: str,
) -> npt.NDArray[np.uint8]:
    scale = TALL / crop.shape[0]
    size = (round(crop.shape[1] * scale), TALL)
    tile = np.ascontiguousarray(cv2.resize(crop, size, interpolation=cv2.INTER_CUBIC))
    for contours, colour in ((mesh, MESH), (ours, OURS)):
        at = np.round(((contours + 0.5) * scale - 0.5) * 16).astype(np.int32)
        for part in np.split(at, [len(OUTER_LIPS)]):
            cv2.polylines(tile, [part], True, colour, 1, cv2.LINE_AA, 4)
    cv2.putText(tile, name, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1)
    return np.asarray(tile, dtype=np.uint8)
