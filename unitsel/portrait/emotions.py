"""Key frames of joy, sadness, surprise, anger, disgust and fear.

As the mouths of `unitsel.portrait.keyframes`: what is added to the generic mask. What a face does
is taken from the action units with which such faces are described (Ekman and Friesen 1978; named
in the comments). Lids are given as a part of the way that shuts the eye, since eyes differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.portrait_mesh import (
    FOREHEAD,
    GENERIC,
    INNER_LIPS,
    LEFT_BROW,
    LEFT_CHEEK,
    LEFT_LID_CREASE,
    LEFT_LOWER_LID,
    LEFT_UNDER_EYE,
    LEFT_UPPER_LID,
    MIRROR,
    N_MASK,
    NOSE,
    PHILTRUM,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
)
from database.talk_mask import TalkMask
from unitsel.portrait.keyframes import Mouth, mouth

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Emotion:
    """A face at full strength, in units of the mask.

    Parameters
    ----------
    mouth : Mouth
    inner_brow, outer_brow : float
        How far the brows come down, at the nose and at the temple.
    frown : float
        How far the brows come together.
    lids : float
        Part of the way to shut that the upper lids come down; below 0 they are wide open.
    squint : float
        Part of the eye's height that the lower lids rise.
    cheeks : float
        How far the cheeks rise.
    nose : float
        How far the wings of the nose and the lip below them are drawn up.
    """

    mouth: Mouth
    inner_brow: float = 0.0
    outer_brow: float = 0.0
    frown: float = 0.0
    lids: float = 0.0
    squint: float = 0.0
    cheeks: float = 0.0
    nose: float = 0.0


EMOTIONS: Final[dict[str, Emotion]] = {
    # 6 cheeks, 12 corners of the lips
    "joy": Emotion(Mouth(width=0.13, corner=-0.05, upper=0.004), lids=0.04, squint=0.12,
                   cheeks=0.022),
    # 1 inner brow, 4 brows together, 15 corners down, 17 chin
    "sadness": Emotion(Mouth(width=-0.03, corner=0.035, tuck=0.006), inner_brow=-0.034,
                       outer_brow=0.012, frown=0.014, lids=0.2),
    # 1 and 2 brows, 5 upper lids, 26 jaw
    "surprise": Emotion(Mouth(upper=0.012, lower=0.06, jaw=0.06, width=-0.06, corner=0.008),
                        inner_brow=-0.06, outer_brow=-0.062, lids=-0.22),
    # 4 brows, 5 and 7 lids, 23 and 24 lips
    "anger": Emotion(Mouth(press=0.012, width=-0.05, corner=0.006), inner_brow=0.04,
                     outer_brow=0.004, frown=0.022, lids=-0.04, squint=0.1),
    # 9 nose, 10 upper lip, 16 lower lip
    "disgust": Emotion(Mouth(upper=0.02, lower=0.004, width=-0.02, corner=0.016),
                       inner_brow=0.022, outer_brow=0.01, frown=0.01, lids=0.14, squint=0.16,
                       cheeks=0.012, nose=0.022),
    # 1, 2 and 4 brows, 5 upper lids, 20 lips stretched
    "fear": Emotion(Mouth(upper=0.01, lower=0.03, jaw=0.018, width=0.09, corner=0.012),
                    inner_brow=-0.05, outer_brow=-0.022, frown=0.016, lids=-0.2, squint=0.05),
}  # fmt: skip
"""By their names, at full strength."""


def parse_emotion(text: str) -> tuple[str, float]:
    """``joy`` or ``joy:0.6`` as a name and a strength.

    Raises
    ------
    SelectionError
        If there is no such emotion, or its strength is no number from 0 to 1.
    """
    name, colon, given = text.strip().lower().partition(":")
    if name not in EMOTIONS:
        raise SelectionError(f"emotion {text!r}: there are {', '.join(EMOTIONS)}")
    try:
        strength = float(given) if colon else 1.0
    except ValueError:
        strength = -1.0
    if not 0 <= strength <= 1:
        raise SelectionError(f"emotion {text!r}: give a strength from 0 to 1, such as {name}:0.6")
    return name, strength


def upper_face(emotion: Emotion, mask: TalkMask) -> F64:
    """What an emotion adds to all but the mouth, (V, 2)."""
    out = np.zeros((N_MASK, 2))
    upper, lower = LEFT_BROW[:5], LEFT_BROW[5:]
    for brow in (upper, lower):
        # From the temple to the nose.
        x = GENERIC[brow, 0]
        inner = (x - GENERIC[LEFT_BROW, 0].min()) / np.ptp(GENERIC[LEFT_BROW, 0])
        out[brow, 1] = emotion.outer_brow + (emotion.inner_brow - emotion.outer_brow) * inner**1.5
        out[brow, 0] = emotion.frown * inner
    mean = out[LEFT_BROW].mean(axis=0)
    out[LEFT_LID_CREASE] += 0.35 * mean
    for vertex, x in zip(FOREHEAD, GENERIC[FOREHEAD, 0], strict=True):
        # The skin between the brows follows their inner ends, the skin above them less.
        near = GENERIC[vertex, 1] > -0.35
        if x == 0:
            out[vertex, 1] += (0.7 if near else 0.3) * out[LEFT_BROW[4], 1]
        elif x < 0:
            out[vertex, 1] += 0.45 * mean[1]
    cheek = LEFT_CHEEK
    rise = np.exp(-(((GENERIC[cheek] - [-0.46, 0.42]) / 0.22) ** 2).sum(axis=1))
    out[cheek, 1] -= emotion.cheeks * rise
    out[LEFT_UNDER_EYE, 1] -= 0.35 * emotion.cheeks
    out[NOSE[[6, 7]], 1] -= emotion.nose * np.array([1.0, 0.7])
    out[PHILTRUM[1], 1] -= 0.9 * emotion.nose
    mirrored = out[MIRROR] * [-1, 1]
    out = np.where(np.abs(mirrored) > np.abs(out), mirrored, out)
    shut = mask.shut_eyes()
    for upper_lid, lower_lid in (
        (LEFT_UPPER_LID, LEFT_LOWER_LID),
        (RIGHT_UPPER_LID, RIGHT_LOWER_LID),
    ):
        out[upper_lid] += emotion.lids * shut[upper_lid]
        out[lower_lid, 1] -= emotion.squint * np.abs(shut[upper_lid, 1]).max()
    return out


def emotional_mouth(emotion: Emotion) -> F64:
    """What an emotion adds to the mouth, (V, 2), with the skin around it."""
    out = mouth(emotion.mouth)
    out[INNER_LIPS, 1] -= 0.6 * emotion.nose * np.exp(-((GENERIC[INNER_LIPS, 0] / 0.2) ** 2))
    return out
