"""The key frames of a face: nine mouths that all visemes and Mandarin syllables are made of.

A key frame is what is added to the generic mask (Image Talk, section 2.1: the expression mask):
displacements of the vertices of `database.portrait_mesh`, in its frame and unit, with how far the
lower teeth came down and the tongue was raised. Mouths are described by a few measures and laid
over the mask by `mouth`: lips, then chin and jaw, then the skin between, which follows less the
farther it is. Sizes are those of a speaker of GRID at his more distinct moments, and rounding,
which a face mesh hardly sees, by eye.

Consonants that the tongue makes (t, k, n ...) have no mouth of their own: their mouth is largely
the one of the vowel next to them (section 3.3), see `OWN`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.phonemes import N_VISEMES, VISEMES
from database.pinyin import Syllable
from database.portrait_mesh import (
    BELOW_LIP,
    CHIN,
    GENERIC,
    INNER_LIPS,
    LEFT_JAW,
    LOWER_INNER,
    LOWER_OUTER,
    N_MASK,
    OUTER_LIPS,
    RIGHT_JAW,
    STILL_WHEN_SPEAKING,
    UPPER_INNER,
    UPPER_OUTER,
)

F64 = npt.NDArray[np.float64]

LIP_REACH: Final = 0.13
"""Distance from the lips at which the skin still follows them to 1/e, units."""

_HALF_OUTER: Final = float(GENERIC[OUTER_LIPS, 0].max())
_HALF_INNER: Final = float(GENERIC[INNER_LIPS, 0].max())


@dataclass(frozen=True)
class Mouth:
    """A mouth by its measures, in units of the mask; all 0 is the closed mouth at rest.

    Parameters
    ----------
    upper, lower : float
        How far the middle of the inner upper lip is raised, and of the lower lip lowered.
    jaw : float
        How far chin and lower teeth have come down.
    width : float
        By what part the mouth is wider (narrower below 0).
    aperture : float
        Part of the inner lips' width that opens; the rest stays together.
    corner : float
        How far the corners come down.
    pucker : float
        How far both outer contours go out in the middle: lips pushed forward.
    press : float
        How far the outer contours come in: lips pressed together.
    tuck : float
        How far the lower lip's edge goes up under the upper teeth.
    tongue : float
        0 to 1, `FaceMotion.tongue`.
    """

    upper: float = 0.0
    lower: float = 0.0
    jaw: float = 0.0
    width: float = 0.0
    aperture: float = 1.0
    corner: float = 0.0
    pucker: float = 0.0
    press: float = 0.0
    tuck: float = 0.0
    tongue: float = 0.0


MOUTHS: Final[dict[str, Mouth]] = {
    "rest": Mouth(),
    "closed": Mouth(press=0.012, width=0.01),
    "open": Mouth(upper=0.022, lower=0.135, jaw=0.125, width=-0.03, corner=0.03),
    "half": Mouth(upper=0.02, lower=0.075, jaw=0.065, width=0.0, corner=0.012),
    "spread": Mouth(upper=0.018, lower=0.042, jaw=0.022, width=0.06, corner=-0.004),
    "round": Mouth(upper=0.025, lower=0.075, jaw=0.06, width=-0.16, aperture=0.72, corner=0.01,
                   pucker=0.008),
    "pucker": Mouth(upper=0.015, lower=0.03, jaw=0.022, width=-0.25, aperture=0.5, pucker=0.018),
    "bite": Mouth(upper=0.03, lower=0.0, jaw=0.012, width=0.02, tuck=0.012),
    "teeth": Mouth(upper=0.022, lower=0.03, jaw=0.006, width=0.03),
}  # fmt: skip
"""The nine mouths; "rest" is the neutral face."""

NAMES: Final = tuple(MOUTHS)
N_KEYS: Final = len(NAMES)

_VISEME_MOUTHS: Final = (
    "rest 1",  # sil
    "half 0.8 open 0.2",  # ae ax ah
    "open 1",  # aa
    "round 0.8 open 0.2",  # ao
    "half 1",  # ey eh uh
    "half 0.45 pucker 0.35 teeth 0.2",  # er
    "spread 1",  # iy y ih ix
    "pucker 1",  # w uw
    "round 1",  # ow
    "open 0.8 round 0.2; pucker 0.7 round 0.3",  # aw
    "round 1; spread 0.8 half 0.2",  # oy
    "open 0.9 half 0.1; spread 0.7 half 0.3",  # ay
    "half 0.6 rest 0.4",  # h
    "pucker 0.6 teeth 0.4",  # r
    "half 0.6 teeth 0.4",  # l
    "teeth 1",  # s z
    "teeth 0.5 pucker 0.5",  # sh ch jh zh
    "teeth 0.7 half 0.3",  # th dh
    "bite 1",  # f v
    "teeth 0.7 half 0.3",  # d t n
    "half 0.7 teeth 0.3",  # k g ng
    "closed 1",  # p b m
)

OWN: Final[dict[str, float]] = {
    "h": 0.1, "k": 0.35, "d": 0.45, "l": 0.5, "s": 0.7, "sh": 0.85, "th": 0.7, "r": 0.8,
}  # fmt: skip
"""What part of a consonant's mouth is its own, by the first or second phoneme of its viseme; the
rest is the vowel's beside it. All other visemes are their own altogether."""

_TONGUE: Final[dict[str, float]] = {"l": 0.85, "th": 1.0, "d": 0.7, "s": 0.35, "iy": 0.35}
_FINALS: Final[dict[str, str]] = {
    "a": "open 1", "o": "round 1", "e": "half 1", "ê": "half 0.8 spread 0.2",
    "i": "spread 1", "u": "pucker 1", "ü": "pucker 0.9 spread 0.1", "-i": "teeth 1",
    "er": "half 0.7 open 0.3; half 0.6 pucker 0.4",
    "ai": "open 1; spread 0.8 half 0.2", "ei": "half 1; spread 1",
    "ao": "open 1; round 0.8 pucker 0.2", "ou": "round 1; pucker 1",
    "an": "open 1; half 0.6 teeth 0.4", "en": "half 1; half 0.4 teeth 0.6",
    "ang": "open 1; half 0.55 open 0.45", "eng": "half 1", "ong": "pucker 0.6 round 0.4; round 1",
    "n": "spread 0.8 teeth 0.2", "ng": "spread 0.7 half 0.3",
}  # fmt: skip
_AFTER_I_OR_Ü_AN: Final = "half 0.8 spread 0.2; half 0.4 teeth 0.6"
_INITIALS: Final = {"b": "closed 1", "p": "closed 1", "m": "closed 1", "f": "bite 1"}


def _rows(text: str) -> F64:
    """``"open 0.8 round 0.2; spread 1"`` as rows of weights, (m, K)."""
    out = np.zeros((text.count(";") + 1, N_KEYS))
    for row, part in zip(out, text.split(";"), strict=True):
        words = part.split()
        for name, weight in zip(words[::2], words[1::2], strict=True):
            row[NAMES.index(name)] = float(weight)
    return out


VISEME_SHAPES: Final[tuple[F64, ...]] = tuple(_rows(text) for text in _VISEME_MOUTHS)
"""Of each viseme the mouths that show it, in turn: weights of the key frames, (m, K)."""

VISEME_OWN: Final[F64] = np.array(
    [next((w for p, w in OWN.items() if p in group), 1.0) for group in VISEMES]
)
"""(22,): `OWN` by viseme."""

VISEME_TONGUE: Final[F64] = np.array(
    [next((w for p, w in _TONGUE.items() if p in group), 0.0) for group in VISEMES]
)
"""(22,): how far the tongue is raised."""

assert len(VISEME_SHAPES) == N_VISEMES


def syllable_shapes(syllable: Syllable) -> F64:
    """The mouths of a Mandarin syllable, in turn (Image Talk, section 3).

    The initial is one of them only where the lips make it: b, p, m, f; all others dissolve into the
    final.

    Returns
    -------
    (m, K) float64
        Rows of weights.
    """
    parts = [_INITIALS[syllable.initial]] if syllable.initial in _INITIALS else []
    if syllable.medial:
        parts.append(_FINALS[syllable.medial])
    rime = syllable.rime
    if rime == "an" and syllable.medial in ("i", "ü"):
        parts.append(_AFTER_I_OR_Ü_AN)
    elif rime == "ong" and syllable.medial:
        parts.append(_FINALS["o"])
    else:
        parts.append(_FINALS[rime])
    return np.concatenate([_rows(p) for p in parts])


def mouth(measures: Mouth) -> F64:
    """Lay a mouth over the generic mask.

    Returns
    -------
    (V, 2) float64
        Displacements.
    """
    out = np.zeros((N_MASK, 2))
    m = measures
    x = GENERIC[:, 0]
    lips = np.concatenate([OUTER_LIPS, INNER_LIPS])
    out[lips, 0] = m.width * x[lips]
    side = np.minimum(1.0, np.abs(x[lips]) / _HALF_OUTER)
    out[lips, 1] = m.corner * side**2
    inside = _arch(x / (_HALF_INNER * m.aperture), 0.6)
    outside = _arch(x / _HALF_OUTER, 0.75)
    out[UPPER_INNER, 1] -= m.upper * inside[UPPER_INNER]
    out[LOWER_INNER, 1] += m.lower * inside[LOWER_INNER]
    # The lower lip goes down with its edge; under a round mouth it is drawn along as a whole.
    out[UPPER_OUTER, 1] -= (0.75 * m.upper + m.pucker - m.press) * outside[UPPER_OUTER]
    out[LOWER_OUTER, 1] += (0.92 * m.lower + m.pucker - m.press) * outside[LOWER_OUTER]
    tucked = _arch(x / (0.8 * _HALF_INNER), 0.6)
    out[LOWER_INNER, 1] -= m.tuck * tucked[LOWER_INNER]
    out[LOWER_OUTER, 1] -= 0.7 * m.tuck * tucked[LOWER_OUTER]
    return with_skin(out, m.jaw)


def _arch(t: F64, power: float) -> F64:
    """1 in the middle, 0 at -1 and 1 and beyond."""
    return np.asarray(np.maximum(0.0, 1.0 - t * t) ** power)


def _following() -> tuple[F64, F64, F64]:
    """How the skin follows: the lips' points (V, 20), how much of them (V,), the chin (V,)."""
    outer = GENERIC[OUTER_LIPS]
    distance = np.linalg.norm(GENERIC[:, None] - outer[None], axis=2)
    near = np.exp(-((distance / LIP_REACH) ** 2) * 2)
    shares = near / np.maximum(near.sum(axis=1, keepdims=True), 1e-12)
    lips = np.exp(-((distance.min(axis=1) / LIP_REACH) ** 2))
    # The chin hangs on the jaw, which turns about a point before the ear: less far out.
    x, y = np.abs(GENERIC[:, 0]), GENERIC[:, 1]
    down = np.clip((y - 0.72) / 0.25, 0, 1)
    out = np.clip((0.78 - x) / 0.42, 0, 1)
    chin = down * down * (3 - 2 * down) * out * out * (3 - 2 * out)
    chin[CHIN[[2, 3, 4, 5, 6, 7]]] = 1.0
    still = np.zeros(len(x), dtype=bool)
    still[STILL_WHEN_SPEAKING] = True
    lips[still], chin[still] = 0.0, 0.0
    return shares, lips, chin


_SHARES, _WITH_LIPS, _WITH_CHIN = _following()
_SKIN: Final = np.setdiff1d(np.arange(N_MASK), np.concatenate([OUTER_LIPS, INNER_LIPS]))

MOUTH_REGION: Final = np.union1d(
    np.concatenate([OUTER_LIPS, INNER_LIPS, BELOW_LIP, CHIN, LEFT_JAW, RIGHT_JAW]),
    np.flatnonzero((_WITH_LIPS > 0) | (_WITH_CHIN > 0)),
)
"""Vertices that speech moves."""


def with_skin(lips: F64, jaw: float | npt.NDArray[np.floating]) -> F64:
    """Have the skin follow lips and chin.

    Parameters
    ----------
    lips : (..., V, 2) float
        Displacements of the lips' vertices.
    jaw : (...) float
        How far the chin has come down.

    Returns
    -------
    (..., V, 2) float64
    """
    out = np.array(lips, dtype=np.float64)
    drawn = np.einsum("vo,...od->...vd", _SHARES[_SKIN], out[..., OUTER_LIPS, :])
    share = _WITH_LIPS[_SKIN][:, None]
    hung = np.zeros_like(drawn)
    hung[..., 1] = np.asarray(jaw)[..., None] * _WITH_CHIN[_SKIN]
    out[..., _SKIN, :] = share * drawn + (1 - share) * hung
    return out


MOUTH_FRAMES: Final[F64] = np.stack([mouth(m) for m in MOUTHS.values()])
"""(K, V, 2): displacements of the key frames."""

JAWS: Final[F64] = np.array([m.jaw for m in MOUTHS.values()])
"""(K,): how far the lower teeth have come down."""

for _array in (MOUTH_FRAMES, JAWS, VISEME_OWN, VISEME_TONGUE):
    _array.setflags(write=False)
