"""What a build is asked for, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from analysis.align import AlignSettings
from analysis.corpus_lips import LipSettings
from analysis.estimate import Estimate
from analysis.face import FaceSettings
from analysis.guide import GuideSettings
from analysis.hand_points import HandPoints
from analysis.lag import LagSettings
from analysis.motion import CropSettings, MotionSettings
from analysis.sound_offset import OffsetSettings
from analysis.texture import TextureSettings
from database.mask import Camera
from database.pictures import AUTO_CODEC


@dataclass(frozen=True)
class BuildSettings:
    """How a database is built.

    Parameters
    ----------
    focal : float, optional
        Focal length of the camera in pixels; assumed where it is not known.
    camera : Camera, optional
        Calibrated (`analysis.calibration.read_camera`); goes before `focal`.
    estimate_focal : bool
        Estimate the focal length over the first clips, where neither of these is given.
    hand : HandPoints, optional
        Six points marked in a frame of one clip, which rule the mask and its initial pose.
    codec : str
        Codec of the stored pictures; "auto" takes what `database.pictures.codec_for` says.
    consent : str
        What the person filmed has agreed to; the database carries it, and no clip depends on it.
    face, motion, crop, texture, align, lag, guide, offset, lips
        Settings of the steps.
    """

    focal: float | None = None
    camera: Camera | None = None
    estimate_focal: bool = False
    hand: HandPoints | None = None
    codec: str = AUTO_CODEC
    consent: str = ""
    face: FaceSettings = field(default_factory=FaceSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    crop: CropSettings = field(default_factory=CropSettings)
    texture: TextureSettings = field(default_factory=TextureSettings)
    align: AlignSettings = field(default_factory=AlignSettings)
    lag: LagSettings = field(default_factory=LagSettings)
    guide: GuideSettings = field(default_factory=GuideSettings)
    offset: OffsetSettings = field(default_factory=OffsetSettings)
    lips: LipSettings = field(default_factory=LipSettings)


@dataclass(frozen=True)
class ShardSettings:
    """What becomes of the analysed clips.

    Parameters
    ----------
    folder : path, optional
        Where they are kept; by default beside the database, in a folder of its name with
        ``.shards`` added. Several databases may share a folder that is named here, one build at
        a time; nothing in it is deleted by a build.
    keep : bool
        Whether they stay when the database is complete, for a later build of more clips.
    restart : bool
        Analyse all clips anew.
    others : tuple of Path
        Folders of other builds, from which clips are taken over.
    """

    folder: str | Path | None = None
    keep: bool = True
    restart: bool = False
    others: tuple[Path, ...] = ()


@dataclass(frozen=True)
class BuildReport:
    """What a build made of a corpus.

    Parameters
    ----------
    path : Path
        The database.
    units, sequences : int
    skipped : tuple of (clip, reason)
    repaired : tuple of (clip, what was done)
    seconds : float
    reused : int
        Clips that were not analysed, since an earlier build had done it.
    damaged : tuple of str
        Clips that an earlier build had analysed and whose shards were damaged.
    changed : tuple of str
        What is not as in the earlier build, so that none of its clips could be taken.
    person : tuple of str
        Clips that were looked at for the mask.
    shards : Path or None
        Folder of what is kept for a later build.
    shard_bytes : int
        Its size.
    estimate : Estimate
        What was expected before the work began.
    """

    path: Path
    units: int
    sequences: int
    skipped: tuple[tuple[str, str], ...]
    repaired: tuple[tuple[str, str], ...]
    seconds: float
    reused: int
    damaged: tuple[str, ...]
    changed: tuple[str, ...]
    person: tuple[str, ...]
    shards: Path | None
    shard_bytes: int
    estimate: Estimate

    def as_json(self) -> dict[str, Any]:
        """The report for machines."""
        return {
            "database": str(self.path),
            "units": self.units,
            "sequences": self.sequences,
            "skipped": [{"clip": c, "reason": r} for c, r in self.skipped],
            "repaired": [{"clip": c, "note": n} for c, n in self.repaired],
            "seconds": round(self.seconds, 2),
            "reused": self.reused,
            "damaged": list(self.damaged),
            "changed": list(self.changed),
            "person": list(self.person),
            "shards": None if self.shards is None else str(self.shards),
            "shard_bytes": self.shard_bytes,
            "estimate": self.estimate.as_json(),
        }
