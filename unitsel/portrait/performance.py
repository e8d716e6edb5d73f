"""What a portrait is to say: for a portrait what a selection of units is for a database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from database.pinyin import TimedSyllable
from database.portrait_mesh import FaceMotion
from database.reader import UnitDatabase
from database.talk_mask import TalkMask
from database.track import PhonemeTrack
from unitsel.portrait.driver import DriveSettings, drive
from unitsel.portrait.retarget import lips_like


@dataclass(frozen=True)
class Performance:
    """An utterance, and how the face says it.

    Parameters
    ----------
    track : PhonemeTrack
    settings : DriveSettings
    syllables : sequence of TimedSyllable
        Mandarin's.
    like : UnitDatabase, optional
        Of a person whose lips move these (`unitsel.portrait.retarget`).
    """

    track: PhonemeTrack
    settings: DriveSettings = field(default_factory=DriveSettings)
    syllables: Sequence[TimedSyllable] = ()
    like: UnitDatabase | None = None

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
        lips = None if self.like is None else lips_like(self.like, self.track, mask, fps)
        return drive(
            mask,
            self.track,
            fps,
            self.settings,
            syllables=self.syllables or None,
            lips=lips,
            start=start,
        )
