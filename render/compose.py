"""Laying the mouth over the background.

The mouth is blended in the encoder's own yuv420p planes: a sample whose alpha is zero keeps the
background's value exactly; a chroma sample has the mean alpha of its 2 x 2 block.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from database.mask import Camera, MouthPatch, cut_crop, project
from database.planes import Colour, Planes, block_means, planes_to_rgb, to_levels
from render.scene import MouthLayer

FloatArray = npt.NDArray[np.float32]
UInt8Array = npt.NDArray[np.uint8]


def composite(planes: Planes, layer: MouthLayer, colour: Colour) -> Planes:
    """The background's planes with the mouth laid over them.

    Parameters
    ----------
    planes : Planes
        The background frame; left as it is.
    layer : MouthLayer
        At even coordinates, of even size, inside the picture.
    colour : Colour
        Meaning of the planes.

    Returns
    -------
    Planes
        New arrays; samples under zero alpha are the background's bit for bit.
    """
    y, u, v = planes.y.copy(), planes.u.copy(), planes.v.copy()
    height, width = layer.alpha.shape
    if height and width:
        alpha = layer.alpha
        # Linear in premultiplied colour, the offset being weighted by alpha as well.
        yuv = layer.premultiplied @ colour.from_rgb.T + alpha[..., None] * colour.offset
        rows, columns = slice(layer.y0, layer.y0 + height), slice(layer.x0, layer.x0 + width)
        _blend(y[rows, columns], yuv[..., 0], alpha)
        means = block_means(np.dstack([yuv[..., 1:], alpha]))
        rows = slice(layer.y0 // 2, (layer.y0 + height) // 2)
        columns = slice(layer.x0 // 2, (layer.x0 + width) // 2)
        _blend(u[rows, columns], means[..., 0], means[..., 2])
        _blend(v[rows, columns], means[..., 1], means[..., 2])
    return Planes(y, u, v)


def _blend(target: UInt8Array, premultiplied: FloatArray, alpha: FloatArray) -> None:
    """Blend into part of a plane, in place."""
    blended = to_levels(target * (1 - alpha) + premultiplied)
    np.copyto(target, blended, where=alpha > 0)


def cut_from_planes(
    planes: Planes,
    colour: Colour,
    patch: MouthPatch,
    pose: npt.NDArray[np.float64],
    camera: Camera,
) -> UInt8Array:
    """Cut a part of the mask out of a picture that is there as planes.

    Like `database.mask.cut_crop`, but only the part of the picture that is needed is converted.

    Parameters
    ----------
    planes : Planes
    colour : Colour
        Meaning of the planes.
    patch : MouthPatch
    pose : (3, 4) float64
    camera : Camera
        Of this picture's size.

    Returns
    -------
    (crop_height, crop_width, 3) uint8
    """
    points = project(patch.grid, pose, camera).reshape(-1, 2)
    width, height = planes.width, planes.height
    x0, y0 = np.clip(points.min(axis=0) // 2 * 2 - 4, 0, (width - 2, height - 2)).astype(int)
    x1, y1 = np.clip(points.max(axis=0) // 2 * 2 + 6, (x0 + 2, y0 + 2), (width, height)).astype(int)
    rgb = planes_to_rgb(_part(planes, int(x0), int(y0), int(x1), int(y1)), colour)
    near = replace(camera, cx=camera.cx - x0, cy=camera.cy - y0)
    return cut_crop(rgb, patch, pose, near)


def _part(planes: Planes, x0: int, y0: int, x1: int, y1: int) -> Planes:
    """A box of a picture, at even coordinates; views, not copies."""
    rows, columns = slice(y0 // 2, y1 // 2), slice(x0 // 2, x1 // 2)
    return Planes(planes.y[y0:y1, x0:x1], planes.u[rows, columns], planes.v[rows, columns])
