"""A database's clips: from what it stores, and from the footage where it still is."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from analysis.corpus import MEDIA_EXTENSIONS
from database.errors import UnitselError
from database.media import probe, read_video
from database.reader import UnitDatabase
from database.sound import read_sound
from unitsel.doctor import measures
from unitsel.doctor.facts import AlignmentFacts, ClipFacts, Rejected, SoundFacts

SAMPLED: Final = 8
"""Mouths of a clip that are looked at, spread evenly over it."""

THUMBNAILS: Final = 24
"""Clips whose rejected frames are shown."""

FEWEST_CLIPS: Final = 30
"""Clips from which on the mean mouth of a phoneme is known well enough to doubt one of them."""

_LAG: Final = re.compile(r"lips move ([\d.]+) s (earlier|later)")
_NO_FACE: Final = "no face in frame"
_ATTEMPT: Final = re.compile(r"aligned at attempt (\d+)")

Tell = Callable[[str, int, int], None]


def database_facts(database: UnitDatabase, tell: Tell) -> list[ClipFacts]:
    """What a database knows of its clips, those that its build skipped at the end.

    Raises
    ------
    DatabaseError
        If it cannot be read.
    """
    sequences, units = database.sequences, database.units
    notes: dict[str, list[str]] = defaultdict(list)
    for entry in database.report.get("repaired", ()):
        notes[str(entry.get("clip"))].append(str(entry.get("note")))
    agreements: list[float | None] = [None] * len(sequences)
    if len(sequences) >= FEWEST_CLIPS:
        values = np.column_stack([units.mouth_height, units.pca[:, 0]])
        agreements = measures.lip_agreements(
            values, units.phoneme, units.sequence, len(sequences), database.fps
        )
    clips = []
    shown = 0
    for s in range(len(sequences)):
        tell("looking at clips", s, len(sequences))
        facts = _clip(database, s, notes[sequences.name[s]])
        if facts.rejected and shown < THUMBNAILS:
            facts = replace(facts, rejected=_pictured(facts, database.fps))
            shown += 1
        clips.append(facts.with_agreement(agreements[s]))
    tell("looking at clips", len(sequences), len(sequences))
    folders = list(dict.fromkeys(Path(m).parent for m in sequences.media))
    for entry in database.report.get("skipped", ()):
        name, reason = str(entry.get("clip")), str(entry.get("reason"))
        media = _footage_of(name, reason, folders)
        picture = _frame_picture(media, 0, None) if shown < THUMBNAILS else b""
        shown += bool(picture)
        clips.append(ClipFacts(name, media, error=reason, picture=picture))
    return clips


def _clip(database: UnitDatabase, s: int, notes: Sequence[str]) -> ClipFacts:
    sequences, units = database.sequences, database.units
    first, n = int(sequences.first_unit[s]), int(sequences.units[s])
    frames, fps = int(sequences.frames[s]), database.fps
    track = database.sequence_track(s)
    bounds = track.boundaries
    lag = 0.0
    attempts = 1
    kept = []
    for note in notes:
        if found := _LAG.search(note):
            lag = float(found[1]) * (-1 if found[2] == "earlier" else 1)
        elif found := _ATTEMPT.fullmatch(note):
            attempts = int(found[1])
            kept.append(note)
        elif not note.startswith(_NO_FACE):
            kept.append(note)
    facts = ClipFacts(
        sequences.name[s],
        Path(sequences.media[s]),
        words=sequences.words[s],
        fps=float(sequences.fps[s]),
        seconds=frames / fps,
        size=(database.camera.width, database.camera.height),
        looked=frames,
        faces=n,
        rotations=np.degrees(units.rotation[first : first + n].astype(np.float64)),
        translations=units.translation[first : first + n].astype(np.float64),
        rejected=_rejected(frames, units.frame[first : first + n].tolist()),
        sound=_sound(Path(sequences.media[s])),
        alignment=AlignmentFacts(
            attempts=attempts,
            notes=tuple(kept),
            short=measures.short_share(bounds[:-1], bounds[1:], track.phonemes),
        ),
        lag=lag,
        phonemes=np.asarray(track.phonemes, dtype=np.int64),
    )
    if n == 0:
        return facts
    chosen = first + np.unique(np.linspace(0, n - 1, SAMPLED).round().astype(int))
    pictures = database.pictures(chosen)
    return replace(
        facts,
        mouth_pixels=float(
            np.median([measures.mouth_width(m) for m in database.landmarks(chosen)])
        ),
        sharpness=float(np.median([measures.sharpness(p) for p in pictures])),
        clipped=float(np.mean([measures.clipped_share(p) for p in pictures])),
        brightness=float(pictures.mean()),
        drift=measures.drift([float(p.mean()) for p in pictures]),
        mouth=measures.small_jpeg(pictures[len(pictures) // 2]),
    )


def _rejected(frames: int, seen: Sequence[int]) -> tuple[Rejected, ...]:
    missing = sorted(set(range(frames)) - set(seen))
    return (Rejected(tuple(missing), "no face that can be followed"),) if missing else ()


def _pictured(facts: ClipFacts, fps: float) -> tuple[Rejected, ...]:
    """The rejected frames with a picture of one of them, if the footage is where it was."""
    return tuple(
        replace(r, picture=_frame_picture(facts.media, r.frames[len(r.frames) // 2], fps))
        for r in facts.rejected
    )


def _frame_picture(media: Path, number: int, fps: float | None) -> bytes:
    """A frame of a video as a small JPEG; empty if it cannot be had."""
    try:
        if not media.is_file():
            return b""
        for frame in read_video(media, fps):
            if frame.index >= number:
                return measures.small_jpeg(frame.rgb)
    except (UnitselError, OSError):
        pass  # It is only an illustration.
    return b""


def _footage_of(name: str, reason: str, folders: Sequence[Path]) -> Path:
    """Where the footage of a skipped clip is: the reason begins with it, or it is beside others."""
    told = Path(reason.partition(": ")[0])
    if told.suffix.lower() in MEDIA_EXTENSIONS:
        return told
    for folder in folders:
        for extension in sorted(MEDIA_EXTENSIONS):
            if (found := folder / f"{name}{extension}").is_file():
                return found
    return Path(name)


def _sound(media: Path) -> SoundFacts | None:
    """Sound of the footage, if it is still there; the database keeps only what is heard of it."""
    try:
        if media.is_file() and probe(media).has_sound:
            return measures.sound_facts(read_sound(media))
    except (UnitselError, OSError):
        pass
    return None
