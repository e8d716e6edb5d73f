"""What the mouth is laid on: stretches of videos with the head's pose in every frame, or a photo.

A background is the longest stretch of a clip in which the face was seen in every frame. How
several of them are played, for any length, is told in `render.playback`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mask import Poses
from database.piece import Piece

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Background:
    """Frames to lay the mouth on.

    Parameters
    ----------
    path : Path
        Video file.
    fps : float
        Frame rate that `first` and the poses count in.
    first : int
        Number of the first frame used, counted from `start`.
    poses : Poses
        Head pose of each frame from there on.
    start : float
        Seconds at which the tracked piece begins in the file.
    still : bool
        Whether the file is a photo, which has one pose.
    more : tuple of Background
        Others to go on with, joined to this one; their own `more` is empty.
    """

    path: Path
    fps: float
    first: int
    poses: Poses
    start: float = 0.0
    still: bool = False
    more: tuple[Background, ...] = ()

    @property
    def source(self) -> Piece:
        """What is to be read: the file, or the piece of it that was tracked."""
        return Piece(self.path, self.start)

    @property
    def parts(self) -> tuple[Background, ...]:
        """The background and those joined to it, each alone."""
        return (replace(self, more=()), *self.more)

    @classmethod
    def joined(cls, backgrounds: Sequence[Background]) -> Background:
        """Several backgrounds as one, to be played one after another (`render.playback`).

        Raises
        ------
        RenderError
            If there is none.
        """
        parts = [part for background in backgrounds for part in background.parts]
        if not parts:
            raise RenderError("no background was given")
        return replace(parts[0], more=tuple(parts[1:]))

    def __len__(self) -> int:
        return len(self.poses)

    @classmethod
    def from_tracked(
        cls,
        path: str | Path,
        fps: float,
        frames: npt.NDArray[np.integer],
        poses: Poses,
        start: float = 0.0,
    ) -> Background:
        """Take the longest run of frames in which the face was seen.

        Parameters
        ----------
        path : path
            Video file.
        fps : float
            Frame rate that `frames` counts in.
        frames : (n,) int
            Numbers of the frames with a face, rising.
        poses : Poses
            Pose of each; one that is not finite counts as no face.
        start : float
            Seconds in the file at which the frames are counted from 0.

        Raises
        ------
        RenderError
            If no frame shows a face.
        """
        numbers = np.asarray(frames, dtype=np.int64)
        if len(numbers) != len(poses):
            raise RenderError(f"{path}: {len(poses)} poses for {len(numbers)} frames")
        known = np.flatnonzero(
            np.isfinite(poses.rotations).all(axis=1) & np.isfinite(poses.translations).all(axis=1)
        )
        if len(known) == 0:
            raise RenderError(f"{path}: shows no face, so it cannot be a background")
        begin, stop = longest_run(numbers[known])
        run = known[begin:stop]
        kept = Poses(poses.rotations[run], poses.translations[run])
        return cls(Path(path), float(fps), int(numbers[run[0]]), kept, start)


@dataclass(frozen=True)
class Material:
    """The frames of backgrounds that are played together, one after another, at one rate.

    Parameters
    ----------
    parts : tuple of Background
    fps : float
        Rate: the first one's.
    part, place : (n,) int64
        Background and frame of it (as `Background.poses` counts) of each of the n frames.
    poses : Poses of length n
    """

    parts: tuple[Background, ...]
    fps: float
    part: IntArray
    place: IntArray
    poses: Poses

    def __len__(self) -> int:
        return len(self.part)

    @property
    def ends(self) -> IntArray:
        """End of each frame's background: the number after its last frame, (n,)."""
        stops = np.cumsum(np.bincount(self.part))
        return np.asarray(stops[self.part], dtype=np.int64)

    @classmethod
    def of(cls, background: Background, longest: int) -> Material:
        """All frames of a background and those joined to it, other rates conformed to the first's.

        Parameters
        ----------
        background : Background
        longest : int
            Frames that are taken at most: the first ones of each background, shared out evenly.
        """
        parts = background.parts
        share = max(1, longest // len(parts))
        part, place = [], []
        for k, own in enumerate(parts):
            ratio = own.fps / background.fps
            n = min(share, max(1, int(np.floor((len(own) - 1) / ratio + 1e-6)) + 1))
            # Halves go to the earlier frame, as in database.media.read_video.
            at = np.ceil(np.arange(n) * ratio - 0.5 - 1e-6).astype(np.int64)
            part.append(np.full(n, k, dtype=np.int64))
            place.append(np.clip(at, 0, len(own) - 1))
        poses = Poses(
            np.concatenate([own.poses.rotations[at] for own, at in zip(parts, place, strict=True)]),
            np.concatenate(
                [own.poses.translations[at] for own, at in zip(parts, place, strict=True)]
            ),
        )
        return cls(parts, background.fps, np.concatenate(part), np.concatenate(place), poses)


def longest_run(numbers: npt.NDArray[np.integer]) -> tuple[int, int]:
    """Find the longest run of consecutive numbers, the first of equals.

    Parameters
    ----------
    numbers : (n,) int
        Rising; at least one.

    Returns
    -------
    (start, stop) : tuple of int
        Places in `numbers`.
    """
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    starts = np.concatenate([[0], breaks])
    stops = np.concatenate([breaks, [len(numbers)]])
    best = int(np.argmax(stops - starts))
    return int(starts[best]), int(stops[best])
