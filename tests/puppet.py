"""A talking person without footage: a portrait whose mouth is opened by its phones.

The portrait (Grace Hopper, in the public domain, part of matplotlib) moves a little, as heads
do; below the line between the lips it is drawn down by as much as the phone opens the mouth,
with dark and at times teeth in between. The sound is espeak-ng's where the optional extra is
installed, else a noise that nobody could align, with the phones beside it.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import resample_poly

from analysis.espeak import sample_rate
from analysis.utterance import say
from database.lexicon import Lexicon, spread_words
from database.phonemes import PHONEMES, SILENCE
from database.sound import SPEECH_RATE, Sound
from database.timing import Timing, WordTrack, write_timing
from database.track import Interval, PhonemeTrack, frame_times
from database.video_writer import VideoWriter
from database.voice_symbols import render_intervals

FPS = 25
WIDTH, HEIGHT = 288, 352
CORNER = np.array([116.0, 66.0])
"""Place of the film's upper left corner in the portrait."""

LIP_X = np.array([230.0, 235.0, 252.0, 268.0, 284.0, 300.0, 306.0])
LIP_Y = np.array([276.5, 276.2, 276.2, 276.0, 274.3, 271.9, 272.0])
"""The line between the lips in the portrait, pixels."""

MIDDLE, HALF_WIDTH = 268.0, 36.0
CHIN, THROAT = 322.0, 385.0
REGION = np.s_[225:390, 180:356]
"""Rows and columns of the portrait that the mouth's motion reaches."""

LARGEST = 22.0
"""Pixels that the chin sinks at openness 1."""

DARK = np.array([45, 18, 16], np.float32)
TEETH = np.array([225, 215, 195], np.float32)

OPENNESS = {
    "aa": 1.0, "ae": 0.85, "ao": 0.8, "aw": 0.85, "ay": 0.85, "oy": 0.7, "ah": 0.65, "eh": 0.6,
    "ey": 0.5, "ow": 0.55, "ax": 0.45, "uh": 0.4, "er": 0.4, "ih": 0.4, "ix": 0.35, "iy": 0.35,
    "uw": 0.25, "w": 0.2, "y": 0.3, "h": 0.45, "hh": 0.45, "r": 0.3, "l": 0.4, "k": 0.35,
    "g": 0.35, "ng": 0.35, "th": 0.3, "dh": 0.3, "d": 0.25, "t": 0.25, "n": 0.25, "s": 0.2,
    "z": 0.2, "sh": 0.25, "ch": 0.25, "jh": 0.25, "zh": 0.25, "f": 0.12, "v": 0.12,
}  # fmt: skip
"""How far each phoneme opens the mouth; those not named (silence, p, b, m) close it."""

ROUND = frozenset(("ow", "ao", "oy", "uw", "uh", "w", "sh", "ch", "jh", "zh"))
TOOTHY = frozenset(("s", "z", "t", "d", "n", "iy", "ih", "eh", "ey", "th", "dh", "sh", "ch", "jh"))

SENTENCES = {
    "hopper1": "bin blue at f two now",
    "hopper2": "lay red by x nine soon",
    "hopper3": "place white in m three again",
    "hopper4": "set green with a five please",
}
"""Clips whose phones are given, and what they say."""

SPOKEN = {"hopper5": "place blue by four now", "hopper6": "set white with nine again"}
"""Clips whose words are given and whose sound is speech: espeak-ng's."""


def can_speak() -> bool:
    """Whether the optional extra that speaks is installed."""
    return importlib.util.find_spec("espeakng_loader") is not None


def even_track(
    sentence: str, start: float = 0.3, seconds: float = 1.4
) -> tuple[PhonemeTrack, WordTrack]:
    """Phones and words of a sentence said at an even pace, with silence before and after."""
    words = sentence.split()
    sizes = np.cumsum([0, *(len(w) + 1 for w in words)])
    edges = start + sizes / sizes[-1] * seconds
    timed = WordTrack(
        tuple(words), tuple(edges[:-1].tolist()), tuple(edges[1:].tolist()), start + seconds + 0.3
    )
    return spread_words(timed, Lexicon.default()), timed


def hum(track: PhonemeTrack, seed: int = 0) -> Sound:
    """Noise where a track speaks."""
    times = (np.arange(round(track.end * SPEECH_RATE)) + 0.5) / SPEECH_RATE
    loud = gaussian_filter1d((track.at(times) != SILENCE).astype(float), SPEECH_RATE / 100)
    noise = np.random.default_rng(seed).normal(0, 0.05, len(times))
    return Sound((noise * loud).astype(np.float32), SPEECH_RATE)


def film(
    track: PhonemeTrack, n_frames: int, *, seed: int = 0, motion: float = 1.0
) -> Iterator[np.ndarray]:
    """Pictures of the portrait saying a track, (352, 288, 3) uint8 RGB.

    Parameters
    ----------
    track : PhonemeTrack
    n_frames : int
    seed : int
        Of the head's motion.
    motion : float
        How much the head moves; 0 for none.
    """
    names = [PHONEMES[p] for p in track.at(frame_times(n_frames * 4, FPS * 4))]

    def smooth(values: Sequence[float]) -> np.ndarray:
        """From four values a frame, with a little of what lies before and after."""
        return gaussian_filter1d(np.array(values), 3.0, mode="nearest")[1::4]

    opening = smooth([OPENNESS.get(p, 0.0) for p in names])
    rounding = smooth([float(p in ROUND) for p in names])
    teeth = smooth([float(p in TOOTHY) for p in names])
    turns = head_motion(n_frames, seed, motion)
    for i in range(n_frames):
        face = draw(opening[i], rounding[i], teeth[i])
        yield cv2.warpAffine(
            face,
            turns[i],
            (WIDTH, HEIGHT),
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )


def head_motion(n_frames: int, seed: int = 0, amount: float = 1.0) -> np.ndarray:
    """Maps from the portrait into each frame, (n, 2, 3): a slow sway, turn and nod."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames) / FPS
    rates, phases = rng.uniform(0.25, 0.6, 4), rng.uniform(0, 2 * np.pi, 4)
    x, y, angle, size = np.sin(2 * np.pi * rates[:, None] * t + phases[:, None]) * amount
    angle, scale = np.radians(2.5) * angle, 1 + 0.025 * size
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    middle = CORNER + [WIDTH / 2, HEIGHT / 2]
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    shift = middle - CORNER + np.stack([4 * x, 3 * y], axis=1) - turn @ middle
    return np.concatenate([turn, shift[:, :, None]], axis=2)


def draw(opening: float, rounding: float = 0.0, teeth: float = 0.0) -> np.ndarray:
    """The portrait with its mouth opened, rounded and showing teeth (each 0..1), whole size."""
    picture = portrait()
    y, x = np.mgrid[REGION].astype(np.float32)
    near = np.exp(-((np.hypot((x - MIDDLE) / 55, (y - 278) / 32)) ** 4))
    source_x = MIDDLE + (x - MIDDLE) * (1 + 0.25 * rounding * near)
    across = np.clip(np.abs(source_x - MIDDLE) / HALF_WIDTH, 0, 1)
    # The gap is that of a mouth, the jaw below it wider.
    gap = LARGEST * opening * np.sqrt(1 - across**2)
    jaw = np.clip(1 - np.abs(source_x - MIDDLE) / 85, 0, 1)
    line = np.interp(source_x, LIP_X, LIP_Y).astype(np.float32)
    below = np.clip((THROAT - y) / (THROAT - CHIN), 0, 1)
    at_chin = np.clip((y - line - gap) / 30, 0, 1)
    fall = gap * (1 - at_chin) + LARGEST * opening * jaw * at_chin
    source_y = np.where(y > line + gap, y - fall * below, np.minimum(y, line))
    warped = cv2.remap(
        picture, source_x.astype(np.float32), source_y.astype(np.float32), cv2.INTER_CUBIC
    )
    deep = np.clip((y - line) * 2, 0, 1) * np.clip((line + gap - y) * 2, 0, 1)
    white = teeth * np.clip(line + 0.55 * gap - y, 0, 1) * (across < 0.8)
    inside = (1 - white[..., None]) * DARK + white[..., None] * TEETH
    mixed = warped * (1 - deep[..., None]) + inside * deep[..., None]
    drawn = picture.copy()
    drawn[REGION] = np.round(mixed)
    return drawn


@cache
def portrait() -> np.ndarray:
    """Grace Hopper, (600, 512, 3) uint8 RGB."""
    path = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    assert picture is not None, path
    picture.setflags(write=False)
    return picture


def write_clip(path: Path, track: PhonemeTrack, sound: Sound | None, seed: int = 0) -> None:
    """Write a film of the portrait saying a track."""
    with VideoWriter(path, WIDTH, HEIGHT, FPS, sound, crf=14) as video:
        for picture in film(track, round(track.end * FPS), seed=seed):
            video.write_rgb(picture)


def make_corpus(folder: Path) -> Path:
    """Fill a folder with clips: four with their phones, and two with words where espeak speaks."""
    for seed, (name, sentence) in enumerate(SENTENCES.items()):
        track, words = even_track(sentence)
        write_clip(folder / f"{name}.mp4", track, hum(track, seed), seed)
        write_timing(folder / f"{name}.TextGrid", Timing(track, words))
    for seed, (name, sentence) in enumerate(SPOKEN.items() if can_speak() else (), 10):
        sound, track = speak(sentence)
        write_clip(folder / f"{name}.mp4", track, sound, seed)
        (folder / f"{name}.txt").write_text(sentence + "\n")
    return folder


def speak(sentence: str, lead: float = 0.3) -> tuple[Sound, PhonemeTrack]:
    """Say a sentence with espeak-ng.

    Returns
    -------
    sound : Sound
        16 kHz, with `lead` seconds of faint noise before and after the speech.
    track : PhonemeTrack
        espeak's own times, as long as the sound.
    """
    pieces: list[np.ndarray] = []
    said = say(sentence, "en-us", pieces.append)
    rate = sample_rate()
    spoken = np.concatenate(pieces).astype(np.float64) / 32768
    spoken = resample_poly(spoken, SPEECH_RATE, rate)
    quiet = round(lead * SPEECH_RATE)
    samples = np.pad(spoken, quiet)
    samples += np.random.default_rng(0).normal(0, 1e-4, len(samples))
    end = lead + len(spoken) / SPEECH_RATE
    phones, _ = render_intervals(said.phones)
    intervals = [Interval(p.start + lead, p.end + lead, p.label) for p in phones]
    intervals.append(Interval(end, end + lead, "sil"))
    track = PhonemeTrack.from_intervals(intervals, name=sentence)
    return Sound(samples.astype(np.float32), SPEECH_RATE), track
