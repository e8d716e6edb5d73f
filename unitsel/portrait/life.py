"""What a face does beside speaking: blinks, small turns of the head, a little unrest.

Image Talk, sections 5.3 to 5.5. All of it comes from one seed, so that the same sentence makes the
same video twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.portrait_mesh import FRAME, GENERIC, HEAD, N_MASK
from database.track import frame_times

F64 = npt.NDArray[np.float64]

BLINK_LENGTH: Final = (0.1, 0.2)
"""Seconds that a blink takes, from open to open."""

DOUBLE: Final = 0.12
"""Share of blinks that are followed by another at once."""

_SLOW: Final = (0.08, 0.45)
"""Hertz of head motion."""

_UNREST: Final = (0.3, 1.4)
"""Hertz of the perturbation."""

_REFERENCE_UNIT: Final = 100.0
"""Pixels between the outer eye corners of the paper's pictures of 200 x 300, about."""


@dataclass(frozen=True)
class LifeSettings:
    """How lively a face is.

    Parameters
    ----------
    blink_every : float
        Mean seconds between blinks; 0 for none.
    turn : float
        Usual turn of the head to the sides, degrees; nods and tilts are smaller.
    shift : float
        Usual shift of the head, in the mask's unit.
    perturbation : float
        Pixels by which the skin is stirred, in a picture whose outer eye corners lie 100 pixels
        apart (the paper's 1 to 3 pixels at 200 x 300).

    Raises
    ------
    ValueError
        If one is negative.
    """

    blink_every: float = 3.5
    turn: float = 1.6
    shift: float = 0.008
    perturbation: float = 1.0

    def __post_init__(self) -> None:
        if min(self.blink_every, self.turn, self.shift, self.perturbation) < 0:
            raise ValueError("blinks, turn, shift and perturbation must not be negative")


def blinks(
    n: int, fps: float, every: float, random: np.random.Generator, start: float = 0.0
) -> F64:
    """How far the eyes are shut in each frame.

    Each blink lasts 100 to 200 ms, and is quite shut in the frame at its middle, whatever the
    frame rate. `start` is the time of the first frame in a life that began before: blinks go on
    from one utterance to the next.

    Returns
    -------
    (n,) float64
        0 for open, 1 for shut.
    """
    out = np.zeros(n)
    if every <= 0:
        return out
    times = start + frame_times(n, fps)
    end = start + n / fps
    at = random.uniform(0.15, 1.0) * every
    while at < end - BLINK_LENGTH[0]:
        length = random.uniform(*BLINK_LENGTH)
        middle = times[min(n - 1, int((at - start) * fps))] if at >= start else at
        # Down faster than up, and shut for a moment.
        away = times - middle
        side = np.where(away < 0, 0.42, 0.58) * length
        out = np.maximum(out, np.clip(1.2 * (1 - np.abs(away) / side), 0, 1))
        double = random.random() < DOUBLE
        at += random.uniform(0.28, 0.4) if double else every * random.uniform(0.6, 1.4)
    return out


def wander(
    n: int,
    fps: float,
    channels: int,
    hertz: tuple[float, float],
    random: np.random.Generator,
    start: float = 0.0,
) -> F64:
    """Smooth unrest: sums of slow waves, of mean square 1.

    Returns
    -------
    (n, channels) float64
    """
    waves = 6
    low, high = hertz
    # Spread over the band, so that no channel is one wave alone.
    edges = np.linspace(low, high, waves + 1)
    frequency = random.uniform(edges[:-1, None], edges[1:, None], (waves, channels))
    phase = random.uniform(0, 2 * np.pi, (waves, channels))
    size = 1 / frequency**0.5
    size *= np.sqrt(2 / (size**2).sum(axis=0))
    t = start + frame_times(n, fps)[:, None, None]
    return np.asarray((size * np.sin(2 * np.pi * frequency * t + phase)).sum(axis=1))


def _depths() -> F64:
    """How far each vertex lies before the axis that a head turns about, units, (V,)."""
    x, y = GENERIC.T
    dome = np.maximum(0.0, 1 - (x / 0.98) ** 2 - ((y - 0.3) / 1.35) ** 2)
    out = 0.75 * np.sqrt(dome)
    down = np.clip((y + 0.1) / 0.45, 0, 1)
    nose = np.where(y < 0.36, down, np.clip((0.53 - y) / 0.15, 0, 1))
    out += 0.24 * nose * np.exp(-((x / 0.11) ** 2))
    out[HEAD], out[FRAME] = 0.05, 0.0
    return np.asarray(out)


def _holding() -> F64:
    """What part of the head's motion each vertex does, (V,): the neck little, the frame nothing."""
    out = np.ones(N_MASK)
    out[FRAME] = 0.0
    neck = HEAD[GENERIC[HEAD, 1] > 1.0]
    out[neck] = 0.25
    return out


DEPTHS: Final = _depths()
HOLDING: Final = _holding()
PIVOT: Final = np.array([0.0, 1.35])
"""Where the head tilts, in the mask's frame: the neck."""


def head_motion(
    n: int,
    fps: float,
    settings: LifeSettings,
    random: np.random.Generator,
    start: float = 0.0,
) -> F64:
    """Small turns and shifts of the head as displacements of vertices (section 5.3).

    Returns
    -------
    (n, V, 2) float64
        Of all vertices but the frame's; near ones more than far ones when the head turns.
    """
    turn = np.radians(settings.turn) * wander(n, fps, 3, _SLOW, random, start)
    yaw, nod, tilt = turn[:, 0], 0.6 * turn[:, 1], 0.5 * turn[:, 2]
    shift = settings.shift * wander(n, fps, 2, _SLOW, random, start)
    out = np.empty((n, N_MASK, 2))
    from_neck = GENERIC - PIVOT
    out[..., 0] = yaw[:, None] * DEPTHS - tilt[:, None] * from_neck[:, 1] + shift[:, :1]
    out[..., 1] = nod[:, None] * DEPTHS + tilt[:, None] * from_neck[:, 0] + shift[:, 1:]
    return np.asarray(out * HOLDING[:, None])


def unrest(
    n: int,
    fps: float,
    settings: LifeSettings,
    random: np.random.Generator,
    start: float = 0.0,
) -> F64:
    """The perturbation of section 5.5: the skin is stirred a little, smoothly in place and time.

    Returns
    -------
    (n, V, 2) float64
        Vertices in one place are moved alike, so that closed lips stay closed.
    """
    centres = np.array([[x, y] for y in (-0.35, 0.1, 0.55, 1.0) for x in (-0.6, -0.2, 0.2, 0.6)])
    apart = ((GENERIC[:, None] - centres[None]) ** 2).sum(axis=2)
    near = np.exp(-apart / (2 * 0.28**2))
    near /= np.sqrt((near**2).sum(axis=1, keepdims=True)) + 0.3
    near[HEAD], near[FRAME] = 0.0, 0.0
    waves = wander(n, fps, 2 * len(centres), _UNREST, random, start).reshape(n, len(centres), 2)
    size = settings.perturbation / _REFERENCE_UNIT
    return np.asarray(size * np.einsum("vc,ncd->nvd", near, waves) / 1.5)
