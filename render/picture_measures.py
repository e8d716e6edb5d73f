"""What the eye would see of the stitching, as numbers.

Each measure is taken alike on a drawn picture and on a real one, and their ratio tells: a seam
raises the gradient across the band in which the two pictures are blended, resampling lowers
the sharpness of the mouth, and colour that is fitted anew in each frame makes skin flicker that is
still in reality. Ratios of 1 are what nothing would be seen of.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mask import OUTER_LIPS, Camera, Mask
from database.planes import Colour, Planes
from render.blend import SOLID, ring_weights
from render.compose import cut_from_planes
from render.scene import Scene

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

SECTORS: Final = 32
"""Parts of the turn around the region's middle in which a seam is looked for."""

SHADING: Final = 2.0
"""Pixels: brightness that a Gaussian of this width follows is shading and no seam."""

LEVELS: Final = 6
"""Parts of the fade, from outside to inside, in which gradients are averaged."""

STILL_MM: Final = 9.0
"""Millimetres from the resting lips from which on skin is taken to be still."""

PATCH_MM: Final = 6.0
"""Millimetres across which brightness is averaged before its flicker is measured, so that the
noise of the recording does not count."""


def seam_gradient(luma: npt.NDArray[np.generic], alpha: FloatArray) -> float:
    """Gradient across the band in which the mouth's picture fades out.

    The derivative of luma in the direction in which alpha rises, averaged with its sign over
    short arcs of the band, so that noise and skin texture count little and what goes along the
    band does. Shading is taken out before (`SHADING`): a face is darker towards its sides anyway,
    by more than a seam adds, and a mouth too light would even it out.

    Parameters
    ----------
    luma : (h, w) float or uint8
        The part of the picture that alpha covers.
    alpha : (h, w) float32
        Blend weight of each pixel.

    Returns
    -------
    float
        Of the steepest arc of each sector the median, levels a pixel: a collar or a jaw's edge in
        a few sectors is not what is looked for.

    Raises
    ------
    RenderError
        If the sizes differ, or alpha does not fade anywhere.
    """
    _same_size(luma, alpha)
    levels = np.asarray(luma, dtype=np.float32)
    down, across = np.gradient(levels - cv2.GaussianBlur(levels, (0, 0), SHADING))
    # Where to alpha rises: in the mean over some pixels, so that a hard edge has a band, too.
    soft = cv2.GaussianBlur(alpha, (0, 0), 1.5)
    alpha_down, alpha_across = np.gradient(soft)
    steepness = np.hypot(alpha_down, alpha_across)
    band = (soft > 0.02) & (soft < 0.98) & (steepness > 1e-4)
    if not band.any():
        raise RenderError("the blend weights fade nowhere, so there is no seam to look at")
    along = (down * alpha_down + across * alpha_across) / np.maximum(steepness, 1e-6)
    y, x = np.nonzero(band)
    middle = np.argwhere(soft >= 0.5 * soft.max()).mean(axis=0)
    turn = (np.arctan2(y - middle[0], x - middle[1]) / (2 * np.pi)) % 1.0
    level = np.minimum((soft[y, x] * LEVELS).astype(int), LEVELS - 1)
    arc = np.minimum((turn * SECTORS).astype(int), SECTORS - 1) * LEVELS + level
    count = np.bincount(arc, minlength=SECTORS * LEVELS)
    total = np.bincount(arc, weights=along[y, x], minlength=SECTORS * LEVELS)
    steep = np.abs(total / np.maximum(count, 1)).reshape(SECTORS, LEVELS).max(axis=1)
    return float(np.median(steep[count.reshape(SECTORS, LEVELS).any(axis=1)]))


def sharpness(luma: npt.NDArray[np.generic], region: BoolArray) -> float:
    """Variance of the Laplacian of luma in a region.

    Parameters
    ----------
    luma : (h, w) float or uint8
    region : (h, w) bool
        Where to look, such as where alpha is at least `render.blend.SOLID`.

    Returns
    -------
    float
        Squared levels.

    Raises
    ------
    RenderError
        If the sizes differ or the region is empty.
    """
    _same_size(luma, region)
    if not region.any():
        raise RenderError("the region whose sharpness is asked for is empty")
    laplacian = cv2.Laplacian(np.asarray(luma, dtype=np.float32), cv2.CV_32F)
    return float(np.var(laplacian[region], dtype=np.float64))


def still_region(mask: Mask, alpha: FloatArray) -> BoolArray:
    """Skin of the crop that does not move in speech, where the mouth's picture is drawn.

    Parameters
    ----------
    mask : Mask
    alpha : (crop_height, crop_width) float32
        Of `render.blend.blend_alpha`.

    Returns
    -------
    (crop_height, crop_width) bool
        Above the line between the mouth's corners and `STILL_MM` from the resting lips.
    """
    lips = mask.patch.to_crop(mask.vertices[list(OUTER_LIPS)])
    moving = np.zeros(alpha.shape, np.uint8)
    cv2.fillPoly(moving, [np.rint(lips).astype(np.int32)], 1)
    away = cv2.distanceTransform(1 - moving, cv2.DIST_L2, 5)
    rows = np.arange(alpha.shape[0])[:, None]
    return np.asarray(
        (alpha > 0) & (away > STILL_MM * mask.patch.pixels_per_mm) & (rows < lips[:, 1].mean())
    )


def flicker(
    lumas: Sequence[npt.NDArray[np.generic]], region: BoolArray, pixels_per_mm: float
) -> float:
    """How much the brightness of still skin goes up and down from frame to frame.

    Parameters
    ----------
    lumas : sequence of (h, w) float or uint8
        Luma of the crops of frames in a row, head motion taken out; at least 3.
    region : (h, w) bool
        Of `still_region`.
    pixels_per_mm : float
        Scale of the crops.

    Returns
    -------
    float
        Root mean square of ``l[t-1] / 2 - l[t] + l[t+1] / 2`` over region and time, luma being
        averaged over `PATCH_MM`; levels.

    Raises
    ------
    RenderError
        If there are fewer than 3 frames, the sizes differ or the region is empty.
    """
    if len(lumas) < 3:
        raise RenderError(f"flicker needs at least 3 frames in a row, not {len(lumas)}")
    _same_size(lumas[0], region)
    if not region.any():
        raise RenderError("the region whose flicker is asked for is empty")
    side = max(1, round(PATCH_MM * pixels_per_mm))
    soft = np.stack(
        [cv2.blur(np.asarray(luma, np.float32), (side, side))[region] for luma in lumas]
    )
    bend = soft[:-2] / 2 - soft[1:-1] + soft[2:] / 2
    return float(np.sqrt(np.mean(bend.astype(np.float64) ** 2)))


def band_mismatch(
    first: npt.NDArray[np.generic], second: npt.NDArray[np.generic], alpha: FloatArray
) -> float:
    """Difference of light that is left between two crops where they are blended.

    Parameters
    ----------
    first, second : (h, w, 3) float or uint8
    alpha : (h, w) float32

    Returns
    -------
    float
        Root mean square over the band and the channels of the difference of local means
        (5 x 5 pixels); levels.
    """
    weights = ring_weights(alpha)
    if not weights.any():
        raise RenderError("the blend weights fade nowhere, so there is no band to compare in")
    difference = np.asarray(first, np.float32) - np.asarray(second, np.float32)
    squares = (cv2.blur(difference, (5, 5)) ** 2).mean(axis=2)
    return float(np.sqrt((squares * weights).sum() / weights.sum()))


def changed_outside(made: Planes, background: Planes, alpha: FloatArray, x0: int, y0: int) -> int:
    """Count samples outside the blend region that are not the background's.

    Parameters
    ----------
    made, background : Planes
        Encoder's input planes of one frame, and those of the background frame under it.
    alpha : (h, w) float32
        Blend weights of the drawn layer, of even size.
    x0, y0 : int
        Picture pixel of the layer's first column and row, even.

    Returns
    -------
    int
        Luma and chroma samples together; a chroma sample is outside where all its four pixels
        are. 0 is right.
    """
    whole = np.zeros((background.height, background.width), dtype=bool)
    whole[y0 : y0 + alpha.shape[0], x0 : x0 + alpha.shape[1]] = alpha > 0
    blocks = whole.reshape(background.height // 2, 2, background.width // 2, 2).any(axis=(1, 3))
    changed = ((made.y != background.y) & ~whole).sum()
    for new, old in ((made.u, background.u), (made.v, background.v)):
        changed += ((new != old) & ~blocks).sum()
    return int(changed)


@dataclass(frozen=True)
class PictureScores:
    """Measures of frames in a row; of one sentence, say.

    Parameters
    ----------
    seam : float
        Mean of `seam_gradient`.
    sharpness : float
        Mean of `sharpness` where the mouth's picture is not blended.
    flicker : float
        Of `flicker`, in the still region.
    """

    seam: float
    sharpness: float
    flicker: float

    def over(self, real: PictureScores) -> PictureScores:
        """Ratios to a real picture's."""
        return PictureScores(
            self.seam / real.seam, self.sharpness / real.sharpness, self.flicker / real.flicker
        )


def picture_scores(
    frames: Iterable[tuple[Planes, npt.NDArray[np.float64]]],
    mask: Mask,
    camera: Camera,
    alpha: FloatArray,
    colour: Colour,
) -> PictureScores:
    """Measure frames in a row, drawn or real, as if the mouth had been laid on all of them.

    Parameters
    ----------
    frames : iterable of (Planes, (3, 4) float64)
        Pictures with the head's pose.
    mask : Mask
    camera : Camera
        Of the pictures' size.
    alpha : (crop_height, crop_width) float32
        Of `render.blend.blend_alpha`.
    colour : Colour
        Meaning of the planes.

    Raises
    ------
    RenderError
        If there are fewer than 3 frames, or the mouth lies outside one.
    """
    patch = mask.patch
    blank = np.zeros((patch.crop_height, patch.crop_width, 3), np.uint8)
    seams, sharp, lumas = [], [], []
    with Scene(camera.width, camera.height, patch, camera, alpha) as scene:
        for planes, pose in frames:
            layer = scene.draw(blank, pose)
            height, width = layer.alpha.shape
            luma = planes.y[layer.y0 : layer.y0 + height, layer.x0 : layer.x0 + width]
            seams.append(seam_gradient(luma, layer.alpha))
            sharp.append(sharpness(luma, layer.alpha >= SOLID))
            crop = cut_from_planes(planes, colour, patch, pose, camera)
            lumas.append(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY))
    return PictureScores(
        float(np.mean(seams)) if seams else 0.0,
        float(np.mean(sharp)) if sharp else 0.0,
        flicker(lumas, still_region(mask, alpha), patch.pixels_per_mm),
    )


def _same_size(picture: npt.NDArray[np.generic], weights: npt.NDArray[np.generic]) -> None:
    if picture.shape != weights.shape:
        raise RenderError(
            f"a picture of shape {picture.shape} does not fit weights of shape {weights.shape}"
        )
