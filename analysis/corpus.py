"""A corpus folder: media files, each with its words or its timing beside it.

``NAME.mpg`` goes with ``NAME.TextGrid`` (or another timing file) or with ``NAME.txt``, the
words. A phone-level timing file replaces alignment, a word-level one gives the words and bounds
the search of each, a text gives the words alone; the first of these that exists is used.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from analysis.align import Aligner
from analysis.alignment import Alignment
from analysis.cut import timing_of_piece
from database.errors import CorpusError, MediaError, TimingError
from database.media import probe
from database.piece import Piece
from database.sound import Sound
from database.timing import Timing, read_timing, read_words, timing_extensions
from database.timing.words import WordTrack
from database.track import Interval, PhonemeTrack

MEDIA_EXTENSIONS: Final = frozenset(
    (
        *(".mp4", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".m4v"),
        *(".mts", ".m2ts", ".ts", ".wmv", ".flv", ".ogv", ".mxf"),
    )
)


@dataclass(frozen=True)
class Clip:
    """A media file and what tells its words.

    Parameters
    ----------
    name : str
        File name without extension (with its folder where two clips share it), and the times
        of a piece.
    media : Path
    scripts : tuple of Path
        Timing files and text beside it; times are those of the media file.
    start : float
        Seconds at which the clip begins in the media file, on a frame.
    end : float, optional
        Where it ends; by default with the file.
    words : tuple of str
        What is said, where that stands in no file.
    """

    name: str
    media: Path
    scripts: tuple[Path, ...]
    start: float = 0.0
    end: float | None = None
    words: tuple[str, ...] = ()

    @property
    def source(self) -> Piece:
        """What is to be read: the file, or the piece of it."""
        return Piece(self.media, self.start, self.end)

    def as_json(self) -> dict[str, Any]:
        """The clip as a database's report keeps it; `from_json` reads it."""
        document: dict[str, Any] = {
            "name": self.name,
            "media": str(self.media),
            "scripts": [str(s) for s in self.scripts],
        }
        if not self.source.whole:
            document |= {"start": self.start, "end": self.end}
        return document | ({"words": list(self.words)} if self.words else {})

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Clip:
        """What `as_json` made."""
        return cls(
            document["name"],
            Path(document["media"]),
            tuple(Path(s) for s in document["scripts"]),
            document.get("start", 0.0),
            document.get("end"),
            tuple(document.get("words", ())),
        )

    def absolute(self) -> Clip:
        """The same clip, wherever one stands."""
        scripts = tuple(s.absolute() for s in self.scripts)
        return replace(self, media=self.media.absolute(), scripts=scripts)


def find_clips(
    folder: str | Path, *, limit: int | None = None, exclude: Sequence[str] = ()
) -> list[Clip]:
    """The clips of a corpus folder and its sub-folders, sorted by name.

    Parameters
    ----------
    folder : path
    limit : int, optional
        Take only this many, spread evenly over the sorted names.
    exclude : sequence of str
        Names to leave out.

    Raises
    ------
    CorpusError
        If the folder cannot be read or holds no media file, an excluded name is not there, or
        nothing is left.
    """
    root = Path(folder)
    if not root.is_dir():
        raise CorpusError(f"{root}: is not a folder; a corpus is a folder with media files")
    try:
        files = sorted(p for p in root.rglob("*") if p.is_file())
    except OSError as error:
        raise CorpusError(f"{root}: cannot be read ({error.strerror})") from error
    media = [p for p in files if p.suffix.lower() in MEDIA_EXTENSIONS]
    if not media:
        raise CorpusError(
            f"{root}: holds no media file ({', '.join(sorted(MEDIA_EXTENSIONS))} are looked for)"
        )
    beside: dict[Path, list[Path]] = {}
    readable = {*timing_extensions(), ".txt"}
    for p in files:
        if p.suffix.lower() in readable:
            beside.setdefault(p.with_suffix(""), []).append(p)
    shared = Counter(p.stem for p in media)
    clips = [
        Clip(
            p.stem if shared[p.stem] == 1 else p.relative_to(root).as_posix(),
            p,
            tuple(beside.get(p.with_suffix(""), ())),
        )
        for p in media
    ]
    clips.sort(key=lambda c: c.name)
    return picked(clips, root, limit=limit, exclude=exclude)


def scripts_beside(media: Path) -> tuple[Path, ...]:
    """Timing files and text beside a media file."""
    readable = {*timing_extensions(), ".txt"}
    found = (p for p in media.parent.glob("*") if p.stem == media.stem and p.is_file())
    return tuple(sorted(p for p in found if p.suffix.lower() in readable))


def clip_name(stem: str, start: float | None, end: float | None) -> str:
    """Name of a clip that may be a piece of its file; names sort as the pieces follow."""
    if start is None and end is None:
        return stem
    until = "" if end is None else f"{end:08.2f}"
    return f"{stem}@{start or 0.0:08.2f}-{until}"


def snapped(media: Path, start: float) -> float:
    """A time moved to the start of the video's nearest frame."""
    if start == 0:
        return 0.0
    try:
        fps = probe(media).fps
    except MediaError:
        return start  # The build says what is wrong with the file.
    return round(start * fps) / fps


def picked(
    clips: list[Clip], root: Path, *, limit: int | None = None, exclude: Sequence[str] = ()
) -> list[Clip]:
    """Clips without the excluded ones, and only so many, spread evenly.

    Raises
    ------
    CorpusError
        If an excluded name is not there, the limit is below 1, or nothing is left.
    """
    clips = _without(clips, exclude, root)
    if limit is not None:
        if limit < 1:
            raise CorpusError(f"the number of clips must be at least 1, not {limit}")
        if limit < len(clips):
            places = np.linspace(0, len(clips) - 1, limit).round().astype(int)
            clips = [clips[i] for i in places]
    return clips


def _without(clips: list[Clip], exclude: Sequence[str], root: Path) -> list[Clip]:
    names = {c.name for c in clips}
    for name in exclude:
        if name not in names:
            near = difflib.get_close_matches(name, names, 3)
            hint = f"; near it: {', '.join(near)}" if near else ""
            raise CorpusError(f"{root}: holds no clip {name!r} to exclude{hint}")
    left = [c for c in clips if c.name not in set(exclude)]
    if not left:
        raise CorpusError(f"{root}: nothing is left after excluding {', '.join(exclude)}")
    return left


def align_clip(clip: Clip, sound: Sound | None, duration: float, aligner: Aligner) -> Alignment:
    """Phones of a clip, from the best script beside it.

    Parameters
    ----------
    clip : Clip
    sound : Sound or None
        16 kHz mono; None where the clip has none, which a phone-level timing file makes good.
    duration : float
        Length of the clip in seconds.
    aligner : Aligner

    Raises
    ------
    CorpusError
        If there is no script, or words but no sound.
    TimingError, PronunciationError, AlignmentError
        If a script cannot be read or its words cannot be aligned.
    """
    if not clip.scripts and not clip.words:
        raise CorpusError(
            f"{clip.source}: has no words; put {clip.media.stem}.txt or a timing file beside it"
        )
    given: PhonemeTrack | None = None
    timed: WordTrack | None = None
    plain: list[str] | None = list(clip.words) or None
    complaints: list[TimingError] = []
    for script in sorted(clip.scripts, key=lambda p: (p.suffix.lower() == ".txt", p.name)):
        try:
            timing = read_script(script)
            if not isinstance(timing, list) and not clip.source.whole:
                end = clip.start + duration
                timing = timing_of_piece(timing, clip.start, end, str(script))
        except TimingError as error:
            complaints.append(error)
            continue
        if isinstance(timing, list):
            plain = plain or timing
        else:
            given = given or timing.phones
            timed = timed or timing.words
    if given is not None:
        text = " ".join(timed.words if timed else plain or ())
        return Alignment(fitted(given, duration), timed, 0, _unused(complaints), text)
    if timed is None and plain is None:
        raise complaints[0] if complaints else CorpusError(f"{clip.source}: has no words")
    if sound is None:
        raise CorpusError(
            f"{clip.source}: has no sound, so its words cannot be timed; put a phone-level timing "
            "file beside it"
        )
    if timed is not None:
        found = aligner.align_bounded(sound, timed, name=str(clip.source))
    else:
        found = aligner.align(sound, plain or [], name=str(clip.source))
    # Sound and picture seldom end together.
    notes = (*_unused(complaints), *found.notes)
    return replace(found, track=fitted(found.track, duration), notes=notes)


def read_script(script: Path) -> Timing | list[str]:
    """What a script holds: times, or words alone; kept while the file stays as it is.

    Raises
    ------
    TimingError
        If it cannot be read.
    """
    try:
        stat = script.stat()
    except OSError:
        return _read_script(script, 0, 0)  # Says what is wrong.
    return _read_script(script, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4)
def _read_script(script: Path, size: int, changed: int) -> Timing | list[str]:
    # Pieces of one long recording share its timing file.
    if script.suffix.lower() == ".txt":
        return read_words(script)
    try:
        timing = read_timing(script)
    except TimingError as error:
        if script.suffix.lower() == ".lab":
            with suppress(TimingError):  # Words may stand in it, too; else the first error counts.
                return read_words(script)
        raise error
    if timing.shapes_only:
        raise TimingError(
            f"{script}: holds mouth shapes, which do not say what is spoken; put the words beside "
            "the clip"
        )
    return timing


def _unused(complaints: Sequence[TimingError]) -> tuple[str, ...]:
    """Notes on scripts that could not be read while another could."""
    return tuple(f"not used: {error}" for error in complaints)


def fitted(track: PhonemeTrack, duration: float) -> PhonemeTrack:
    """A track cut or continued with silence to a clip's length."""
    kept = [
        Interval(i.start, min(i.end, duration), i.label)
        for i in track.intervals()
        if i.start < duration - 1e-3
    ]
    if not kept:
        raise CorpusError(f"{track.name}: its times lie beyond the clip's end at {duration:.2f} s")
    if kept[-1].end < duration - 1e-3:
        kept.append(Interval(kept[-1].end, duration, "sil"))
    return PhonemeTrack.from_intervals(kept, name=track.name)
