"""Which containers, codecs and qualities a video can be written in.

A file's suffix says the container, and the container a codec where none is asked for. Qualities are
each encoder's own constant rate factor: lower is better and larger.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import av

from database.errors import MediaError


@dataclass(frozen=True)
class VideoCodec:
    """One way to encode pictures.

    Parameters
    ----------
    name : str
        As the command line knows it.
    encoder : str
        FFmpeg's name.
    pixels : str
        FFmpeg's name of the samples that the encoder takes.
    crf : int, optional
        Usual quality, hard to tell from the input; None where there is no such number.
    worst : int
        Largest quality number that the encoder knows.
    options : dict of str to str
        What the encoder is told beside it.
    """

    name: str
    encoder: str
    pixels: str = "yuv420p"
    crf: int | None = None
    worst: int = 0
    options: Mapping[str, str] = field(default_factory=dict)

    def settings(self, crf: int | None = None) -> dict[str, str]:
        """Options of the encoder for a quality, the usual one by default."""
        chosen = self.crf if crf is None else crf
        return {**self.options, **({} if chosen is None else {"crf": str(chosen)})}


_VP9: Final = {"b": "0", "deadline": "realtime", "cpu-used": "6", "row-mt": "1"}

CODECS: Final[dict[str, VideoCodec]] = {
    codec.name: codec
    for codec in (
        # veryfast: a third of medium's time; at one CRF 0.9 dB and a sixth of the bytes less.
        VideoCodec("h264", "libx264", crf=18, worst=51, options={"preset": "veryfast"}),
        VideoCodec("vp9", "libvpx-vp9", crf=22, worst=63, options=_VP9),
        VideoCodec("av1", "libsvtav1", crf=22, worst=63, options={"preset": "8"}),
        VideoCodec("ffv1", "ffv1", options={"level": "3", "slicecrc": "1"}),
    )
}

ALPHA_CODECS: Final[dict[str, VideoCodec]] = {
    codec.name: codec
    for codec in (
        VideoCodec("prores4444", "prores_ks", "yuva444p10le", options={"profile": "4444"}),
        VideoCodec(
            "vp9",
            "libvpx-vp9",
            "yuva420p",
            crf=18,
            worst=63,
            # The encoder refuses to look ahead where there is alpha.
            options={**_VP9, "auto-alt-ref": "0"},
        ),
        VideoCodec("ffv1", "ffv1", "bgra", options={"level": "3", "slicecrc": "1"}),
    )
}
"""Codecs that carry transparency."""


@dataclass(frozen=True)
class Container:
    """A kind of file.

    Parameters
    ----------
    format : str
        FFmpeg's name of the muxer.
    codecs : tuple of str
        Codecs of `CODECS` that it takes, the default first.
    alpha : tuple of str
        Codecs of `ALPHA_CODECS` that it takes, the default first.
    sound : str
        FFmpeg's name of the encoder for sound that cannot be taken over as it is.
    copied : frozenset of str
        Sound codecs whose packets are taken over untouched (FFmpeg's names).
    options : dict of str to str
        For the muxer.
    """

    format: str
    codecs: tuple[str, ...]
    alpha: tuple[str, ...]
    sound: str
    copied: frozenset[str]
    options: Mapping[str, str] = field(default_factory=dict)


_ISO: Final = frozenset({"aac", "mp3", "ac3", "eac3", "alac", "opus", "flac"})
_FAST_START: Final = {"movflags": "+faststart"}
_MP4: Final = Container("mp4", ("h264", "vp9", "av1"), (), "aac", _ISO, _FAST_START)

CONTAINERS: Final[dict[str, Container]] = {
    ".mp4": _MP4,
    ".m4v": _MP4,
    ".mov": Container(
        "mov",
        ("h264",),
        ("prores4444",),
        "aac",
        frozenset({"aac", "mp3", "ac3", "alac", "pcm_s16le", "pcm_s24le"}),
        {"movflags": "+faststart+use_metadata_tags"},  # QuickTime has no description otherwise.
    ),
    ".webm": Container("webm", ("vp9", "av1"), ("vp9",), "libopus", frozenset({"opus", "vorbis"})),
    ".mkv": Container(
        "matroska",
        ("h264", "vp9", "av1", "ffv1"),
        ("ffv1", "vp9"),
        "aac",
        _ISO | {"vorbis", "pcm_s16le", "pcm_s24le", "pcm_f32le"},
    ),
}
"""File suffixes that can be written."""

CODEC_NAMES: Final = tuple(dict.fromkeys([*CODECS, *ALPHA_CODECS]))
"""Every name that can be asked for."""


def container_of(path: Path) -> Container:
    """Find the container that a suffix asks for.

    Raises
    ------
    MediaError
        If there is none.
    """
    try:
        return CONTAINERS[path.suffix.lower()]
    except KeyError:
        raise MediaError(
            f"{path}: videos are written as {', '.join(CONTAINERS)}, not {path.suffix or 'so'!r}"
        ) from None


def find_codec(
    path: Path, name: str | None = None, *, crf: int | None = None, alpha: bool = False
) -> VideoCodec:
    """Find the codec of a file that is to be written.

    Parameters
    ----------
    path : Path
        Its suffix says the container.
    name : str, optional
        The container's own by default.
    crf : int, optional
        Quality that is asked for.
    alpha : bool
        Whether the pictures are transparent in part.

    Raises
    ------
    MediaError
        If the container does not take the codec, the codec has no such quality, or this FFmpeg was
        built without the encoder.
    """
    container = container_of(path)
    kinds, names = (ALPHA_CODECS, container.alpha) if alpha else (CODECS, container.codecs)
    if not names:
        able = ", ".join(suffix for suffix, c in CONTAINERS.items() if c.alpha)
        raise MediaError(
            f"{path}: {path.suffix} holds no transparency; use {able}, or a folder of pictures"
        )
    chosen = name or names[0]
    if chosen not in names:
        raise MediaError(
            f"{path}: {path.suffix} with{' transparent' if alpha else ''} {chosen} is not written; "
            f"choose {' or '.join(names)}"
        )
    codec = kinds[chosen]
    if crf is not None and codec.crf is None:
        raise MediaError(f"{path}: {chosen} has no CRF; leave it out")
    if crf is not None and not 0 <= crf <= codec.worst:
        raise MediaError(f"{path}: {chosen}'s CRF goes from 0 to {codec.worst}, not {crf}")
    try:
        av.codec.Codec(codec.encoder, "w")
    except av.FFmpegError as error:
        raise MediaError(
            f"{path}: this FFmpeg was built without {codec.encoder}; choose another codec"
        ) from error
    return codec
