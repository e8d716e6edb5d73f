"""What a database is built from: a folder of clips, a manifest, or one long video."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.corpus import (
    MEDIA_EXTENSIONS,
    Clip,
    clip_name,
    find_clips,
    picked,
    read_script,
    scripts_beside,
)
from analysis.cut import CutSettings, cut_at_pauses
from analysis.manifest import MANIFEST_EXTENSION, read_manifest
from database.errors import CorpusError
from database.media import probe


def clips_of(
    corpus: str | Path,
    *,
    timing: str | Path | None = None,
    limit: int | None = None,
    exclude: Sequence[str] = (),
    cut: CutSettings | None = None,
) -> list[Clip]:
    """The clips of whatever footage is named.

    Parameters
    ----------
    corpus : path
        A folder (`analysis.corpus`), a manifest (`analysis.manifest`), or one long video, which
        is cut at its pauses (`analysis.cut`).
    timing : path, optional
        Timing file of the one long video; by default the one beside it.
    limit : int, optional
        Take only this many, spread evenly over the clips.
    exclude : sequence of str
        Names to leave out.
    cut : CutSettings, optional

    Raises
    ------
    CorpusError
        If there is nothing to build from, or a manifest or name is wrong.
    MediaError, TimingError
        If the long video or its timing file cannot be read.
    """
    path = Path(corpus)
    if path.is_file() and path.suffix.lower() in MEDIA_EXTENSIONS:
        clips = cut_video(path, timing, cut)
    elif timing is not None:
        raise CorpusError(f"{path}: is not one video, so a timing file of its own is not for it")
    elif path.is_file() and path.suffix.lower() == MANIFEST_EXTENSION:
        clips = read_manifest(path)
    else:
        return find_clips(path, limit=limit, exclude=exclude)
    return picked(clips, path, limit=limit, exclude=exclude)


def cut_video(
    video: str | Path, timing: str | Path | None = None, settings: CutSettings | None = None
) -> list[Clip]:
    """The pieces of one long video; a video that only has its words beside it stays whole.

    Parameters
    ----------
    video : path
    timing : path, optional
        By default the timing file beside the video.
    settings : CutSettings, optional

    Raises
    ------
    CorpusError
        If there is no timing file, or it is of another recording.
    MediaError, TimingError
        If the video or the timing file cannot be read.
    """
    media = Path(video)
    info = probe(media)
    scripts = scripts_beside(media) if timing is None else (Path(timing),)
    timed = [s for s in scripts if s.suffix.lower() != ".txt"]
    if not timed:
        if scripts:
            return [Clip(media.stem, media, scripts)]
        raise CorpusError(
            f"{media}: has no timing file to cut it by; put {media.stem}.TextGrid (or another "
            "timing file) beside it, or name one (--timing)"
        )
    script = timed[0]
    found = read_script(script)
    if isinstance(found, list):
        return [Clip(media.stem, media, scripts)]
    if found.end > info.duration + 1.0:
        raise CorpusError(
            f"{script}: lasts {found.end:.2f} s, longer than {media.name} with "
            f"{info.duration:.2f} s; is it another recording's?"
        )
    pieces = cut_at_pauses(found, info.duration, info.fps, settings)
    if len(pieces) == 1:
        return [Clip(media.stem, media, (script,))]
    last = len(pieces) - 1
    return [
        Clip(clip_name(media.stem, a, b), media, (script,), a, None if i == last else b)
        for i, (a, b) in enumerate(pieces)
    ]
