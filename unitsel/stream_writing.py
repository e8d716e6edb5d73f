"""A stream of pictures into a file, with the sounds of its utterances."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import numpy as np

from database.errors import MediaError
from database.photo import FrameFormat
from database.sound import resampled
from database.sound_out import SoundInput, SoundQueue, fitting_rate
from database.track import frame_count
from database.video_codecs import container_of
from unitsel.placed import Lasting, Placed
from unitsel.provenance import Provenance
from unitsel.streaming import StreamedFrame
from unitsel.writing import Encoding, Frame, Written, is_folder, write_video

Progress = Callable[[str, int, int], None]

S = TypeVar("S", bound=Lasting)


def write_stream(
    frames: Generator[StreamedFrame[S], None, None],
    path: str | Path,
    *,
    background: Path,
    rate: Fraction,
    form: FrameFormat | None = None,
    audio: str | Path | None = None,
    encoding: Encoding | None = None,
    provenance: Provenance | None = None,
    begun: Callable[[Placed[S]], None] | None = None,
    progress: Progress | None = None,
    seconds: float | None = None,
) -> Written:
    """Write a stream; it is closed in any case.

    Parameters
    ----------
    frames : generator of StreamedFrame
    path, background, rate, form, encoding, provenance
        As for `unitsel.writing.write_video`.
    audio : path, optional
        Sound of the whole; by default the utterances' own.
    begun : callable, optional
        Called with each utterance, before its first picture.
    progress : callable, optional
    seconds : float, optional
        Length of the whole, for the progress.

    Raises
    ------
    MediaError
        If there is no utterance, or sound or video cannot be read or written.
    """
    path = Path(path)
    with closing(frames):
        first = next(frames, None)
        if first is None:
            raise MediaError(f"{path}: there is no utterance to write")
        sound: SoundInput | None = audio
        if audio is None and not is_folder(path) and first.utterance.sound is not None:
            encoder = container_of(path).sound
            sound = SoundQueue(fitting_rate(first.utterance.sound.rate, encoder))

        def pictures() -> Iterator[Frame]:
            total = None if seconds is None else frame_count(seconds, float(rate))
            frame: StreamedFrame[S] | None = first
            seen = -1
            while frame is not None:
                if frame.utterance.index != seen:
                    seen = frame.utterance.index
                    if begun is not None:
                        begun(frame.utterance)
                    if isinstance(sound, SoundQueue):
                        _hear(sound, frame.utterance)
                yield frame.picture
                if progress is not None:
                    progress("rendering", frame.index + 1, max(total or 0, frame.index + 1))
                frame = next(frames, None)

        return write_video(
            pictures(),
            path,
            background=background,
            rate=rate,
            form=form,
            audio=sound,
            encoding=encoding,
            provenance=provenance,
        )


def _hear(queue: SoundQueue, utterance: Placed[S]) -> None:
    """Put an utterance's sound where the utterance is, in its length."""
    silence = round(utterance.start * queue.rate) - queue.total
    if silence > 0:
        queue.put(np.zeros(silence, np.float32))
    n = round(utterance.end * queue.rate) - queue.total
    samples = np.zeros(max(n, 0), np.float32)
    if utterance.sound is not None:
        given = np.nan_to_num(resampled(utterance.sound, queue.rate).samples)[: len(samples)]
        samples[: len(given)] = np.clip(given, -1, 1)
    queue.put(samples)
