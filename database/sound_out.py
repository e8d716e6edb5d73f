"""The sound of a video that is written: packets taken over untouched, or samples to encode.

Sound starts with the picture. Packets of a file keep what they hold and only get new times; they
end with the video, to the packet. Samples end with it exactly, and are lengthened by silence.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Final

import av
import numpy as np
import numpy.typing as npt
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.packet import Packet

from database.container import frames_from, open_media, sound_stream, video_stream
from database.errors import MediaError
from database.sound import Sound, iter_sound, resampled, sound_format
from database.video_codecs import Container

AAC_RATES: Final = (
    *(8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000, 64000, 88200, 96000),
)
"""Sample rates that AAC has."""

OPUS_RATES: Final = (48000,)

BITS_PER_CHANNEL: Final = 96_000

KEPT_LAYOUTS: Final = frozenset({"mono", "stereo"})
"""Channel layouts that are kept when sound is encoded; others are mixed to stereo."""

FloatArray = npt.NDArray[np.float32]


class SoundQueue:
    """Sound that becomes known while the video is written.

    Parameters
    ----------
    rate : int
        Samples a second of all that will come.
    """

    def __init__(self, rate: int) -> None:
        self.rate = rate
        self.total = 0
        """Samples that have come."""
        self._pieces: deque[FloatArray] = deque()

    def put(self, samples: FloatArray) -> None:
        """Add (n,) float32 samples behind those that came before."""
        if len(samples):
            self._pieces.append(np.asarray(samples, dtype=np.float32))
            self.total += len(samples)

    def __iter__(self) -> Iterator[FloatArray]:
        """What has come and was not taken yet, (1, n) each."""
        while self._pieces:
            yield self._pieces.popleft()[None]


SoundInput = str | Path | Sound | SoundQueue


class CopiedSound:
    """Packets of a file, as they are.

    Parameters
    ----------
    path : Path
    container : OutputContainer
        What they go into.
    """

    def __init__(self, path: Path, container: OutputContainer) -> None:
        self._container = container
        self._packets = _packets(path)
        self.end = 0.0
        """Seconds of the video at which the sound that was written ends."""
        self._next: tuple[float, Packet[AudioStream]] | None = None
        with open_media(path) as source:
            given = sound_stream(source)
            if given is None:
                raise MediaError(f"{path}: holds no sound")
            self._stream = container.add_stream_from_template(given)

    @staticmethod
    def possible(path: Path, container: Container) -> bool:
        """Whether the container takes the sound of a file as it is.

        Raises
        ------
        MediaError
            If the file cannot be read or holds no sound.
        """
        with open_media(path) as source:
            stream = sound_stream(source)
            if stream is None:
                raise MediaError(f"{path}: holds no sound")
            return stream.codec_context.codec.canonical_name in container.copied

    def write(self, until: Fraction, *, final: bool) -> None:
        """Mux what begins before a time, seconds of the video."""
        while True:
            if self._next is None:
                self._next = next(self._packets, None)
            if self._next is None or self._next[0] >= until:
                return
            start, packet = self._next
            length = (packet.duration or 0) * (packet.time_base or Fraction(0))
            self.end = max(self.end, start + float(length))
            packet.stream = self._stream
            self._container.mux(packet)
            self._next = None

    def close(self) -> None:
        """Close the file."""
        self._packets.close()


class EncodedSound:
    """Samples on demand, encoded.

    Parameters
    ----------
    sound : path, Sound or SoundQueue
    container : OutputContainer
        What it goes into.
    encoder : str
        FFmpeg's name.

    Raises
    ------
    MediaError
        If a file cannot be read or holds no sound.
    """

    def __init__(self, sound: SoundInput, container: OutputContainer, encoder: str) -> None:
        self.rate, self.layout, pieces = _samples(sound, encoder)
        self.channels = 1 if self.layout == "mono" else 2
        self._place = 0
        self._held = np.zeros((self.channels, 0), dtype=np.float32)
        self._pieces = pieces
        self._container = container
        stream = container.add_stream(encoder, rate=self.rate)
        if not isinstance(stream, AudioStream):
            raise ValueError(f"{encoder} is not a sound encoder")
        stream.codec_context.layout = self.layout
        stream.codec_context.format = "flt" if encoder == "libopus" else "fltp"
        stream.codec_context.bit_rate = BITS_PER_CHANNEL * self.channels
        stream.codec_context.time_base = Fraction(1, self.rate)
        if encoder == "aac":
            # The usual search takes ten times as long, and on speech is no nearer to the sound.
            stream.codec_context.options = {"aac_coder": "fast"}
        self._stream = stream

    @property
    def end(self) -> float:
        """Seconds of the video at which the sound that was written ends."""
        return self._place / self.rate

    def write(self, until: Fraction, *, final: bool) -> None:
        """Encode up to a time, seconds of the video; at the end, silence for what is missing."""
        target = round(until * self.rate)
        size = self._stream.codec_context.frame_size or 1024
        while self._place < target:
            n = min(size, target - self._place)
            if n < size and not final:
                break
            samples = self._take(n, fill=final)
            if samples is None:
                break
            frame = AudioFrame.from_ndarray(samples, format="fltp", layout=self.layout)
            frame.pts = self._place - n
            frame.sample_rate = self.rate
            frame.time_base = Fraction(1, self.rate)
            self._container.mux(self._stream.encode(frame))
        if final:
            self._container.mux(self._stream.encode(None))

    def close(self) -> None:
        """Let go of the input."""
        close = getattr(self._pieces, "close", None)
        if close is not None:
            close()

    def _take(self, n: int, *, fill: bool) -> FloatArray | None:
        """Take the next n samples, (channels, n); None where they have not come yet."""
        pieces, held = [self._held], self._held.shape[1]
        while held < n:
            piece = next(iter(self._pieces), None)
            if piece is None:
                if not fill and isinstance(self._pieces, SoundQueue):
                    self._held = np.concatenate(pieces, axis=1)
                    return None
                piece = np.zeros((self.channels, n - held), dtype=np.float32)
            pieces.append(piece)
            held += piece.shape[1]
        joined = np.concatenate(pieces, axis=1)
        self._held = joined[:, n:]
        self._place += n
        return np.ascontiguousarray(joined[:, :n])


def _samples(sound: SoundInput, encoder: str) -> tuple[int, str, Iterator[FloatArray] | SoundQueue]:
    """Rate, channel layout and pieces of a sound, as an encoder takes them."""
    rates = OPUS_RATES if encoder == "libopus" else AAC_RATES
    if isinstance(sound, SoundQueue):
        if sound.rate not in rates:
            raise MediaError(f"sound: {sound.rate} samples a second; the encoder has {rates}")
        return sound.rate, "mono", sound
    if isinstance(sound, Sound):
        usable = resampled(sound, fitting_rate(sound.rate, encoder))
        samples = np.clip(np.nan_to_num(usable.samples), -1, 1).astype(np.float32)
        return usable.rate, "mono", iter([samples[None]])
    rate, layout = sound_format(sound)
    if layout not in KEPT_LAYOUTS:
        layout = "stereo"
    rate = fitting_rate(rate, encoder)
    return rate, layout, iter_sound(sound, rate, layout)


def fitting_rate(rate: int, encoder: str) -> int:
    """Lowest sample rate of an encoder that loses nothing of `rate`."""
    rates = OPUS_RATES if encoder == "libopus" else AAC_RATES
    return next((known for known in rates if known >= rate), rates[-1])


def _packets(path: Path) -> Generator[tuple[float, Packet[AudioStream]], None, None]:
    """Sound packets with their times counted from the first picture, or the first sample."""
    first = next(frames_from(path, video_stream, None), None)
    if first is None or first.time is None:
        # What a decoder starts up with, and drops, lies before time zero.
        first = next(frames_from(path, sound_stream, None), None)
    zero = 0.0 if first is None or first.time is None else first.time
    with open_media(path) as source:
        stream = sound_stream(source)
        if stream is None:
            raise MediaError(f"{path}: holds no sound")
        base = stream.time_base or Fraction(1, av.time_base)
        shift = round(zero / float(base))
        for packet in source.demux(stream):
            if packet.pts is None or packet.dts is None:
                continue
            packet.pts -= shift
            packet.dts -= shift
            # One packet before time zero is kept: the next one's decoding leans on it.
            if packet.pts + 2 * (packet.duration or 0) > 0:
                yield float(packet.pts * base), packet
