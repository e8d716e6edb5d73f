"""A photo of a database's person that lives: blinks and small turns of the head, mouth at rest.

A still background looks dead around a mouth that speaks. The photo is laid under the Talk Mask,
and moved as a portrait that says nothing; what comes out is a video like any other, in which the
head's pose is tracked, so that the mouth goes with it.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np

from analysis.photo import Photo
from analysis.portrait import portrait_of
from database.media import snap_rate
from database.phonemes import SILENCE
from database.track import PhonemeTrack
from database.video_writer import VideoWriter
from render.portrait_scene import PortraitScene
from unitsel.portrait.driver import DriveSettings, drive

Progress = Callable[[str, int, int], None]

CRF: Final = 10
"""Quality of the video, which is encoded again with the mouth on it."""


def living_still(
    photo: str | Path | Photo,
    path: str | Path,
    seconds: float,
    *,
    fps: float | Fraction = 25,
    settings: DriveSettings | None = None,
    models: str | Path | None = None,
    progress: Progress | None = None,
) -> int:
    """Make a video of a photo, in which the person lives but does not speak.

    Parameters
    ----------
    photo : path or Photo
        One face that looks at the camera, its mouth closed.
    path : path
        The video, not there before it is complete. Good as a background
        (`Synthesizer.background`).
    seconds : float
        Its length.
    fps : float
        Frames a second.
    settings : DriveSettings, optional
        Its life, seed and emotion.
    models : path, optional
        Folder with the face models.
    progress : callable, optional

    Returns
    -------
    int
        Frames written.

    Raises
    ------
    MediaError, FaceError
        If the photo cannot be read, or shows no face that can be used.
    RenderError
        If OpenGL cannot be started.
    """
    head = portrait_of(photo, models=models)
    rate = snap_rate(fps)
    silence = PhonemeTrack(np.array([SILENCE]), np.array([0.0, seconds]))
    motion = drive(head.mask, silence, float(rate), settings)
    mask = head.mask
    with (
        PortraitScene(head.photo, mask, head.mouth) as scene,
        VideoWriter(path, mask.width, mask.height, rate, crf=CRF) as video,
    ):
        for i, moved in enumerate(motion.displacements):
            video.write_rgb(scene.picture(moved))
            if progress is not None:
                progress("moving the photo", i + 1, len(motion))
    return len(motion)
