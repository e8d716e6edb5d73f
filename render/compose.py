"""Laying the mouth over the background.

The mouth is blended in the encoder's own yuv420p planes: a sample whose alpha is zero keeps the
background's value exactly; a chroma sample has the mean alpha of its 2 x 2 block.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from database.planes import Colour, Planes, block_means, to_levels
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
