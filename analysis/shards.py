"""What is kept of an analysed clip until the database is assembled, and for later builds: a shard.

A shard is one file: a line that names the format, the SHA-256 of all that follows, and an npz
archive. It is written beside its place and renamed, and compared with its checksum before it is
used, so that a build never takes half a clip or a damaged one. A clip that cannot be used leaves
a shard, too, which holds the reason.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from analysis.clip import AnalysedClip
from analysis.corpus import Clip
from analysis.texture import mean_log
from database.errors import DatabaseError
from database.outfile import whole_file
from database.track import PhonemeTrack

MAGIC: Final = b"unitsel shard 1\n"
SHARD: Final = ".shard"
REFUSED: Final = ".refused"
"""Ends of the names of an analysed clip's file, and of one that cannot be used."""
_START: Final = len(MAGIC) + hashlib.sha256().digest_size
_ABOUT: Final = "about"


class ShardDamagedError(DatabaseError):
    """A shard's file is not what was written; the clip has to be analysed again."""


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
    start : float
        Seconds at which the clip begins in its media file.
    seconds : float
        How long the analysis took; not part of any database.
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
    start: float
    seconds: float


@dataclass(frozen=True)
class Refusal:
    """A clip that cannot be used, and why."""

    reason: str


class OpenShard:
    """Arrays of a shard, read when asked for, and its document."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        try:
            with self._path.open("rb") as file:
                file.seek(_START)
                with np.load(file, allow_pickle=False) as arrays:
                    return np.asarray(arrays[name])
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ShardDamagedError(
                f"{self._path}: a kept clip cannot be read any more ({error}); build again, and "
                "it is analysed anew"
            ) from error

    @property
    def about(self) -> dict[str, Any]:
        """What is no array."""
        document: dict[str, Any] = json.loads(self[_ABOUT].tobytes())
        return document

    def pictures(self) -> Iterator[bytes]:
        """The encoded crops, in order."""
        lengths = self["picture_length"]
        data = self["picture_data"].tobytes()
        ends = np.cumsum(lengths)
        for start, end in zip(ends - lengths, ends, strict=True):
            yield data[start:end]


def read_shard(path: Path) -> OpenShard:
    """Open a shard that is known to be whole."""
    return OpenShard(path)


def read_checked(path: Path) -> OpenShard | None:
    """Open a file of the shards' format once it has been compared with its checksum.

    Returns
    -------
    OpenShard or None
        None where there is no such file.

    Raises
    ------
    ShardDamagedError
        If the file is not what was written.
    """
    try:
        with path.open("rb") as file:
            start = file.read(_START)
            whole = start[: len(MAGIC)] == MAGIC and (
                hashlib.file_digest(file, "sha256").digest() == start[len(MAGIC) :]
            )
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ShardDamagedError(f"{path}: cannot be read ({error.strerror})") from error
    if not whole:
        raise ShardDamagedError(f"{path}: is damaged")
    return OpenShard(path)


def load_shard(path: Path, clip: Clip) -> Shard | Refusal | None:
    """Read a clip's shard, all of it compared with its checksum.

    Parameters
    ----------
    path : Path
    clip : Clip
        The clip, which may lie elsewhere than when the shard was written.

    Returns
    -------
    Shard, Refusal or None
        None where there is no shard, or where what it says to the user names files that lie
        elsewhere now.

    Raises
    ------
    ShardDamagedError
        If the file is not what was written.
    """
    shard = read_checked(path) or read_checked(path.with_suffix(REFUSED))
    if shard is None:
        return None
    about = shard.about
    refused = "reason" in about
    said = (about["reason"],) if refused else tuple(about["notes"])
    moved = about["files"] != _files(clip)
    if moved and any(file in text for text in said for file in about["files"]):
        return None
    if refused:
        return Refusal(about["reason"])
    return Shard(
        path,
        clip.name,
        about["words"],
        str(clip.media.resolve()),
        about["sha256"],
        about["fps"],
        about["frames"],
        about["units"],
        PhonemeTrack(shard["phoneme"], shard["boundary"], about["track"]),
        shard["clip_mean"],
        said,
        about["given"],
        clip.start,
        about["seconds"],
    )


def write_shard(path: Path, clip: Clip, analysed: AnalysedClip, seconds: float) -> Shard:
    """Write an analysed clip and read back what is wanted at once.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    alignment, face = analysed.alignment, analysed.face
    write_arrays(
        path,
        {
            "files": _files(clip),
            "words": alignment.text,
            "sha256": analysed.sha256,
            "fps": analysed.fps,
            "frames": face.frames,
            "units": len(face.numbers),
            "track": alignment.track.name,
            "notes": [
                *_noted("no face in {}; left out", face.missing()),
                *_noted("head followed by feature points alone in {}", face.by_points()),
                *alignment.notes,
            ],
            "given": alignment.given,
            "seconds": seconds,
        },
        frame=face.numbers,
        landmarks=face.landmarks,
        rotation=face.poses.rotations,
        translation=face.poses.translations,
        camera=np.array(astuple(face.camera), np.float64),
        mouth_width=analysed.lips.width,
        mouth_height=analysed.lips.height,
        inner_opening=analysed.lips.opening,
        teeth=analysed.teeth,
        tongue=analysed.tongue,
        reduced=analysed.reduced,
        sound=analysed.sound,
        phoneme=alignment.track.phonemes,
        boundary=alignment.track.boundaries,
        clip_mean=mean_log(analysed.reduced),
        picture_length=np.array([len(p) for p in analysed.pictures], np.int64),
        picture_data=np.frombuffer(b"".join(analysed.pictures), np.uint8),
    )
    # Read back, so that a clip just analysed and a kept one come the same way.
    written = load_shard(path, clip)
    assert isinstance(written, Shard)
    return written


def write_refusal(path: Path, clip: Clip, reason: str) -> None:
    """Write that a clip cannot be used, beside the place of its shard.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    write_arrays(path.with_suffix(REFUSED), {"files": _files(clip), "reason": reason})


def write_arrays(path: Path, about: Mapping[str, Any], **arrays: npt.NDArray[Any]) -> None:
    """Write arrays and a document as a file of the shards' format, whole or not at all.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    document = np.frombuffer(json.dumps(about).encode(), np.uint8)
    packed = io.BytesIO()
    np.savez(packed, **{_ABOUT: document}, **arrays)  # type: ignore[arg-type]
    with whole_file(path) as file:
        file.write(MAGIC + hashlib.sha256(packed.getbuffer()).digest())
        file.write(packed.getbuffer())


def _files(clip: Clip) -> list[str]:
    return [str(path) for path in (clip.media, *clip.scripts)]


def _noted(note: str, frames: Sequence[int]) -> list[str]:
    """A note on some frames, if there are any."""
    if not frames:
        return []
    spans: list[list[int]] = []
    for i in frames:
        if spans and i == spans[-1][1] + 1:
            spans[-1][1] = i
        else:
            spans.append([i, i])
    named = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in spans)
    what = "frame" if len(frames) == 1 else "frames"
    return [note.format(f"{what} {named} (counted from 0)")]
