"""A folder of clips that is not built yet: a few frames of each, its sound and its words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from analysis.align import Aligner
from analysis.alignment import Alignment
from analysis.corpus import Clip, align_clip, find_clips
from analysis.face import FaceFinder
from analysis.g2p import speaking_lexicon
from analysis.models import FaceModels, find_models
from analysis.motion import estimate_poses
from analysis.person import study_person
from database.errors import CorpusError, FaceError, MediaError, UnitselError
from database.mask import Camera, Mask
from database.media import MediaInfo, VideoFrame, probe, read_video
from database.sound import Sound, read_sound
from unitsel.doctor import measures
from unitsel.doctor.facts import AlignmentFacts, ClipFacts, Rejected

FRAMES: Final = 6
"""Frames of a clip that are looked at, spread evenly over it, its first and last among them."""

LONGEST: Final = 60.0
"""Seconds from a clip's start within which its frames are looked at."""

Tell = Callable[[str, int, int], None]


@dataclass(frozen=True)
class _Common:
    """What every worker needs."""

    models: FaceModels
    dictionary: Path | None
    person: tuple[Mask, Camera] | None


@dataclass
class _Seen:
    """What the frames of a clip showed."""

    numbers: list[int] = field(default_factory=list)
    missing: list[int] = field(default_factory=list)
    missing_picture: bytes = b""
    poses: list[npt.NDArray[np.float64]] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)
    sharp: list[float] = field(default_factory=list)
    clipped: list[float] = field(default_factory=list)
    bright: list[float] = field(default_factory=list)
    mouth: bytes = b""


def corpus_facts(
    folder: str | Path,
    *,
    limit: int | None,
    jobs: int,
    models: str | Path | None,
    dictionary: str | Path | None,
    tell: Tell,
) -> list[ClipFacts]:
    """Look at the clips of a folder.

    Parameters
    ----------
    folder : path
    limit : int, optional
        Take only so many clips, spread evenly over the sorted names.
    jobs : int
        Clips looked at at a time.
    models, dictionary : path, optional
        As for a build.
    tell : callable
        Progress: stage, done, total.

    Raises
    ------
    CorpusError
        If the folder holds no media file.
    ModelError, PronunciationError
        If the models or the dictionary cannot be read.
    """
    clips = [c.absolute() for c in find_clips(folder, limit=limit)]
    speaking_lexicon(dictionary)  # A dictionary that cannot be read is no fault of a clip.
    face_models = find_models(models)
    own = None if dictionary is None else Path(dictionary).absolute()
    tell("finding the person", 0, 1)
    try:
        studied = study_person([c.media for c in clips], FaceFinder(face_models))
        person = studied.mask, studied.camera
    except FaceError:
        person = None  # Told clip by clip.
    tell("finding the person", 1, 1)
    common = _Common(face_models, own, person)
    found: dict[int, ClipFacts] = {}
    tell("looking at clips", 0, len(clips))
    try:
        run = Parallel(n_jobs=min(jobs, len(clips)), return_as="generator_unordered", batch_size=1)
        for i, facts in run(delayed(_numbered)(i, c, common) for i, c in enumerate(clips)):
            found[i] = facts
            tell("looking at clips", len(found), len(clips))
    except TerminatedWorkerError as error:
        raise CorpusError(
            f"{folder}: a worker was ended from outside (out of memory?); fewer --jobs need less"
        ) from error
    return _slow_ones_out([found[i] for i in range(len(clips))])


def look_at(clip: Clip, finder: FaceFinder, aligner: Aligner, common: _Common) -> ClipFacts:
    """What is known of a clip without tracking it.

    Whatever is wrong with the clip is told in its facts.
    """
    facts = ClipFacts(clip.name, clip.media)
    try:
        info = probe(clip.media)
    except UnitselError as error:
        return replace(facts, error=str(error))
    facts = replace(facts, fps=info.fps, seconds=info.duration, size=(info.width, info.height))
    try:
        seen = _look(info, finder, common.person)
    except UnitselError as error:
        return replace(facts, error=str(error))
    facts = _with_frames(facts, seen)
    facts, sound = _with_sound(facts, info)
    if facts.error:
        return facts
    try:
        alignment = align_clip(clip, sound, info.duration, aligner)
    except UnitselError as error:
        return replace(
            facts,
            error=str(error),
            alignment=AlignmentFacts(error=str(error)),
            picture=seen.mouth or seen.missing_picture,
        )
    return _with_alignment(facts, alignment)


def _numbered(i: int, clip: Clip, common: _Common) -> tuple[int, ClipFacts]:
    cv2.setNumThreads(1)  # Clips run side by side; threads inside would fight.
    try:
        return i, look_at(clip, _finder(common.models), _aligner(common.dictionary), common)
    except Exception as error:  # One bad clip never ends the report.
        what = f"{clip.media}: unexpected {type(error).__name__}: {error}"
        return i, ClipFacts(clip.name, clip.media, error=what)


@lru_cache(maxsize=1)
def _finder(models: FaceModels) -> FaceFinder:
    return FaceFinder(models)


@lru_cache(maxsize=1)
def _aligner(dictionary: Path | None) -> Aligner:
    return Aligner(speaking_lexicon(dictionary))


def _sampled(info: MediaInfo) -> list[VideoFrame]:
    """The frames to look at."""
    last = max(0, min(info.frames, int(LONGEST * info.fps)) - 1)
    wanted = set(np.linspace(0, last, FRAMES).round().astype(int).tolist())
    out = []
    for frame in read_video(info.path):
        if frame.index in wanted:
            out.append(frame)
        if frame.index >= last:
            break
    return out


def _look(info: MediaInfo, finder: FaceFinder, person: tuple[Mask, Camera] | None) -> _Seen:
    seen = _Seen()
    finder.reset()
    for frame in _sampled(info):
        mesh = finder.find(frame.rgb)
        mouth = None if mesh is None else measures.mouth_box(frame.rgb, mesh.points)
        if mesh is None or mouth is None or min(mouth.shape[:2]) < 4:
            seen.missing.append(frame.index)
            seen.missing_picture = seen.missing_picture or measures.small_jpeg(frame.rgb)
            continue
        seen.numbers.append(frame.index)
        seen.widths.append(measures.mouth_width(mesh.points))
        seen.sharp.append(measures.sharpness(mouth))
        seen.clipped.append(measures.clipped_share(mouth))
        seen.bright.append(float(mouth.mean()))
        seen.mouth = seen.mouth or measures.small_jpeg(mouth)
        if person is not None:
            mask, camera = person
            own = camera.scaled_to(info.width, info.height)
            try:
                poses, good = estimate_poses(mesh.points[None, :, :2], mask, own)
            except FaceError:
                continue
            if good[0]:
                turned = np.degrees(poses.rotations[0].astype(np.float64))
                seen.poses.append(np.concatenate([turned, poses.translations[0]]))
    if not seen.numbers and not seen.missing:
        raise MediaError(f"{info.path}: not one frame of its video can be decoded")
    return seen


def _with_frames(facts: ClipFacts, seen: _Seen) -> ClipFacts:
    looked = len(seen.numbers) + len(seen.missing)
    poses = np.array(seen.poses, dtype=np.float64).reshape(-1, 6)
    facts = replace(
        facts, looked=looked, faces=len(seen.numbers), mouth=seen.mouth,
        rotations=poses[:, :3], translations=poses[:, 3:],
    )  # fmt: skip
    if not seen.numbers:
        what = f"{facts.media}: shows no face in any of the {looked} frames looked at"
        return replace(facts, error=what, picture=seen.missing_picture)
    rejected: tuple[Rejected, ...] = ()
    if seen.missing:
        rejected = (Rejected(tuple(seen.missing), "no face", seen.missing_picture),)
    return replace(
        facts,
        mouth_pixels=float(np.median(seen.widths)),
        sharpness=float(np.median(seen.sharp)),
        clipped=float(np.mean(seen.clipped)),
        brightness=float(np.mean(seen.bright)),
        drift=measures.drift(seen.bright),
        rejected=rejected,
    )


def _with_sound(facts: ClipFacts, info: MediaInfo) -> tuple[ClipFacts, Sound | None]:
    if not info.has_sound:
        return facts, None
    try:
        sound = read_sound(info.path)
    except UnitselError as error:
        return replace(facts, error=facts.error or str(error)), None
    return replace(facts, sound=measures.sound_facts(sound)), sound


def _with_alignment(facts: ClipFacts, alignment: Alignment) -> ClipFacts:
    track = alignment.track
    bounds = track.boundaries
    return replace(
        facts,
        words=alignment.text,
        phonemes=np.asarray(track.phonemes, dtype=np.int64),
        alignment=AlignmentFacts(
            alignment.given,
            alignment.attempts,
            alignment.notes,
            measures.short_share(bounds[:-1], bounds[1:], track.phonemes),
        ),
    )


def _slow_ones_out(clips: Sequence[ClipFacts]) -> list[ClipFacts]:
    """Clips of fewer frames a second than most are left out by a build: so here."""
    rates = Counter(round(c.fps, 3) for c in clips if c.fps > 0)
    usual = rates.most_common(1)[0][0] if rates else 0.0
    return [
        replace(
            c,
            error=f"{c.media}: has {c.fps:g} frames a second, less than the corpus's {usual:g}",
            picture=c.picture or c.mouth,
        )
        if not c.error and 0 < c.fps < 0.98 * usual
        else c
        for c in clips
    ]
