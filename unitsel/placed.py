"""Where in the output an utterance lies: its time, and which frames are its own.

Frame i shows the time from ``i / fps`` on. An utterance begins with the frame nearest to where it
begins in time and ends where the next one does so, so that no rounding adds up.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, Protocol, TypeVar

from database.sound import Sound


class Lasting(Protocol):
    """What has a length in time: a selection."""

    @property
    def duration(self) -> float:
        """Length in seconds."""


S = TypeVar("S", bound=Lasting)


@dataclass(frozen=True)
class Placed(Generic[S]):
    """What was selected for an utterance, with its place in the output.

    Parameters
    ----------
    selection : object with a duration
    index : int
        Number of the utterance, from 0.
    start : float
        Seconds of the output at which it begins.
    first, stop : int
        Its frames: the first, and the one behind the last.
    sound : Sound, optional
        What is heard, from `start` on.
    """

    selection: S
    index: int
    start: float
    first: int
    stop: int
    sound: Sound | None = None

    @property
    def end(self) -> float:
        """Seconds of the output at which it ends."""
        return self.start + self.selection.duration


def placed(selections: Iterable[tuple[S, Sound | None]], rate: Fraction) -> Iterator[Placed[S]]:
    """Place utterances one after another.

    Parameters
    ----------
    selections : iterable
        With their sounds; read when the next is asked for.
    rate : Fraction
        Frames a second of the output.

    Yields
    ------
    Placed
        The first has one frame at least; later ones may be too short for any.
    """
    start, first = 0.0, 0
    for index, (selection, sound) in enumerate(selections):
        stop = max(round((start + selection.duration) * float(rate)), first, 1)
        yield Placed(selection, index, start, first, stop, sound)
        start, first = start + selection.duration, stop
