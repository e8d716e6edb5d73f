"""How long a build will take and how much space it needs, told before the work begins.

From the clips that an earlier build has left, if there are any; else a dozen frames are tracked,
cut and encoded as a trial. The rest are shares and sizes measured on GRID (benchmarks/README).
"""

from __future__ import annotations

import itertools
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from analysis.corpus import Clip
from analysis.face import FaceFinder
from analysis.motion import MotionSettings, estimate_poses
from analysis.shards import Shard
from database.errors import DatabaseError, FaceError, UnitselError
from database.mask import Camera, Mask, cut_crop
from database.media import MediaInfo, read_video
from database.pictures import encode

TRIAL_FRAMES: Final = 12

FRAME_SECONDS: Final = 0.03
"""Seconds a frame where no trial is possible."""

WHOLE_TO_TRIAL: Final = 1.2
"""Time of a frame's whole analysis to that of the trial: alignment, gradients, second reading."""

FIT_SECONDS: Final = 2.0
UNIT_FIT_SECONDS: Final = 0.003
"""Seconds for what depends on all clips and for writing: at least, and more for each unit."""

SHARD_BYTES: Final = 42 * 40 * 3 + 468 * 2 * 4 + 200
"""Bytes of a unit in a shard besides its picture: described crop, landmarks, the rest."""

MODEL_BYTES: Final = 800_000
"""Bytes of what does not grow with the units: lip model, rigid surface, mask."""

DATABASE_BYTES: Final = 3700
"""Bytes of a unit in a database besides its picture: packed landmarks, the rest."""

PADDING: Final = 1.25
"""Pictures of a database have room for the longest of them; by how much that is more."""

MARGIN: Final = 1.3
"""A build is refused if it needs less than it might by so much, and still too much."""


@dataclass(frozen=True)
class Estimate:
    """What a build is expected to need.

    Parameters
    ----------
    clips : int
        Clips of the corpus that can be opened.
    reused : int
        Those that an earlier build has analysed.
    frames : int
        Frames to analyse.
    seconds : float
        Time of the build.
    shard_bytes : int
        What the shards will take in the end, those that are there included.
    database_bytes : int
        Size of the database.
    needed_bytes : int
        Free space that is needed at most at a time, besides what is taken already.
    free_bytes : int
        Free space where the database will be.
    """

    clips: int
    reused: int
    frames: int
    seconds: float
    shard_bytes: int
    database_bytes: int
    needed_bytes: int
    free_bytes: int

    def as_json(self) -> dict[str, int | float]:
        """The estimate for machines."""
        return {**vars(self), "seconds": round(self.seconds, 1)}

    def text(self) -> str:
        """The estimate for people, one line."""
        reused = f" ({self.reused} of them analysed already)" if self.reused else ""
        return (
            f"{self.clips} clips{reused}, {self.frames} frames to analyse: about "
            f"{_duration(self.seconds)}, {size_text(self.database_bytes)} of database and "
            f"{size_text(self.shard_bytes)} of kept clips ({size_text(self.free_bytes)} free)"
        )


def estimate_build(
    clips: Sequence[tuple[Clip, MediaInfo]],
    reused: Sequence[Shard],
    n_clips: int,
    *,
    mask: Mask,
    camera: Camera,
    fps: float,
    finder: FaceFinder,
    motion: MotionSettings,
    codec: str,
    jobs: int,
    target: Path,
) -> Estimate:
    """Estimate a build.

    Parameters
    ----------
    clips : sequence of (Clip, MediaInfo)
        Those to analyse.
    reused : sequence of Shard
        Those that need not be.
    n_clips : int
        All clips that can be opened.
    mask, camera, fps, finder, motion, codec, jobs
        Of the build.
    target : Path
        The database.

    Raises
    ------
    DatabaseError
        If there is too little space.
    """
    frames = sum(round(info.duration * fps) for _, info in clips)
    units = sum(s.units for s in reused)
    there = sum(s.path.stat().st_size for s in reused)
    if units and clips:
        each = sum(s.seconds for s in reused) / units
        picture = max(0.0, there / units - SHARD_BYTES)
    elif clips:
        each, picture = _trial([c for c, _ in clips], mask, camera, finder, motion, codec)
    else:
        each, picture = 0.0, max(0.0, there / max(units, 1) - SHARD_BYTES)
    total = units + frames
    new = round(frames * (SHARD_BYTES + picture))
    database = MODEL_BYTES + round(total * (DATABASE_BYTES + PADDING * picture))
    # Pictures are put aside one after another before the database is written.
    needed = new + database + round(total * picture)
    free = shutil.disk_usage(target.parent).free
    if needed > MARGIN * free:
        raise DatabaseError(
            f"{target}: the build needs about {size_text(needed)}, and {size_text(free)} are free "
            "there; free some, choose another place, take fewer clips (--limit), or --codec avif:85"
        )
    workers = min(jobs, max(1, len(clips)))
    seconds = each * frames / workers + FIT_SECONDS + UNIT_FIT_SECONDS * total
    return Estimate(n_clips, len(reused), frames, seconds, there + new, database, needed, free)


def _trial(
    clips: Sequence[Clip],
    mask: Mask,
    camera: Camera,
    finder: FaceFinder,
    motion: MotionSettings,
    codec: str,
) -> tuple[float, float]:
    """Seconds a frame, and bytes a picture, from a few frames of the first clip that has them."""
    for clip in clips[:3]:
        try:
            finder.reset()
            pictures = []
            video = read_video(clip.source)
            # The first frame pays for the start.
            first = next(video).rgb
            finder.find(first)
            started = time.perf_counter()
            for frame in itertools.islice(video, TRIAL_FRAMES):
                mesh = finder.find(frame.rgb)
                if mesh is not None:
                    pictures.append((frame.rgb, mesh.points[:, :2]))
            video.close()
            if not pictures:
                continue
            own = camera.scaled_to(first.shape[1], first.shape[0])
            poses, good = estimate_poses(np.stack([p for _, p in pictures]), mask, own, motion)
            sizes = [
                len(encode(cut_crop(pictures[k][0], mask.patch, poses.matrix(int(k)), own), codec))
                for k in np.flatnonzero(good)
            ]
            each = (time.perf_counter() - started) / len(pictures)
            return WHOLE_TO_TRIAL * each, float(np.mean(sizes))
        except (UnitselError, FaceError, StopIteration):
            continue
    # A compressed mouth seldom takes more than two bytes a pixel.
    return FRAME_SECONDS, 2.0 * mask.patch.crop_width * mask.patch.crop_height


def size_text(count: int) -> str:
    """A number of bytes for people."""
    size = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" or size >= 10 else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    if seconds < 5400:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"
