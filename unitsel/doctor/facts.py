"""What is known of each clip, and from when on something is wrong with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

AXES: Final = (
    ("nod", "degrees"),
    ("turn", "degrees"),
    ("tilt", "degrees"),
    ("across", "mm"),
    ("up and down", "mm"),
    ("distance", "mm"),
)
"""The six parameters of a pose: rotations about x, y, z, then translations along them."""


@dataclass(frozen=True)
class Limits:
    """From when on something is said; rules of thumb, but for the relative ones.

    Parameters
    ----------
    rotation : (3,) float
        Degrees of nod, turn and tilt away from a face that looks into the camera.
    translation : (3,) float
        Millimetres away from the median place: across, up and down, in depth.
    mouth_pixels : float
        Least width of the resting mouth in the footage.
    blur : float
        Least sharpness of a clip in parts of the corpus's median.
    clipped : float
        Most pixels of the mouth that are black or white to the end of the scale.
    drift : float
        Greatest change of brightness inside a clip, in parts of it.
    exposure : float
        Greatest distance from the corpus's median brightness, in parts of it.
    level, snr : float
        Least level of speech in dB under full scale, and over the noise.
    clipped_sound : float
        Most samples at full scale.
    agreement : float
        Least correlation of the lips with what the phones let one expect.
    attempts : int
        Tries of the aligner from which on its result is doubted.
    short_phones : float
        Most phones of the shortest length the aligner gives.
    """

    rotation: tuple[float, float, float] = (12.0, 15.0, 10.0)
    translation: tuple[float, float, float] = (60.0, 60.0, 80.0)
    mouth_pixels: float = 40.0
    blur: float = 0.6
    clipped: float = 0.01
    drift: float = 0.10
    exposure: float = 0.15
    level: float = -40.0
    snr: float = 15.0
    clipped_sound: float = 1e-3
    agreement: float = 0.4
    attempts: int = 3
    short_phones: float = 0.4


@dataclass(frozen=True)
class Rejected:
    """Frames that cannot be used.

    Parameters
    ----------
    frames : tuple of int
        Their numbers, from 0.
    reason : str
    picture : bytes
        One of them as a small JPEG; empty where the footage is gone.
    """

    frames: tuple[int, ...]
    reason: str
    picture: bytes = b""


@dataclass(frozen=True)
class SoundFacts:
    """Sound of a clip: speech level (dB under full scale), over noise (dB), share at full scale."""

    level: float
    snr: float
    clipped: float


@dataclass(frozen=True)
class AlignmentFacts:
    """How sure the phones of a clip are.

    Parameters
    ----------
    given : bool
        Whether a timing file gave them.
    attempts : int
        Tries that the aligner needed.
    notes : tuple of str
        What it said: words not heard, pronunciations guessed.
    short : float
        Share of phones as short as the aligner makes them (30 ms): where it did not find a
        sound it squeezes it.
    agreement : float or None
        Correlation of the lips with what the phones let one expect from the other clips.
    error : str
        Why there are no phones; empty where there are.
    """

    given: bool = False
    attempts: int = 1
    notes: tuple[str, ...] = ()
    short: float = 0.0
    agreement: float | None = None
    error: str = ""


@dataclass(frozen=True)
class ClipFacts:
    """A clip.

    Parameters
    ----------
    name : str
    media : Path
    words : str
    fps, seconds : float
    size : (width, height)
        Zeros where it is not known.
    looked, faces : int
        Frames that were looked at, and those of them with a face.
    rotations, translations : (n, 3) float64
        Poses of frames with a face: degrees and mm.
    mouth_pixels : float
        Median width of the mouth in the footage; 0 without a face.
    sharpness : float
        Median over the frames: variance of the mouth's Laplacian over that of its grey levels.
    clipped : float
        Share of the mouths' pixels at either end of the scale.
    brightness : float
        Mean grey level of the mouths, 0 to 255.
    drift : float
        Greatest less least brightness of the clip's thirds, in parts of their mean.
    mouth : bytes
        A mouth as a small JPEG.
    rejected : tuple of Rejected
    sound : SoundFacts or None
    alignment : AlignmentFacts or None
        None where it was not tried.
    lag : float
        Seconds by which the lips come after the phones.
    phonemes : (n,) int64, or None
        What is spoken, silence included.
    error : str
        Why the clip cannot be used; empty where it can.
    picture : bytes
        A frame of a clip that cannot be used, as a small JPEG.
    """

    name: str
    media: Path
    words: str = ""
    fps: float = 0.0
    seconds: float = 0.0
    size: tuple[int, int] = (0, 0)
    looked: int = 0
    faces: int = 0
    rotations: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    translations: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    mouth_pixels: float = 0.0
    sharpness: float = 0.0
    clipped: float = 0.0
    brightness: float = 0.0
    drift: float = 0.0
    mouth: bytes = b""
    rejected: tuple[Rejected, ...] = ()
    sound: SoundFacts | None = None
    alignment: AlignmentFacts | None = None
    lag: float = 0.0
    phonemes: npt.NDArray[np.int64] | None = None
    error: str = ""
    picture: bytes = b""

    def with_agreement(self, agreement: float | None) -> ClipFacts:
        """The same clip with the lips' agreement."""
        known = self.alignment or AlignmentFacts()
        return replace(self, alignment=replace(known, agreement=agreement))

    def as_json(self) -> dict[str, Any]:
        """The clip for machines, pictures and poses left out."""
        document: dict[str, Any] = {
            "clip": self.name,
            "media": str(self.media),
            "words": self.words,
            "fps": round(self.fps, 4),
            "seconds": round(self.seconds, 3),
            "size": list(self.size),
            "frames_looked_at": self.looked,
            "frames_with_face": self.faces,
            "mouth_pixels": round(self.mouth_pixels, 1),
            "sharpness": round(self.sharpness, 4),
            "clipped": round(self.clipped, 5),
            "brightness": round(self.brightness, 2),
            "drift": round(self.drift, 4),
            "lag": round(self.lag, 3),
            "rejected": [{"frames": list(r.frames), "reason": r.reason} for r in self.rejected],
        }
        if self.sound is not None:
            document["sound"] = {k: round(v, 5) for k, v in vars(self.sound).items()}
        if self.alignment is not None:
            document["alignment"] = vars(self.alignment) | {"notes": list(self.alignment.notes)}
        if self.error:
            document["error"] = self.error
        return document


def usable(clips: Sequence[ClipFacts]) -> list[ClipFacts]:
    """The clips that nothing keeps out of a database."""
    return [c for c in clips if not c.error]


def poses_outside(
    rotations: FloatArray, translations: FloatArray, limits: Limits
) -> npt.NDArray[np.bool_]:
    """Which frames' heads are outside the good range, (n, 6): one column a parameter.

    Rotations count from a face that looks into the camera, translations from their median.
    """
    middle = np.median(translations, axis=0) if len(translations) else np.zeros(3)
    return np.concatenate(
        [
            np.abs(rotations) > np.array(limits.rotation),
            np.abs(translations - middle) > np.array(limits.translation),
        ],
        axis=1,
    )


def clip_faults(clips: Sequence[ClipFacts], limits: Limits) -> dict[str, list[str]]:
    """What is wrong with each usable clip, in words; clips without a fault are left out."""
    good = [c for c in usable(clips) if c.faces]
    sharp = float(np.median([c.sharpness for c in good])) if good else 0.0
    bright = float(np.median([c.brightness for c in good])) if good else 0.0
    out: dict[str, list[str]] = {}
    for c in usable(clips):
        found = _picture_faults(c, limits, sharp, bright) if c.faces else []
        found += _sound_faults(c, limits)
        if found:
            out[c.name] = found
    return out


def _picture_faults(c: ClipFacts, limits: Limits, sharp: float, bright: float) -> list[str]:
    found = []
    if c.sharpness < limits.blur * sharp:
        found.append(f"blurred: {c.sharpness / sharp:.0%} of the usual sharpness")
    if c.clipped > limits.clipped:
        found.append(f"{c.clipped:.1%} of the mouth is black or white to the end of the scale")
    if c.drift > limits.drift:
        found.append(f"brightness changes by {c.drift:.0%} inside the clip")
    if bright and abs(c.brightness / bright - 1) > limits.exposure:
        how = "brighter" if c.brightness > bright else "darker"
        found.append(f"{abs(c.brightness / bright - 1):.0%} {how} than usual")
    return found


def _sound_faults(c: ClipFacts, limits: Limits) -> list[str]:
    if c.sound is None:
        return []
    found = []
    if c.sound.level < limits.level:
        found.append(f"speech is quiet ({c.sound.level:.0f} dB under full scale)")
    if c.sound.snr < limits.snr:
        found.append(f"noise only {c.sound.snr:.0f} dB under speech")
    if c.sound.clipped > limits.clipped_sound:
        found.append(f"sound overdriven ({c.sound.clipped:.1%} of it at full scale)")
    return found


def alignment_faults(c: ClipFacts, limits: Limits) -> list[str]:
    """Why the phones of a clip are doubted, in words."""
    a = c.alignment
    if a is None:
        return []
    if a.error:
        return [a.error]
    found = list(a.notes)
    if a.attempts >= limits.attempts and not any("attempt" in n for n in found):
        found.append(f"aligned only at attempt {a.attempts}")
    if a.short > limits.short_phones and not a.given:
        found.append(f"{a.short:.0%} of the phones are as short as the aligner makes them")
    if a.agreement is not None and a.agreement < limits.agreement:
        found.append(f"lips follow the phones badly (r {a.agreement:.2f})")
    return found
