"""Pictures of utterances that are still arriving: selecting, drawing and using them side by side.

While one utterance is drawn the next is selected (Liu and Ostermann 2009, section 5.2). Each stage
goes a bounded number of utterances or frames ahead, so that memory does not grow with the length.
What is streamed is any head that can select for a track and draw what was selected.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, Generic, TypeVar

from database.sound import Sound
from database.track import PhonemeTrack
from unitsel.ahead import Ahead
from unitsel.placed import Lasting, Placed, placed
from unitsel.writing import Frame

S = TypeVar("S", bound=Lasting)

Spoken = PhonemeTrack | tuple[PhonemeTrack, Sound | None]
"""An utterance that is to be shown: what is said, perhaps with what is heard."""

UTTERANCES_AHEAD: Final = 2
"""Utterances that are selected before they are drawn."""

DRAWN_AHEAD: Final = 8
"""Frames that are drawn before they are taken."""


@dataclass(frozen=True)
class StreamedFrame(Generic[S]):
    """One frame of a stream.

    Parameters
    ----------
    picture : Planes, or (height, width, 4) uint8
        Its planes, or the mouth alone as RGB and alpha; not to be written to.
    index : int
        Number of the frame, from 0.
    time : float
        Seconds at which it begins to be shown, in all utterances' sounds one after another.
    utterance : Placed
        The utterance that it belongs to: number, start, selection and sound.
    """

    picture: Frame
    index: int
    time: float
    utterance: Placed[S]


def stream(
    tracks: Iterable[Spoken],
    select: Callable[[PhonemeTrack, Sound | None, S | None], S],
    draw: Callable[[Iterator[Placed[S]]], Iterator[Frame]],
    rate: Fraction,
    *,
    look_ahead: int = UTTERANCES_AHEAD,
) -> Generator[StreamedFrame[S], None, None]:
    """Select and draw utterances as they come.

    Parameters
    ----------
    tracks : iterable
        Phoneme tracks, or pairs of a track and its sound. May wait for what is still to come; it is
        iterated in a thread of its own.
    select : callable
        Selects for a track and its sound, given what was selected before.
    draw : callable
        Draws placed utterances, one after another, in the number of frames that each has.
    rate : Fraction
        Frames a second.
    look_ahead : int
        Utterances that may be selected before they are drawn, one at least.

    Yields
    ------
    StreamedFrame
        What a stage raises is raised here, after the frames that came before it.
    """

    def selections() -> Iterator[tuple[S, Sound | None]]:
        before: S | None = None
        for spoken in tracks:
            track, sound = (spoken, None) if isinstance(spoken, PhonemeTrack) else spoken
            before = select(track, sound, before)
            yield before, sound

    coming: deque[Placed[S]] = deque()

    def noted(utterances: Iterator[Placed[S]]) -> Iterator[Placed[S]]:
        for utterance in utterances:
            coming.append(utterance)
            yield utterance

    # Whoever waits for a text cannot be asked to stop.
    selected = Ahead(selections(), max(1, look_ahead), "selecting", patience=0.1)
    drawn = Ahead(draw(noted(placed(selected, rate))), DRAWN_AHEAD, "drawing")
    try:
        for index, picture in enumerate(drawn):
            while coming[0].stop <= index:
                coming.popleft()
            yield StreamedFrame(picture, index, float(index / rate), coming[0])
    finally:
        # The source first: drawing may wait for it.
        selected.close()
        drawn.close()
