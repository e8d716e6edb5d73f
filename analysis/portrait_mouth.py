"""The colours of a mouth's inside in a photo's light.

A closed mouth shows neither teeth nor tongue. Teeth are a little brighter than the whites of the
eyes, which the photo does show, and yellower; gums and tongue are redder and darker than
lips.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.mouth_look import MouthLook
from database.portrait_mesh import (
    LEFT_CHEEK,
    LEFT_EYE,
    LOWER_INNER,
    LOWER_OUTER,
    RIGHT_CHEEK,
    RIGHT_EYE,
)
from database.talk_mask import TalkMask

F64 = npt.NDArray[np.float64]

WHITE_SHARE: Final = 85
"""Percentile of the eyes' brightness that is taken for their whites."""

TEETH: Final = (1.18, 1.18, 1.11)
"""Teeth to whites of the eyes, a channel: the median of eleven people of the London set (DeBruine
and Jones) who smile in one picture and do not in the other."""

PALEST: Final = 0.85
"""Least channel of the whites in parts of the greatest."""

DIMMEST: Final = 0.93
"""Least brightness of the whites in parts of the cheeks'."""

INSIDE: Final = 0.8
"""Eyes are looked at in their outline made so much smaller, that lids and lashes do not count."""


def mouth_look(picture: npt.NDArray[np.uint8], mask: TalkMask) -> MouthLook:
    """Colour the generic mouth to a photo.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        RGB.
    mask : TalkMask
    """
    eyes = np.concatenate(
        [_inside(picture, _shrunk(mask.vertices[eye])) for eye in (LEFT_EYE, RIGHT_EYE)]
    )
    skin = np.concatenate(
        [_inside(picture, mask.vertices[c][[1, 2, 3, 4]]) for c in (LEFT_CHEEK, RIGHT_CHEEK)]
    )
    lips = _inside(picture, mask.vertices[np.concatenate([LOWER_INNER, LOWER_OUTER[::-1]])])
    cheek, lip = np.median(skin, axis=0), np.median(lips, axis=0)
    level = eyes.mean(axis=1)
    white = eyes[level >= np.percentile(level, WHITE_SHARE)].mean(axis=0)
    # In small pictures the whites have taken colour from the lids around them.
    white = np.maximum(white, PALEST * white.max())
    # Whites are shaded by lids and lashes, skin seldom is.
    white *= max(1.0, DIMMEST * float(cheek.mean()) / float(white.mean()))
    teeth = np.clip(white * TEETH, 0, 240)
    return MouthLook(
        teeth=teeth.astype(np.float32),
        gum=(0.55 * lip + 0.35 * cheek * (1.0, 0.7, 0.7)).astype(np.float32),
        tongue=(0.85 * lip).astype(np.float32),
        cavity=(0.16 * cheek * (1.0, 0.55, 0.5)).astype(np.float32),
    )


def _shrunk(outline: F64) -> F64:
    middle = outline.mean(axis=0)
    return np.asarray(middle + INSIDE * (outline - middle))


def _inside(picture: npt.NDArray[np.uint8], outline: F64) -> F64:
    """Pixels inside an outline, (n, 3); the nearest one where it holds none."""
    shape = picture.shape[:2]
    inside = np.zeros(shape, np.uint8)
    corners = np.clip(np.rint(outline), 0, (shape[1] - 1, shape[0] - 1)).astype(np.int32)
    cv2.fillPoly(inside, [corners], 1)
    return np.asarray(picture[inside > 0], dtype=np.float64)
