"""Colour as encoders hold it: yuv420p planes, and their relation to RGB.

A picture that is only partly changed is changed here, in the planes that the encoder takes: a
trip of the whole picture through RGB would alter most samples.

Planes are 8 bit, chroma at half size in both directions, one chroma sample for the four luma
samples of a 2 x 2 block. Pictures of odd size lose their last column or row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
import numpy.typing as npt

UInt8Array = npt.NDArray[np.uint8]

Matrix = Literal["bt601", "bt709"]

LUMA_WEIGHTS: Final[dict[Matrix, tuple[float, float]]] = {
    "bt601": (0.299, 0.114),
    "bt709": (0.2126, 0.0722),
}
"""Weights of red and blue in luma (ITU-R BT.601 and BT.709); green has the rest."""

UNSPECIFIED: Final = 2
"""FFmpeg's number for primaries or a transfer curve that nothing is known of."""


@dataclass(frozen=True)
class Colour:
    """What the samples of a stream mean.

    Parameters
    ----------
    matrix : "bt601" or "bt709"
        Weights between RGB and YUV.
    full_range : bool
        Luma from 0 to 255; otherwise from 16 to 235, as most video has it.
    primaries, transfer : int
        FFmpeg's numbers, carried from input to output and not interpreted.
    """

    matrix: Matrix = "bt601"
    full_range: bool = False
    primaries: int = UNSPECIFIED
    transfer: int = UNSPECIFIED

    @property
    def from_rgb(self) -> npt.NDArray[np.float32]:
        """(3, 3) float32 that takes RGB levels to YUV levels, before `offset` is added."""
        red, blue = LUMA_WEIGHTS[self.matrix]
        luma = np.array([red, 1 - red - blue, blue])
        u = (np.array([0.0, 0.0, 1.0]) - luma) / (2 * (1 - blue))
        v = (np.array([1.0, 0.0, 0.0]) - luma) / (2 * (1 - red))
        scale = (1.0, 1.0, 1.0) if self.full_range else (219 / 255, 224 / 255, 224 / 255)
        return np.asarray(np.stack([luma, u, v]) * np.array(scale)[:, None], dtype=np.float32)

    @property
    def offset(self) -> npt.NDArray[np.float32]:
        """(3,) float32: YUV levels of black."""
        return np.array([0 if self.full_range else 16, 128, 128], dtype=np.float32)


@dataclass(frozen=True)
class Planes:
    """One picture as yuv420p.

    Parameters
    ----------
    y : (height, width) uint8
        Luma; both sizes even.
    u, v : (height / 2, width / 2) uint8
        Chroma.
    """

    y: UInt8Array
    u: UInt8Array
    v: UInt8Array

    @property
    def width(self) -> int:
        """Width in luma samples."""
        return int(self.y.shape[1])

    @property
    def height(self) -> int:
        """Height in luma samples."""
        return int(self.y.shape[0])

    def packed(self) -> UInt8Array:
        """The three planes one after another, (height * 3 / 2, width) uint8."""
        flat = np.concatenate([self.y.ravel(), self.u.ravel(), self.v.ravel()])
        return flat.reshape(self.height * 3 // 2, self.width)


def block_means(plane: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Mean of each 2 x 2 block: (h, w, ...) to (h / 2, w / 2, ...)."""
    out: npt.NDArray[np.float32] = 0.25 * (
        plane[0::2, 0::2] + plane[0::2, 1::2] + plane[1::2, 0::2] + plane[1::2, 1::2]
    )
    return out


def to_levels(values: npt.NDArray[np.floating]) -> UInt8Array:
    """Round to 0..255."""
    return np.asarray(np.clip(np.rint(values), 0, 255), dtype=np.uint8)


def rgb_to_planes(rgb: UInt8Array, colour: Colour) -> Planes:
    """A picture's planes, chroma being the mean of its 2 x 2 block.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
        A last odd row or column is left out.
    colour : Colour
    """
    height, width = rgb.shape[0] // 2 * 2, rgb.shape[1] // 2 * 2
    yuv = rgb[:height, :width].astype(np.float32) @ colour.from_rgb.T + colour.offset
    y, uv = to_levels(yuv[..., 0]), to_levels(block_means(yuv[..., 1:]))
    return Planes(y, np.ascontiguousarray(uv[..., 0]), np.ascontiguousarray(uv[..., 1]))


def planes_to_rgb(planes: Planes, colour: Colour) -> UInt8Array:
    """A picture's RGB, each chroma sample standing for its 2 x 2 block: (h, w, 3) uint8.

    swscale is not asked: it darkens by one level in its fast mode, and in its exact one shifts
    chroma or not by what the stream says of its siting. Block by block, the way back through
    `rgb_to_planes` gives the same planes, but for rounding.
    """
    size = (planes.width, planes.height)
    u, v = (
        cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST) for plane in (planes.u, planes.v)
    )
    matrix = np.linalg.inv(colour.from_rgb.astype(np.float64))
    offset = -matrix @ colour.offset.astype(np.float64)
    rgb = cv2.transform(cv2.merge([planes.y, u, v]), np.hstack([matrix, offset[:, None]]))
    return np.asarray(rgb, dtype=np.uint8)
