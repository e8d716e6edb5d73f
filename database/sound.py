"""Sound in: decoded, aligned with the picture, at the rate that is asked for.

Time zero is the first frame of the video where the file has one, else the first sample.
Samples are float32, full scale -1 to 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import av
import numpy as np
import numpy.typing as npt
from av.audio.frame import AudioFrame
from av.audio.resampler import AudioResampler

from database.container import frames_from, open_media, reason, sound_stream, video_stream
from database.errors import MediaError
from database.media_index import index_of
from database.piece import Source, piece_of

FloatArray = npt.NDArray[np.float32]

SPEECH_RATE: Final = 16000
"""Samples a second for everything that listens to speech."""

LARGEST_JITTER: Final = 0.05
"""Seconds: time stamps that leap further than this leave silence, or cut what overlaps."""

LARGEST_OFFSET: Final = 600.0
"""Seconds: sound that claims to start later than this after the picture has a broken clock."""


@dataclass(frozen=True)
class Sound:
    """Mono sound.

    Parameters
    ----------
    samples : (n,) float32
        Full scale -1 to 1; sample i is at ``i / rate`` seconds.
    rate : int
        Samples a second.
    """

    samples: FloatArray
    rate: int

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return len(self.samples) / self.rate


def read_sound(source: Source, rate: int | None = SPEECH_RATE) -> Sound:
    """Read the sound of a media file as mono, aligned with its video's first frame.

    Parameters
    ----------
    source : path or Piece
        Video or sound file, or a piece of one: its sound begins at the piece's start.
    rate : int, optional
        Samples a second; None keeps the file's own.

    Raises
    ------
    MediaError
        If the file cannot be read or holds no sound.
    """
    piece = piece_of(source)
    own_rate, _ = sound_format(piece.path)
    wanted = own_rate if rate is None else rate
    chunks = list(iter_sound(piece, wanted, "mono"))
    samples = np.concatenate(chunks, axis=1)[0] if chunks else np.zeros(0, np.float32)
    if len(samples) == 0:
        raise MediaError(f"{piece}: its sound cannot be decoded; is the file complete?")
    return Sound(samples, wanted)


def resampled(sound: Sound, rate: int) -> Sound:
    """The same sound at another rate.

    Parameters
    ----------
    sound : Sound
    rate : int
        Samples a second.
    """
    if sound.rate == rate:
        return sound
    resampler = AudioResampler(format="fltp", layout="mono", rate=rate)
    given = np.ascontiguousarray(sound.samples, dtype=np.float32)[None]
    frame = AudioFrame.from_ndarray(given, format="fltp", layout="mono")
    frame.sample_rate = sound.rate
    pieces = [f.to_ndarray()[0] for part in (frame, None) for f in resampler.resample(part)]
    return Sound(np.concatenate(pieces).astype(np.float32), rate)


def probe_sound_duration(path: str | Path) -> float:
    """Length of a file's sound in seconds, from time zero; it is decoded to be sure.

    Raises
    ------
    MediaError
        As `read_sound`.
    """
    rate, layout = sound_format(path)
    n = sum(chunk.shape[1] for chunk in iter_sound(path, rate, layout))
    if n == 0:
        raise MediaError(f"{path}: its sound cannot be decoded; is the file complete?")
    return float(n / rate)


def sound_format(path: str | Path) -> tuple[int, str]:
    """Sample rate and channel layout (FFmpeg's name) of a file's sound.

    Raises
    ------
    MediaError
        If the file cannot be read or holds no sound.
    """
    path = Path(path)
    with open_media(path) as container:
        stream = sound_stream(container)
        if stream is None:
            raise MediaError(f"{path}: holds no sound")
        # Files that say only how many channels they have mean the usual ones.
        usual = {"1 channels": "mono", "2 channels": "stereo"}
        return int(stream.rate), usual.get(stream.layout.name, stream.layout.name)


def iter_sound(source: Source, rate: int, layout: str) -> Iterator[FloatArray]:
    """Decode the sound of a file, or of a piece of one, bit by bit from time zero.

    Gaps of the recording are silence, so that later sound keeps its time.

    Parameters
    ----------
    source : path or Piece
    rate : int
        Samples a second to resample to.
    layout : str
        Channel layout to mix to, FFmpeg's name.

    Yields
    ------
    (channels, n) float32

    Raises
    ------
    MediaError
        If the file cannot be read or holds no sound.
    """
    piece = piece_of(source)
    path = piece.path
    zero = _video_start(path)
    skip = 0
    if piece.start > 0 and zero is not None and index_of(path).steady:
        frames = _native_frames(path, zero + piece.start)
        zero += piece.start
    else:
        frames = _native_frames(path, None)
        skip = round(piece.start * rate)
    left = None if piece.end is None else round((piece.end - piece.start) * rate)
    for chunk in _resampled(_on_time(frames, zero), path, rate, layout):
        kept = chunk[:, skip:]
        skip = max(0, skip - chunk.shape[1])
        if left is not None:
            kept = kept[:, :left]
            left -= kept.shape[1]
        if kept.shape[1]:
            yield kept
        if left == 0:
            return


def _resampled(
    frames: Iterator[AudioFrame], path: Path, rate: int, layout: str
) -> Iterator[FloatArray]:
    # Mixing is scaled so that full-scale channels cannot add up to more than full scale.
    resampler = AudioResampler(
        format="fltp", layout=layout, rate=rate, options={"rematrix_maxval": "1.0"}
    )
    try:
        for piece in frames:
            for frame in resampler.resample(piece):
                yield np.asarray(frame.to_ndarray(), dtype=np.float32)
        for frame in resampler.resample(None):
            yield np.asarray(frame.to_ndarray(), dtype=np.float32)
    except av.FFmpegError as error:
        raise MediaError(
            f"{path}: its sound cannot be converted to {rate} Hz {layout} ({reason(error)})"
        ) from error


def _video_start(path: Path) -> float | None:
    """Time stamp of the first video frame, seconds; None without video."""
    frame = next(frames_from(path, video_stream, None), None)
    return None if frame is None else frame.time


def _native_frames(path: Path, time: float | None) -> Iterator[AudioFrame]:
    """Sound frames of one format, from some time on or from the front.

    A stream that changes its format in the middle ends there.
    """
    with open_media(path) as container:
        if sound_stream(container) is None:
            raise MediaError(f"{path}: holds no sound")
    kind: tuple[str, str, int] | None = None
    for frame in frames_from(path, sound_stream, time):
        if not isinstance(frame, AudioFrame) or frame.samples == 0:
            continue
        own = (frame.format.name, frame.layout.name, frame.sample_rate)
        if kind is None:
            kind = own
        if own != kind:
            return
        yield frame


def _on_time(frames: Iterator[AudioFrame], zero: float | None) -> Iterator[AudioFrame]:
    """Cut or pad frames so that the first sample given out is at time `zero`."""
    place: int | None = None  # Samples given out since time zero.
    for frame in frames:
        rate = frame.sample_rate
        if place is None:
            place = 0
            if zero is None:
                zero = frame.time
        start = place
        if frame.time is not None and zero is not None:
            stamp = round((frame.time - zero) * rate)
            jitter = 0 if place == 0 else LARGEST_JITTER * rate
            if abs(stamp - place) > jitter and abs(stamp - place) < LARGEST_OFFSET * rate:
                start = stamp
        if start > place:
            yield _silence(frame, start - place)
            place = start
        piece = frame if start == place else _tail(frame, place - start)
        if piece is not None:
            place += piece.samples
            piece.pts = None  # The resampler is to count samples, not to trust the stamps.
            yield piece


def _like(frame: AudioFrame, samples: npt.NDArray[np.generic]) -> AudioFrame:
    out = AudioFrame.from_ndarray(
        np.ascontiguousarray(samples), format=frame.format.name, layout=frame.layout.name
    )
    out.sample_rate = frame.sample_rate
    return out


def _silence(frame: AudioFrame, n: int) -> AudioFrame:
    """Silence of the frame's format (unsigned 8 bit has its middle at 128)."""
    shape = frame.to_ndarray().shape
    width = n if frame.format.is_planar else n * (shape[1] // frame.samples)
    middle = 128 if frame.format.name.startswith("u8") else 0
    return _like(frame, np.full((shape[0], width), middle, dtype=frame.to_ndarray().dtype))


def _tail(frame: AudioFrame, skip: int) -> AudioFrame | None:
    """The frame without its first samples; None where nothing is left."""
    if skip >= frame.samples:
        return None
    samples = frame.to_ndarray()
    per_sample = 1 if frame.format.is_planar else samples.shape[1] // frame.samples
    return _like(frame, samples[:, skip * per_sample :])
