"""Which frames of a background may follow which others unseen.

After frame i the picture may change to frame j where, for as long as the blend lasts, the frames
after i and those from j on are alike: in the head's pose, in the picture (but for the mouth, which
will be covered) and in how the head moves (Schoedl et al., Video Textures, 2000: frames are
compared with those around them). Likeness is measured in steps that the head makes anyway, so a
lively background tolerates more: 1 is a blend whose own change a frame equals the step from one
frame to the next that 95 % of the recording's steps do not exceed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from database.mask import Camera, MouthPatch, project
from render.background import IntArray, Material
from render.background_frames import BackgroundFrames

FloatArray = npt.NDArray[np.float32]

BLEND_SECONDS: Final = (0.32, 0.96)
"""Lengths of blends: the longer for frames that are less alike, as between two clips."""

SLOWNESS_COST: Final = 0.4
"""Cost of the longer blend for being longer: what cannot be met half-way is seen double."""

SHORTEST_BLEND: Final = 3
"""Frames."""

NATURAL: Final = 95.0
"""Percentile of the natural steps that changes are compared with."""

FLOOR_PIXELS: Final = 0.0006
"""Natural step of the head, in picture widths, that is taken at least (0.2 pixels of 360): a head
that keeps still tolerates what the eye does not see."""

FLOOR_LEVELS: Final = 1.0
"""Natural step of the picture, in levels, that is taken at least: noise."""

SMALL_WIDTH: Final = 96
"""Pixels: pictures are compared reduced to this width."""

BLOCK: Final = 8
"""Pixels of the reduced picture: differences count block by block, so that a blink is no less
than a change of the whole picture."""

HEAD_BOX: Final = np.array(
    [[x, y, z] for x in (-60.0, 60.0) for y in (-60.0, 60.0) for z in (0.0, 40.0)]
)
"""Points of the head, mm in the mask's frame, by which poses are compared."""


@dataclass(frozen=True)
class Likeness:
    """What it costs to go on elsewhere, by a blend of one length.

    Parameters
    ----------
    blend : int
        Frames of a blend.
    cost : (n, n) float32
        Of leaving after frame i into frame j: frames i + 1 ... i + blend are blended with
        j ... j + blend - 1. Infinite where either has not so many frames.
    """

    blend: int
    cost: FloatArray


def blend_weights(blend: int) -> npt.NDArray[np.float64]:
    """Share of the second picture in each frame of a blend, (blend,): slow, quick, slow."""
    t = np.arange(1, blend + 1) / (blend + 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float64)


def compare_frames(
    material: Material, frames: BackgroundFrames, patch: MouthPatch, camera: Camera
) -> tuple[Likeness, ...]:
    """Compare all frames of a background with one another.

    Parameters
    ----------
    material : Material
        Time and memory grow with the square of its length.
    frames : BackgroundFrames
        Its pictures.
    patch : MouthPatch
    camera : Camera
        Of the pictures.

    Raises
    ------
    RenderError, MediaError
        If the pictures cannot be read.
    """
    n = len(material)
    follows = material.ends[:-1] > np.arange(1, n)
    head = np.stack([project(HEAD_BOX, material.poses.matrix(i), camera) for i in range(n)])
    moves = _motion(head, material)
    head_step = _natural(_steps(head), follows, FLOOR_PIXELS * camera.width)
    small, weight = _reduced(material, frames, patch, camera)
    apart = np.zeros((n, n), dtype=np.float32)
    for distance in _picture_distances(small, weight):
        steps = np.diagonal(distance, 1).astype(np.float64)
        apart = np.maximum(apart, distance / _natural(steps, follows, FLOOR_LEVELS))
    flat = head.reshape(n, -1).astype(np.float32)
    pose = np.asarray(np.sqrt(_mean_squares(flat, len(HEAD_BOX))), dtype=np.float32)
    flat = moves.reshape(n, -1).astype(np.float32)
    motion = np.asarray(np.sqrt(_mean_squares(flat, len(HEAD_BOX))), dtype=np.float32)
    apart = np.maximum(apart, pose / head_step)
    found = []
    for k, seconds in enumerate(BLEND_SECONDS):
        blend = max(SHORTEST_BLEND * (k + 1), round(seconds * material.fps))
        # The greatest change a frame that the blend itself makes: its steepest weight.
        steepest = float(np.diff(blend_weights(blend), prepend=0.0, append=1.0).max())
        shared = 0.5 * BLEND_SECONDS[0] / seconds
        change = apart * steepest + shared * motion / head_step
        cost = _over_blend(change.astype(np.float32), blend, material.ends)
        found.append(Likeness(blend, cost + np.float32(SLOWNESS_COST * k)))
    return tuple(found)


def _steps(head: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Root mean square motion of the head's points from frame to frame, (n - 1,) pixels."""
    return np.asarray(
        np.sqrt((np.diff(head, axis=0) ** 2).sum(axis=-1).mean(axis=-1)), dtype=np.float64
    )


def _natural(steps: npt.NDArray[np.float64], follows: npt.NDArray[np.bool_], least: float) -> float:
    own = steps[follows]
    return max(least, float(np.percentile(own, NATURAL)) if len(own) else 0.0)


def _motion(head: npt.NDArray[np.float64], material: Material) -> npt.NDArray[np.float64]:
    """How the head's points move, pixels a frame, tracking noise smoothed away."""
    out = np.zeros_like(head)
    for k in range(len(material.parts)):
        mine = np.flatnonzero(material.part == k)
        if len(mine) > 1:
            smooth = gaussian_filter1d(head[mine], 1.0, axis=0, mode="nearest")
            out[mine] = np.gradient(smooth, axis=0)
    return out


def _reduced(
    material: Material, frames: BackgroundFrames, patch: MouthPatch, camera: Camera
) -> tuple[FloatArray, FloatArray]:
    """Luma of all frames, reduced, (n, h, w); weight of each pixel, (h, w), 0 at the mouth."""
    n = len(material)
    scale = SMALL_WIDTH / camera.width
    size = (SMALL_WIDTH, max(BLOCK, round(camera.height * scale)))
    small = np.empty((n, size[1], size[0]), dtype=np.float32)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    border = np.concatenate([patch.grid[0], patch.grid[-1], patch.grid[:, 0], patch.grid[:, -1]])
    for i in range(n):
        planes = frames.planes(int(material.part[i]), int(material.place[i]))
        small[i] = cv2.resize(planes.y, size, interpolation=cv2.INTER_AREA)
        seen = project(border, material.poses.matrix(i), camera)
        low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    weight = np.ones((size[1], size[0]), dtype=np.float32)
    left, top = np.maximum(np.floor(low * scale).astype(int), 0)
    right, bottom = np.maximum(np.ceil(high * scale).astype(int), 0)
    weight[top : bottom + 1, left : right + 1] = 0
    return small, weight


def _picture_distances(small: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Difference of each two pictures, levels.

    Returns
    -------
    whole : (n, n) float32
        Root mean square over the picture.
    blocks : (n, n) float32
        Fourth root of the blocks' mean fourth power: what changes in one place counts.
    """
    n, height, width = small.shape
    squares, fourths = np.zeros((2, n, n), dtype=np.float32)
    blocks, pixels = 0, 0.0
    for y in range(0, height, BLOCK):
        for x in range(0, width, BLOCK):
            at = np.s_[y : y + BLOCK, x : x + BLOCK]
            size = float(weight[at].sum())
            if size < 0.25 * weight[at].size:
                continue
            values = (small[:, at[0], at[1]] * weight[at]).reshape(n, -1)
            square = _mean_squares(values - values.mean(axis=0), size)
            np.add(squares, size * square, out=squares)
            np.multiply(square, square, out=square)
            np.add(fourths, square, out=fourths)
            blocks, pixels = blocks + 1, pixels + size
    whole = np.sqrt(squares / np.float32(max(1.0, pixels)))
    by_blocks = (fourths / np.float32(max(1, blocks))) ** np.float32(0.25)
    return whole, np.asarray(by_blocks, dtype=np.float32)


def _mean_squares(values: FloatArray, count: float) -> FloatArray:
    """Squared distance of each two rows of (n, d), divided by a count: (n, n)."""
    scaled = values / np.float32(np.sqrt(count))
    squares = np.einsum("nd,nd->n", scaled, scaled)
    apart = (np.float32(-2) * scaled) @ scaled.T
    apart += squares[:, None]
    apart += squares[None]
    return np.asarray(np.maximum(apart, 0, out=apart), dtype=np.float32)


def _over_blend(change: FloatArray, blend: int, ends: IntArray) -> FloatArray:
    """Mean change over a blend that begins after i into j, (n, n)."""
    n = len(change)
    cost = np.full((n, n), np.inf, dtype=np.float32)
    rows = n - blend
    if rows < 1:
        return cost
    summed = np.zeros((rows, rows + 1), dtype=np.float32)
    for k in range(blend):
        summed += change[1 + k : 1 + k + rows, k : k + rows + 1]
    cost[:rows, : rows + 1] = summed / blend
    here = np.arange(n)
    # The frame after the blend must be there as well.
    cost[here + blend >= ends] = np.inf
    cost[:, here + blend >= ends] = np.inf
    return cost
