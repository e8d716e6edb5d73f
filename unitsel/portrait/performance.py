"""What a portrait is to say: for a portrait what a selection of units is for a database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from database.pinyin import TimedSyllable
from database.portrait_mesh import FaceMotion
from database.talk_mask import TalkMask
from database.track import PhonemeTrack
from unitsel.portrait.driver import DriveSettings, drive


@dataclass(frozen=True)
class Performance:
    """An utterance, and how the face says it.

    Parameters
    ----------
    track : PhonemeTrack
    settings : DriveSettings
    syllables : sequence of TimedSyllable
        Mandarin's.
    """

    track: PhonemeTrack
    settings: DriveSettings = field(default_factory=DriveSettings)
    syllables: Sequence[TimedSyllable] = ()

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.track.end

    def motion(self, mask: TalkMask, fps: float, start: float = 0.0) -> FaceMotion:
        """How a mask moves.

        Parameters
        ----------
        mask : TalkMask
        fps : float
            Frames a second.
        start : float
            Seconds of what was shown before.
        """
        return drive(
            mask, self.track, fps, self.settings, syllables=self.syllables or None, start=start
        )
