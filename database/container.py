"""Opening media files and decoding what can be decoded (PyAV)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import av
from av.audio.stream import AudioStream
from av.container import InputContainer
from av.frame import Frame
from av.stream import Disposition
from av.video.stream import VideoStream

from database.errors import MediaError

av.logging.set_level(None)  # Damage is reported by our errors, not on the user's terminal.

TEXT_DEMUXERS: Final = frozenset({"tty", "bin", "xbin", "adf", "idf"})
"""FFmpeg draws plain text and unknown bytes as pictures with these."""

MARGINS: Final = (0.6, 4.0, 30.0)
"""Seconds before the wanted time that are aimed at in turn, until a file's index leads there."""


@contextmanager
def open_media(path: Path) -> Iterator[InputContainer]:
    """Open a media file for reading.

    Raises
    ------
    MediaError
        If there is no such file, or FFmpeg does not know it as a media file.
    """
    if path.is_dir():
        raise MediaError(f"{path}: is a folder, not a media file")
    if not path.exists():
        raise MediaError(f"{path}: no such file")
    try:
        container = av.open(str(path), metadata_errors="ignore")
    except (av.FFmpegError, OSError, ValueError) as error:
        raise MediaError(
            f"{path}: cannot be read as video or sound ({reason(error)}); "
            "is it a media file, and complete?"
        ) from error
    with container:
        if container.format.name in TEXT_DEMUXERS:
            raise MediaError(f"{path}: is text or data, not a media file")
        yield container


def reason(error: Exception) -> str:
    """What FFmpeg or the system says, without file names and numbers."""
    text = getattr(error, "strerror", None) or str(error)
    return str(text).splitlines()[0] if text else type(error).__name__


def video_stream(container: InputContainer) -> VideoStream | None:
    """The first video stream that can be decoded; a cover picture is none."""
    for stream in container.streams.video:
        if stream.codec_context is not None and not stream.disposition & Disposition.attached_pic:
            return stream
    return None


def sound_stream(container: InputContainer) -> AudioStream | None:
    """The first sound stream that can be decoded."""
    for stream in container.streams.audio:
        if stream.codec_context is not None and stream.rate:
            return stream
    return None


def decoded(
    container: InputContainer, *streams: VideoStream | AudioStream
) -> Iterator[tuple[int, Frame]]:
    """Decode streams together; what is damaged is left out.

    Yields
    ------
    (int, Frame)
        Index of the stream, and a frame of it, in the order of decoding.
    """
    packets = container.demux(*streams)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except av.FFmpegError:
            break
        try:
            frames = packet.decode()
        except av.FFmpegError:
            continue
        for frame in frames:
            if isinstance(frame, Frame):
                yield packet.stream_index, frame
    # The file ends in damage: give out what the decoders still hold.
    for stream in streams:
        try:
            held = stream.decode(None)
        except av.FFmpegError:
            continue
        for frame in held:
            yield stream.index, frame


def frames_from(
    path: Path,
    choose: Callable[[InputContainer], VideoStream | AudioStream | None],
    time: float | None,
) -> Iterator[Frame]:
    """Decode one stream from some time on.

    The first frame given out is at or before `time`, by `MARGINS` where the file allows it:
    decoders need a run-up. Without a time, or where no seeking helps, from the front.

    Parameters
    ----------
    path : Path
    choose : callable
        The stream of a container; None ends the reading.
    time : float, optional
        Seconds, on the clock of the file's time stamps.

    Raises
    ------
    MediaError
        If the file cannot be read.
    """
    for margin in (*MARGINS, None) if time is not None else (None,):
        with open_media(path) as container:
            stream = choose(container)
            if stream is None:
                return
            if margin is not None and time is not None:
                try:
                    container.seek(round((time - margin) * av.time_base))
                except av.FFmpegError:
                    continue
            frames = (frame for _, frame in decoded(container, stream))
            first = next(frames, None)
            if first is None and margin is None:
                return
            if margin is not None and (
                first is None or first.time is None or time is None or first.time > time
            ):
                continue
            if first is not None:
                yield first
            yield from frames
            return
