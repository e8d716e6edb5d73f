"""One picture between two: what moved between them is met half-way, then they are mixed.

A plain cross-fade would show an edge that has moved by a pixel twice, and the face softer for a
moment. So both pictures are first pulled towards each other along the optical flow between them,
which for the frames that are blended here is a pixel or two.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.planes import Planes, to_levels

FloatArray = npt.NDArray[np.float32]

FLOW_WIDTH: Final = 240
"""Pixels: flow is estimated on pictures reduced to at most about this width."""


def flow_between(first: Planes, second: Planes) -> FloatArray:
    """Where what is seen in one picture is in another.

    Parameters
    ----------
    first, second : Planes
        Of equal size.

    Returns
    -------
    (height, width, 2) float32
        Motion in x and y, luma pixels.
    """
    height, width = first.y.shape
    step = max(1.0, width / FLOW_WIDTH)
    size = (max(16, round(width / step)), max(16, round(height / step)))
    small = [cv2.resize(p.y, size, interpolation=cv2.INTER_AREA) for p in (first, second)]
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    finder.setFinestScale(1)
    flow = np.asarray(finder.calc(small[0], small[1], None), dtype=np.float32)  # type: ignore[call-overload]
    whole = cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole * [width / size[0], height / size[1]], dtype=np.float32)


def morph(first: Planes, second: Planes, flow: FloatArray, weight: float) -> Planes:
    """The picture on the way from one to another.

    Parameters
    ----------
    first, second : Planes
    flow : (height, width, 2) float32
        `flow_between` the two.
    weight : float
        0 gives the first, 1 the second.

    Returns
    -------
    Planes
    """
    size = (first.u.shape[1], first.u.shape[0])
    half = np.asarray(0.5 * cv2.resize(flow, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    return Planes(
        _between(first.y, second.y, flow, weight),
        _between(first.u, second.u, half, weight),
        _between(first.v, second.v, half, weight),
    )


def between_poses(
    first: npt.NDArray[np.float64], second: npt.NDArray[np.float64], weight: float
) -> npt.NDArray[np.float64]:
    """The pose on the way from one to another, (3, 4) float64 each."""
    turn, _ = cv2.Rodrigues(first[:, :3].T @ second[:, :3])
    part, _ = cv2.Rodrigues(np.asarray(turn, dtype=np.float64) * weight)
    place = (1 - weight) * first[:, 3:] + weight * second[:, 3:]
    return np.asarray(np.hstack([first[:, :3] @ part, place]), dtype=np.float64)


def _between(
    first: npt.NDArray[np.uint8], second: npt.NDArray[np.uint8], flow: FloatArray, weight: float
) -> npt.NDArray[np.uint8]:
    height, width = first.shape
    x = np.arange(width, dtype=np.float32)[None]
    y = np.arange(height, dtype=np.float32)[:, None]
    pulled = [
        cv2.remap(
            plane,
            x + share * flow[..., 0],
            y + share * flow[..., 1],
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for plane, share in ((first, -weight), (second, 1 - weight))
    ]
    mixed = pulled[0].astype(np.float32) * (1 - weight) + pulled[1].astype(np.float32) * weight
    return to_levels(mixed)
