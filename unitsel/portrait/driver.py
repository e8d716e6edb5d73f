"""From what is said to how a face moves: speech, emotion and life, added on one mask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from database.phonemes import CLOSURES, PHONEME_INDEX, SILENCE, VISEME_OF
from database.pinyin import TimedSyllable, split
from database.portrait_mesh import (
    GENERIC,
    INNER_CORNERS,
    INNER_LIPS,
    LEFT_LID_CREASE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_INNER,
    LOWER_OUTER,
    OUTER_LIPS,
    RIGHT_LID_CREASE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    UPPER_INNER,
    UPPER_OUTER,
    FaceMotion,
)
from database.talk_mask import TalkMask
from database.track import PhonemeTrack, frame_count, frame_times
from unitsel.portrait.emotions import EMOTIONS, emotional_mouth, upper_face
from unitsel.portrait.keyframes import (
    JAWS,
    MOUTH_FRAMES,
    N_KEYS,
    NAMES,
    VISEME_OWN,
    VISEME_SHAPES,
    VISEME_TONGUE,
    syllable_shapes,
)
from unitsel.portrait.life import LifeSettings, blinks, head_motion, unrest
from unitsel.portrait.timing import NEUTRAL, Span, TimingSettings, shape_weights

F64 = npt.NDArray[np.float64]

VOWEL_VISEMES: Final = frozenset(range(1, 12))
BITES: Final = frozenset(PHONEME_INDEX[p] for p in ("f", "v"))
_CLOSED: Final = NAMES.index("closed")

FULL_VOWEL: Final = 0.1
"""Seconds from which on a vowel has its whole mouth; shorter ones are reduced."""

SHORTEST_VOWEL: Final = 0.6
"""What is left of the mouth of a very short vowel."""

SPEAKING: Final = 0.6
"""What an emotion keeps of its mouth while another is spoken."""

RESTING: Final = 0.8
"""How far recorded lips are closed in silence, where they are measured worst."""

EMOTION_RISE: Final = 0.4
"""Seconds in which an emotion comes into the face."""

_LIDS: Final = np.concatenate([LEFT_UPPER_LID, LEFT_LOWER_LID, RIGHT_UPPER_LID, RIGHT_LOWER_LID])
_CREASES: Final = np.concatenate([LEFT_LID_CREASE, RIGHT_LID_CREASE])

_GENERIC_WIDTH: Final = float(np.linalg.norm(np.diff(GENERIC[INNER_CORNERS], axis=0)))


@dataclass(frozen=True)
class DriveSettings:
    """How a face is driven.

    Parameters
    ----------
    phonemes : TimingSettings
        Of the shapes of phonemes: English, Greek and all that is shown through Table 1.
    syllables : TimingSettings
        Of Mandarin's.
    amplitude : float
        How far the mouth moves, 1 as measured.
    emotion : str, optional
        One of `unitsel.portrait.emotions.EMOTIONS`.
    strength : float
        Of the emotion, 0 to 1.
    still : bool
        Whether nothing but the mouth moves: no blinks, no head motion, no unrest.
    life : LifeSettings
    seed : int
        Of what is random.

    Raises
    ------
    ValueError
        If a number is out of its range, or there is no such emotion.
    """

    phonemes: TimingSettings = field(default_factory=lambda: TimingSettings(method="onward"))
    syllables: TimingSettings = field(default_factory=TimingSettings)
    amplitude: float = 1.0
    emotion: str | None = None
    strength: float = 1.0
    still: bool = False
    life: LifeSettings = field(default_factory=LifeSettings)
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.amplitude <= 2:
            raise ValueError(f"amplitude must lie within 0 to 2, not {self.amplitude:g}")
        if not 0 <= self.strength <= 1:
            raise ValueError(f"strength must lie within 0 to 1, not {self.strength:g}")
        if self.emotion is not None and self.emotion not in EMOTIONS:
            raise ValueError(f"emotion {self.emotion!r}: there are {', '.join(EMOTIONS)}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")


@dataclass(frozen=True)
class LipMotion:
    """Lips of another origin than key frames: those of a real person (unitsel.portrait.retarget).

    Parameters
    ----------
    displacements : (n, V, 2) float
        Of the mask's vertices, from closed lips at rest; only lips count.
    jaw : (n,) float
    """

    displacements: npt.NDArray[np.floating]
    jaw: npt.NDArray[np.floating]


def drive(
    mask: TalkMask,
    track: PhonemeTrack,
    fps: float,
    settings: DriveSettings | None = None,
    *,
    syllables: Sequence[TimedSyllable] | None = None,
    lips: LipMotion | None = None,
    start: float = 0.0,
) -> FaceMotion:
    """Have a face say a phoneme track.

    Parameters
    ----------
    mask : TalkMask
        Of the photo.
    track : PhonemeTrack
    fps : float
        Frames a second.
    settings : DriveSettings, optional
    syllables : sequence of TimedSyllable, optional
        Mandarin's (`Speech.syllables`), whose mouths replace those of the phonemes at their times.
    lips : LipMotion, optional
        Lips of each frame, in place of key frames.
    start : float
        Seconds that the face has lived before: its life goes on from one utterance to the next.

    Returns
    -------
    FaceMotion
        ``frame_count(track.end, fps)`` frames.
    """
    chosen = settings or DriveSettings()
    n = frame_count(track.end, fps)
    weights = mouth_weights(track, fps, n, chosen, syllables)
    # Sizes of the generic mask become this one's.
    scale = float(np.clip(mask.mouth_width / _GENERIC_WIDTH, 0.75, 1.3)) * chosen.amplitude
    if lips is None:
        moved = scale * np.tensordot(weights, MOUTH_FRAMES, axes=1)
        jaw = scale * (weights @ JAWS)
    else:
        moved = chosen.amplitude * np.asarray(lips.displacements[:n], dtype=np.float64)
        jaw = chosen.amplitude * np.asarray(lips.jaw[:n], dtype=np.float64)
    closed = weights[:, _CLOSED]
    shut = closed if lips is None else np.maximum(closed, RESTING * weights[:, NEUTRAL])
    if chosen.emotion is not None and chosen.strength > 0:
        emotion = EMOTIONS[chosen.emotion]
        rise = np.ones(n)
        if not chosen.still:
            rise = np.clip((start + frame_times(n, fps)) / EMOTION_RISE, 0, 1)
        there = chosen.strength * rise * rise * (3 - 2 * rise)
        spoken = 1 - weights[:, NEUTRAL]
        felt = there * (1 - (1 - SPEAKING) * spoken)
        moved += there[:, None, None] * upper_face(emotion, mask)
        moved += felt[:, None, None] * emotional_mouth(emotion)
        jaw = jaw + felt * emotion.mouth.jaw * (1 - closed)
    moved += mask.close_lips()
    hold_lips(moved, mask, shut)
    if not chosen.still:
        # Each with its own seed, so that none depends on how long the others lasted.
        lids, head, skin = map(np.random.default_rng, np.random.SeedSequence(chosen.seed).spawn(3))
        _shut_eyes(moved, mask, blinks(n, fps, chosen.life.blink_every, lids, start))
        moved += head_motion(n, fps, chosen.life, head, start)
        moved += unrest(n, fps, chosen.life, skin, start)
    return FaceMotion(
        moved.astype(np.float32),
        np.maximum(jaw, 0).astype(np.float32),
        _tongue(track, fps, n).astype(np.float32),
        fps,
    )


def mouth_weights(
    track: PhonemeTrack,
    fps: float,
    n: int,
    settings: DriveSettings,
    syllables: Sequence[TimedSyllable] | None = None,
) -> F64:
    """Weights of the nine mouths in each frame, (n, K)."""
    if not syllables:
        return shape_weights(phoneme_spans(track), fps, n, N_KEYS, settings.phonemes)
    spans = syllable_spans(syllables)
    # What is not Chinese between the syllables is said by its phonemes.
    middles = (track.boundaries[:-1] + track.boundaries[1:]) / 2
    starts = np.array([s.start for s in syllables])
    ends = np.array([s.end for s in syllables])
    place = np.searchsorted(starts, middles, side="right") - 1
    within = (place >= 0) & (middles < ends[np.maximum(place, 0)])
    others = phoneme_spans(track, ~within)
    merged: list[Span] = []
    for span in sorted([*spans, *others], key=lambda s: s.start):
        start = max(span.start, merged[-1].end) if merged else span.start
        if span.end - start > 1e-3:
            merged.append(replace(span, start=start))
    return shape_weights(merged, fps, n, N_KEYS, settings.syllables)


def syllable_spans(syllables: Sequence[TimedSyllable]) -> list[Span]:
    """Mandarin syllables with their mouths."""
    out = []
    for syllable in syllables:
        parts = split(syllable.pinyin)
        # The first mouth is kept while the initial sounds: a closure until it is released, and
        # the final's own until it is heard (the second rule of section 4.1).
        held = syllable.onset - syllable.start
        leads = parts.initial in ("", "b", "p", "m", "f")
        out.append(Span(syllable.start, syllable.end, syllable_shapes(parts), held, leads))
    return out


def phoneme_spans(track: PhonemeTrack, wanted: npt.NDArray[np.bool_] | None = None) -> list[Span]:
    """The phonemes of a track with their mouths.

    Consonants that the tongue makes have the mouth of the vowel that follows, or else of the one
    before, as far as it is not their own (`unitsel.portrait.keyframes.OWN`).

    Parameters
    ----------
    track : PhonemeTrack
    wanted : (n,) bool, optional
        Which phonemes; all that are not silence by default.
    """
    phonemes, bounds = track.phonemes, track.boundaries
    visemes = VISEME_OF[phonemes]
    own_shapes = [
        _reduced(VISEME_SHAPES[v], v, b - a)
        for v, a, b in zip(visemes, bounds[:-1], bounds[1:], strict=True)
    ]
    out = []
    for i, phoneme in enumerate(phonemes):
        if phoneme == SILENCE or (wanted is not None and not wanted[i]):
            continue
        shapes = own_shapes[i]
        own = VISEME_OWN[visemes[i]]
        if own < 1 and (beside := _vowel_beside(phonemes, visemes, own_shapes, i)) is not None:
            shapes = own * shapes + (1 - own) * beside
        length = float(bounds[i + 1] - bounds[i])
        held = length if phoneme in CLOSURES else 0.8 * length if phoneme in BITES else 0.0
        out.append(Span(float(bounds[i]), float(bounds[i + 1]), shapes, held))
    return out


def _reduced(shapes: F64, viseme: int, length: float) -> F64:
    """A vowel's mouths, nearer to rest where it is short."""
    if viseme not in VOWEL_VISEMES or length >= FULL_VOWEL:
        return shapes
    share = SHORTEST_VOWEL + (1 - SHORTEST_VOWEL) * length / FULL_VOWEL
    out = share * shapes
    out[:, NEUTRAL] += 1 - share
    return out


def _vowel_beside(
    phonemes: npt.NDArray[np.integer], visemes: npt.NDArray[np.integer], shapes: list[F64], i: int
) -> F64 | None:
    """The mouth of the vowel next to a consonant, without a pause or closure between."""
    for step in (1, -1):
        k = i + step
        while 0 <= k < len(phonemes) and phonemes[k] != SILENCE and phonemes[k] not in CLOSURES:
            if int(visemes[k]) in VOWEL_VISEMES:
                return np.asarray(shapes[k][0 if step > 0 else -1])
            k += step
    return None


def hold_lips(moved: F64, mask: TalkMask, closed: F64) -> None:
    """Bring the lips together where they are to be closed, and let them never cross; in place.

    Parameters
    ----------
    moved : (n, V, 2) float64
        Displacements, changed in place.
    mask : TalkMask
    closed : (n,) float64
        How far they are to be closed, 0 to 1.
    """
    rest = mask.normalised
    apart = (rest[LOWER_INNER] + moved[:, LOWER_INNER]) - (
        rest[UPPER_INNER] + moved[:, UPPER_INNER]
    )
    opening = apart[..., 1]
    # What is left: nothing where closed, nothing below nothing.
    change = opening - np.maximum(opening, 0) * (1 - closed[:, None])
    moved[:, UPPER_INNER, 1] += change / 2
    moved[:, LOWER_INNER, 1] -= change / 2
    # The outer contours go with them; they have two points more, beside the corners.
    x = rest[UPPER_INNER, 0]
    for outer, sign in ((UPPER_OUTER, 0.5), (LOWER_OUTER, -0.5)):
        place = np.interp(rest[outer, 0], x, np.arange(len(x)))
        low = np.floor(place).astype(int).clip(0, len(x) - 2)
        part = place - low
        along = change[:, low] * (1 - part) + change[:, low + 1] * part
        moved[:, outer, 1] += sign * 0.85 * along


def _shut_eyes(moved: F64, mask: TalkMask, shut: F64) -> None:
    """Lower the lids, in place: whatever an emotion does to them, a shut eye is shut."""
    way, s = mask.shut_eyes(), shut[:, None, None]
    moved[:, _LIDS] = (1 - s) * moved[:, _LIDS] + s * way[_LIDS]
    moved[:, _CREASES] += s * way[_CREASES]


def _tongue(track: PhonemeTrack, fps: float, n: int) -> F64:
    """How far the tongue is raised in each frame, smoothed over 80 ms."""
    fine = 8
    raised = VISEME_TONGUE[VISEME_OF[track.at(frame_times(n * fine, fps * fine))]]
    width = max(1, round(0.08 * fps * fine))
    smooth = np.convolve(np.pad(raised, width // 2, mode="edge"), np.full(width, 1 / width), "same")
    smooth = smooth[width // 2 : width // 2 + n * fine]
    return np.asarray(smooth.reshape(n, fine).mean(axis=1))


LIP_VERTICES: Final = np.concatenate([OUTER_LIPS, INNER_LIPS])
"""Vertices that a `LipMotion` gives."""
