"""What is kept of an analysed clip until the database is assembled: one npz file a clip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.clip import AnalysedClip
from analysis.texture import mean_log
from database.track import PhonemeTrack


@dataclass(frozen=True)
class Shard:
    """A clip's file and the little of it that is wanted at once.

    Parameters
    ----------
    path : Path
    name, words, media, sha256 : str
        As in `database.schema`.
    fps : float
        Recorded frame rate.
    frames, units : int
        Frames of the clip, and those with a face.
    track : PhonemeTrack
    clip_mean : (42, 40, 3) float32
        Mean log picture; see `analysis.texture`.
    notes : tuple of str
        What was repaired.
    given : bool
        Whether the phones were given and not found in the sound.
    """

    path: Path
    name: str
    words: str
    media: str
    sha256: str
    fps: float
    frames: int
    units: int
    track: PhonemeTrack
    clip_mean: npt.NDArray[np.float32]
    notes: tuple[str, ...]
    given: bool


class OpenShard:
    """Arrays of a shard, read when asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        with np.load(self._path, allow_pickle=False) as file:
            return np.asarray(file[name])

    def pictures(self) -> Iterator[bytes]:
        """The encoded crops, in order."""
        lengths = self["picture_length"]
        data = self["picture_data"].tobytes()
        ends = np.cumsum(lengths)
        for start, end in zip(ends - lengths, ends, strict=True):
            yield data[start:end]


def read_shard(path: Path) -> OpenShard:
    """Open a shard."""
    return OpenShard(path)


def write_shard(path: Path, clip: AnalysedClip) -> Shard:
    """Write an analysed clip."""
    np.savez(
        path,
        frame=clip.face.numbers,
        landmarks=clip.face.landmarks,
        rotation=clip.face.poses.rotations,
        translation=clip.face.poses.translations,
        camera=np.array(astuple(clip.face.camera), np.float64),
        mouth_width=clip.lips.width,
        mouth_height=clip.lips.height,
        inner_opening=clip.lips.opening,
        teeth=clip.teeth,
        tongue=clip.tongue,
        reduced=clip.reduced,
        sound=clip.sound,
        picture_length=np.array([len(p) for p in clip.pictures], np.int64),
        picture_data=np.frombuffer(b"".join(clip.pictures), np.uint8),
    )
    return Shard(
        path,
        clip.name,
        clip.alignment.text,
        str(clip.media.resolve()),
        clip.sha256,
        clip.fps,
        clip.face.frames,
        len(clip.face.numbers),
        clip.alignment.track,
        mean_log(clip.reduced),
        (*_missing_frames(clip.face.missing()), *clip.alignment.notes),
        clip.alignment.given,
    )


def _missing_frames(missing: list[int]) -> list[str]:
    if not missing:
        return []
    spans: list[list[int]] = []
    for i in missing:
        if spans and i == spans[-1][1] + 1:
            spans[-1][1] = i
        else:
            spans.append([i, i])
    named = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in spans)
    what = "frame" if len(missing) == 1 else "frames"
    return [f"no face in {what} {named} (counted from 0); left out"]
