"""The drawn mouth as a picture of its own, for laying over a video in another program."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from render.scene import MouthLayer

REACH: Final = 9
"""Pixels: colour goes on so far (and further, evenly) where nothing is seen any more."""


def layer_picture(layer: MouthLayer, width: int, height: int) -> npt.NDArray[np.uint8]:
    """A whole picture that shows the mouth and is transparent around it.

    Parameters
    ----------
    layer : MouthLayer
    width, height : int
        Of the picture that it was drawn for.

    Returns
    -------
    (height, width, 4) uint8
        RGB and alpha, not premultiplied. The colour goes on beyond the edge, so that codecs which
        halve colours, and filters, find no black there.
    """
    out = np.zeros((height, width, 4), dtype=np.uint8)
    if not layer.alpha.size or not layer.alpha.any():
        return out
    size = (2 * REACH + 1, 2 * REACH + 1)
    colour = cv2.blur(layer.premultiplied, size, borderType=cv2.BORDER_CONSTANT)
    weight = cv2.blur(layer.alpha, size, borderType=cv2.BORDER_CONSTANT)[..., None]
    mean = layer.premultiplied.sum(axis=(0, 1)) / layer.alpha.sum()
    alpha = layer.alpha[..., None]
    near = np.where(weight > 1e-3, colour / np.maximum(weight, 1e-3), mean)
    seen = np.where(alpha > 1e-3, layer.premultiplied / np.maximum(alpha, 1e-3), near)
    out[..., :3] = np.clip(np.rint(mean), 0, 255).astype(np.uint8)
    box = out[layer.y0 : layer.y0 + alpha.shape[0], layer.x0 : layer.x0 + alpha.shape[1]]
    box[..., :3] = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    box[..., 3] = np.clip(np.rint(255 * layer.alpha), 0, 255).astype(np.uint8)
    return out
