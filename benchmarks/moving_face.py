"""A face that moves as told: a real frame's mask drawn at prescribed poses, its mouth moving.

Each picture is ray cast: the ray of every pixel is followed to the mask's surface, and the frame
is read there. The light moves too, the picture is blurred by a varying amount, and noise is
added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from analysis.photometric import surface_depth
from analysis.rigid import Matrix, inverse
from database.mask import OUTER_LIPS, Camera, Mask, project

FACE = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
"""Mesh points around the face."""

STEP = 2.0
"""mm between points of the surface's grid."""

LAMP = np.array([300.0, -400.0, 0.0])
"""mm: where the lamp is in the camera's frame, before it moves."""

SCATTER = 8.0
"""mm over which shading follows the surface."""

AMBIENT = 0.6
"""Share of the light that comes from all sides."""


@dataclass(frozen=True)
class Disturbance:
    """What makes the face hard to follow.

    Parameters
    ----------
    noise : float
        Standard deviation of each sample, grey values.
    blur : float
        Greatest standard deviation of the blur, pixels.
    light : float
        mm that a lamp beside the camera moves to every side.
    """

    noise: float = 3.0
    blur: float = 0.9
    light: float = 200.0


def prescribed_poses(base: Matrix, n: int, seed: int, fps: float = 25.0) -> Matrix:
    """A head that turns by up to 8 degrees and wanders by up to 4 cm, smoothly, (n, 3, 4)."""
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(0.2, 0.5, 6), rng.uniform(0, 2 * np.pi, 6)
    waves = np.sin(2 * np.pi * rates[:, None] * np.arange(n) / fps + phases[:, None])
    out = np.empty((n, 3, 4))
    for i in range(n):
        turn = np.asarray(cv2.Rodrigues(np.radians([8.0, 8.0, 6.0]) * waves[:3, i])[0])
        out[i] = np.column_stack([turn @ base[:, :3], base[:, 3] + [20, 15, 40] * waves[3:, i]])
    return out


def moving_face(
    frames: Sequence[npt.NDArray[np.uint8]],
    poses: Matrix,
    wanted: Matrix,
    mask: Mask,
    camera: Camera,
    disturbance: Disturbance,
    seed: int = 0,
) -> list[npt.NDArray[np.uint8]]:
    """Pictures of the first frame's face at prescribed poses, with the other frames' mouths.

    Parameters
    ----------
    frames : sequence of (h, w, 3) uint8
    poses : (len(frames), 3, 4) float64
        Where the head is in them.
    wanted : (n, 3, 4) float64
        Where it shall be.
    mask, camera
        Of the person, of the frames.
    disturbance : Disturbance
    seed : int
        Of the noise.
    """
    rng = np.random.default_rng(seed)
    height, width = frames[0].shape[:2]
    x, y = np.arange(-130, 131, STEP), np.arange(-120, 171, STEP)
    plane = np.stack(np.meshgrid(x, y), axis=-1)
    vertices = mask.vertices.astype(np.float64)
    depth = surface_depth(vertices, plane).astype(np.float32)
    # Skin scatters light: shading is smoother than the surface.
    down, across = np.gradient(cv2.GaussianBlur(depth, (0, 0), SCATTER / STEP), STEP)
    normals = np.stack([across, down, -np.ones_like(depth)], axis=-1)
    normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
    face, mouth = _cover(vertices, plane)
    rays = np.stack(
        [*np.meshgrid(np.arange(width), np.arange(height)), np.ones((height, width))], axis=-1
    )
    rays[..., :2] = (rays[..., :2] - [camera.cx, camera.cy]) / camera.focal

    out = []
    for i, pose in enumerate(wanted):
        back = inverse(pose)
        ahead, origin = rays @ back[:, :3].T, back[:, 3]
        z = np.zeros((height, width), np.float32)
        for _ in range(8):  # The surface is smooth and seen from the front: this converges.
            space = origin + ((z - origin[2]) / ahead[..., 2])[..., None] * ahead
            where = [
                ((space[..., k] - low) / STEP).astype(np.float32)
                for k, low in ((0, x[0]), (1, y[0]))
            ]
            z = _read(depth, where)

        def shown(k: int, space: npt.NDArray[np.float64] = space) -> npt.NDArray[np.float32]:
            at = project(space, poses[k], camera).astype(np.float32)
            return _read(frames[k], [at[..., 0], at[..., 1]], cv2.INTER_LANCZOS4)

        t = i / 25
        lamp = LAMP + disturbance.light * np.array(
            [np.sin(2 * np.pi * 0.4 * t), np.sin(2 * np.pi * 0.3 * t + 1), 0]
        )
        lit = _lit(space, _read(normals, where), pose, lamp)
        lit = lit / _lit(space, _read(normals, where), wanted[0], LAMP)
        speaking = _read(mouth, where)[..., None]
        head = shown(0) * (1 - speaking) + shown(i % len(frames)) * speaking
        cover = _read(face, where)[..., None]
        picture = frames[0] * (1 - cover) + head * np.clip(lit, 0.3, 2)[..., None] * cover
        blur = disturbance.blur * abs(np.sin(3 * t))
        if blur > 0.2:
            picture = cv2.GaussianBlur(picture, (0, 0), blur)
        noisy = picture + rng.normal(0, disturbance.noise, picture.shape)
        out.append(np.clip(np.round(noisy), 0, 255).astype(np.uint8))
    return out


def _lit(
    space: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float32],
    pose: Matrix,
    lamp: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Light on points of the face from a soft lamp nearby, with the head at a pose.

    A lamp of some size throws no hard shadow: its light fades out all around (half Lambert).
    """
    way = lamp - (space @ pose[:, :3].T + pose[:, 3])
    distance = np.linalg.norm(way, axis=-1)
    cosine = np.einsum("...k,...k", way, normals @ pose[:, :3].T) / distance
    usual = np.linalg.norm(LAMP - pose[:, 3])
    lit: npt.NDArray[np.float64]
    lit = AMBIENT + (1 - AMBIENT) * ((1 + cosine) / 2) ** 2 * (usual / distance) ** 2
    return lit


def _cover(
    vertices: npt.NDArray[np.float64], plane: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """How much of the face, and of its mouth and chin, covers points of the frontal plane."""
    low = plane[0, 0]
    face = np.zeros(plane.shape[:2], np.uint8)
    outline = np.round((vertices[list(FACE), :2] - low) / STEP).astype(np.int32)
    cv2.fillPoly(face, [outline], (255,))
    face = np.asarray(cv2.dilate(face, np.ones((15, 15), np.uint8)), np.uint8)
    mouth = np.zeros_like(face)
    middle = (vertices[list(OUTER_LIPS), :2].mean(axis=0) + [0, 12] - low) / STEP
    cv2.circle(mouth, (round(middle[0]), round(middle[1])), 18, (255,), -1)
    soft = [cv2.GaussianBlur(m.astype(np.float32) / 255, (0, 0), 2.5) for m in (face, mouth)]
    return np.asarray(soft[0], np.float32), np.asarray(soft[1], np.float32)


def _read(
    picture: npt.NDArray[np.generic],
    where: Sequence[npt.NDArray[np.float32]],
    how: int = cv2.INTER_LINEAR,
) -> npt.NDArray[np.float32]:
    got = cv2.remap(picture, where[0], where[1], how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(got, dtype=np.float32)
