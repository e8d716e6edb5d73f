"""A background without an end: frame after frame with its pose, for as long as is asked.

Long output goes on through frames that are alike (`render.walk`), each such change blended over a
few frames (`render.morph`).
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from types import TracebackType
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from database.mask import Camera, MouthPatch
from database.media import snap_rate
from database.planes import Colour, Planes, planes_to_rgb
from render.background import Background, Material
from render.background_frames import MEMORY_LIMIT, BackgroundFrames
from render.morph import between_poses, flow_between, morph
from render.similar_frames import Likeness, compare_frames
from render.walk import Step, Ways, find_ways, forth_and_back, walk

LONGEST: Final = 1500
"""Frames of background that a walk goes over; of longer ones the first are taken."""

KEPT: Final = 2
"""Backgrounds whose comparison is kept."""


@dataclass(frozen=True)
class PlayedFrame:
    """A frame of the background as it is shown.

    Parameters
    ----------
    number : int
        Frame of the output, from 0.
    planes : Planes
        Not to be written to.
    pose : (3, 4) float64
        ``[R | t]`` of the head, mm.
    colour : Colour
        Meaning of the planes.
    part, place : int
        Background and frame of it that is shown, or that has the greater share of a blend.
    blended : bool
        Whether it is a blend of two frames.
    """

    number: int
    planes: Planes
    pose: npt.NDArray[np.float64]
    colour: Colour
    part: int
    place: int
    blended: bool = False

    @cached_property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """(height, width, 3) uint8, made on first use."""
        return planes_to_rgb(self.planes, self.colour)


class Playback:
    """An endless iterator over a background's frames at a rate; a context manager.

    Parameters
    ----------
    background : Background
        With the others joined to it.
    fps : float or Fraction
        Frames a second of the output.
    patch : MouthPatch
        Of the person's mask: what the mouth will cover is not compared.
    camera : Camera
        Of the database.
    seed : int
        Of the choice between ways to go on.
    length : int, optional
        Frames that will be taken, where that is known: a background that is long enough is played
        straight on.
    memory : int
        Bytes of decoded frames to keep.

    Attributes
    ----------
    width, height : int
        Of the frames.
    colour : Colour
    camera : Camera
        For the frames.
    notes : tuple of str
        What a user should know of how the background is played on.

    Raises
    ------
    RenderError
        Here, and while it runs if a file has fewer frames than were tracked.
    MediaError
        If a file cannot be read.
    """

    def __init__(
        self,
        background: Background,
        fps: float | Fraction,
        patch: MouthPatch,
        camera: Camera,
        *,
        seed: int = 0,
        length: int | None = None,
        memory: int = MEMORY_LIMIT,
    ) -> None:
        self.fps = float(snap_rate(fps))
        self._ratio = background.fps / self.fps
        self._frames = BackgroundFrames(background.parts, memory)
        form = self._frames.format
        self.width, self.height, self.colour = form.width, form.height, form.colour
        self.camera = camera.scaled_to(form.width, form.height)
        self.notes: tuple[str, ...] = ()
        steps = None if length is None else self._step_of(max(0, length - 1)) + 1
        self._material = Material.of(background, LONGEST if steps is None else max(LONGEST, steps))
        if background.still or (steps is not None and steps <= int(self._material.ends[0])):
            self._steps = forth_and_back(0, int(self._material.ends[0]), 0)
        else:
            self._material = Material.of(background, LONGEST)
            self._steps = self._walk(patch, seed)
        self._number = 0
        self._taken = 0
        self._shown: PlayedFrame | None = None
        self._step = Step(0, 0)

    def _walk(self, patch: MouthPatch, seed: int) -> Iterator[Step]:
        known = _ways_of(self._material, self._frames, patch, self.camera)
        if not known.ways.enough:
            self.notes = (
                f"{self._material.parts[-1].path}: too short or too restless to go on unseen; it "
                "is played forth and back",
            )
        return walk(self._material, known.likeness, known.ways, seed)

    def _step_of(self, number: int) -> int:
        """Step of the walk that an output frame shows, nearest in time."""
        # Halves go to the earlier frame, as in database.media.read_video.
        return max(0, int(np.ceil(number * self._ratio - 0.5 - 1e-6)))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[PlayedFrame]:
        return self

    def __next__(self) -> PlayedFrame:
        number = self._number
        self._number += 1
        wanted = self._step_of(number)
        while self._taken <= wanted:
            self._step = next(self._steps)
            self._taken += 1
            self._shown = None
        if self._shown is None:
            self._shown = self._drawn(self._step)
        return replace(self._shown, number=number)

    def _drawn(self, step: Step) -> PlayedFrame:
        planes, pose = self._own(step.frame), self._material.poses.matrix(step.frame)
        if step.weight:
            other = self._own(step.other)
            flow = flow_between(planes, other)
            planes = morph(planes, other, flow, step.weight)
            pose = between_poses(pose, self._material.poses.matrix(step.other), step.weight)
        nearer = step.other if step.weight > 0.5 else step.frame
        part, place = int(self._material.part[nearer]), int(self._material.place[nearer])
        return PlayedFrame(0, planes, pose, self.colour, part, place, step.weight > 0)

    def _own(self, frame: int) -> Planes:
        return self._frames.planes(
            int(self._material.part[frame]), int(self._material.place[frame])
        )

    def close(self) -> None:
        """Close what is read and forget all frames."""
        self._frames.close()


@dataclass(frozen=True)
class _Known:
    """What is known of a background's frames: how alike they are, and the ways between them."""

    likeness: tuple[Likeness, ...]
    ways: Ways


_known: OrderedDict[bytes, _Known] = OrderedDict()
"""Of the backgrounds played last: comparing their frames again would delay a first frame."""

_lock = threading.Lock()


def _ways_of(
    material: Material, frames: BackgroundFrames, patch: MouthPatch, camera: Camera
) -> _Known:
    digest = hashlib.sha256(repr(camera).encode() + patch.grid.tobytes())
    for part in material.parts:
        changed = part.path.stat().st_mtime_ns
        digest.update(repr((part.path, changed, part.fps, part.first, part.start)).encode())
        digest.update(part.poses.rotations.tobytes() + part.poses.translations.tobytes())
    key = digest.digest()
    with _lock:
        known = _known.get(key)
    if known is None:
        likeness = compare_frames(material, frames, patch, camera)
        known = _Known(likeness, find_ways(material, likeness))
    with _lock:
        _known[key] = known
        _known.move_to_end(key)
        while len(_known) > KEPT:
            _known.popitem(last=False)
    return known
