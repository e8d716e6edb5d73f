"""A small talking corpus of which everything is known: a portrait that espeak speaks for.

The portrait (Grace Hopper, in the public domain, part of matplotlib) is driven by what espeak says
and drawn as `unitsel say` draws it, with nothing moving but its mouth; then each picture is
shifted, turned and scaled, as a head sways. So of each frame are known the phoneme, the pose and
the place of every point of the lips.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib
import numpy as np

from analysis.portrait import portrait_of
from database.portrait_mesh import LOWER_INNER, OUTER_LIPS, UPPER_INNER
from database.sound import Sound
from database.timing import Timing, write_timing
from database.track import PhonemeTrack
from database.video_writer import VideoWriter
from render.portrait_scene import PortraitScene
from unitsel.portrait.driver import DriveSettings, drive
from unitsel.speech.spoken import speak

FPS = 25
WIDTH, HEIGHT = 288, 352
MIDDLE = np.array([262.0, 242.0])
"""The film's middle in the portrait."""

SENTENCES = {
    "grace1": "Maybe we will meet my mother.",
    "grace2": "Five people saw the open boat.",
    "grace3": "You may both move the table.",
    "grace4": "She said hello to her baby.",
}


@dataclass(frozen=True)
class Truth:
    """What is known of a clip of n frames.

    Parameters
    ----------
    track : PhonemeTrack
    maps : (n, 2, 3) float64
        From the portrait into each frame: turn, scale and shift.
    lips : (n, 20, 2) float64
        Outer contour in the frames, pixels, in the order of `database.mask.OUTER_LIPS`.
    width, height, opening : (n,) float64
        Of the lips, in pixels of the portrait, as a database measures them.
    """

    track: PhonemeTrack
    maps: np.ndarray
    lips: np.ndarray
    width: np.ndarray
    height: np.ndarray
    opening: np.ndarray


def make_corpus_apart(folder: Path) -> dict[str, Truth]:
    """`make_corpus` in a process of its own: the same in every run.

    What espeak says depends a little on all that it said before in its process.
    """
    code = (
        "import pickle, sys; sys.path.insert(0, sys.argv[1]); import portrait_corpus; "
        "from pathlib import Path; truths = portrait_corpus.make_corpus(Path(sys.argv[2])); "
        "sys.stdout.buffer.write(pickle.dumps(truths))"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(folder)]
    made = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    truths: dict[str, Truth] = pickle.loads(made)
    return truths


def sway(n: int, seed: int) -> np.ndarray:
    """A head's slow motion as maps from the portrait into the frames, (n, 2, 3)."""
    random = np.random.default_rng(seed)
    t = np.arange(n) / FPS
    rates, phases = random.uniform(0.25, 0.6, 4), random.uniform(0, 2 * np.pi, 4)
    x, y, angle, size = np.sin(2 * np.pi * rates[:, None] * t + phases[:, None])
    angle, scale = np.radians(2.5) * angle, 1 + 0.02 * size
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    place = np.array([WIDTH / 2, HEIGHT / 2]) + np.stack([4 * x, 3 * y], axis=1)
    return np.concatenate([turn, (place - turn @ MIDDLE)[:, :, None]], axis=2)


def make_corpus(folder: Path) -> dict[str, Truth]:
    """Fill a folder with clips and their phones; needs espeak, the face models and OpenGL."""
    photo = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    head = portrait_of(photo)
    truths = {}
    with PortraitScene(head.photo, head.mask, head.mouth) as scene:
        x0, y0, width, height = scene.box
        for seed, (name, sentence) in enumerate(SENTENCES.items()):
            speech = speak(sentence)
            motion = drive(head.mask, speech.track, FPS, DriveSettings(still=True))
            maps = sway(len(motion), seed)
            assert isinstance(speech.sound, Sound)
            with VideoWriter(
                folder / f"{name}.mp4", WIDTH, HEIGHT, FPS, speech.sound, crf=14
            ) as video:
                picture = head.photo.copy()
                for i, turn in enumerate(maps):
                    picture[y0 : y0 + height, x0 : x0 + width] = scene.draw(
                        motion.displacements[i], float(motion.jaw[i]), float(motion.tongue[i])
                    )
                    video.write_rgb(
                        cv2.warpAffine(
                            picture,
                            turn,
                            (WIDTH, HEIGHT),
                            flags=cv2.INTER_CUBIC,
                            borderMode=cv2.BORDER_REPLICATE,
                        )
                    )
            write_timing(folder / f"{name}.TextGrid", Timing(speech.track, speech.words))
            truths[name] = _truth(
                speech.track, head.mask.vertices + head.mask.to_pixels(motion.displacements), maps
            )
    return truths


def _truth(track: PhonemeTrack, points: np.ndarray, maps: np.ndarray) -> Truth:
    outer = points[:, OUTER_LIPS]
    extent = np.ptp(outer, axis=1)
    opening = (points[:, LOWER_INNER, 1] - points[:, UPPER_INNER, 1]).max(axis=1)
    lips = np.einsum("nij,nvj->nvi", maps[:, :, :2], outer) + maps[:, None, :, 2]
    return Truth(track, maps, lips, extent[:, 0], extent[:, 1], opening)
