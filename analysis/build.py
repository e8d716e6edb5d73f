"""A corpus into a database.

Clips are analysed side by side in processes, each leaving a file in a temporary folder beside
the output, so that memory does not grow with the corpus. What depends on all clips (lighting
reference, principal components, cost model) follows, and the database is written in one go. A
clip that fails is skipped, named and counted; it never ends the build.
"""

from __future__ import annotations

import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import cv2
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from analysis.aam_points import read_marks
from analysis.align import Aligner, AlignSettings
from analysis.assemble import assemble
from analysis.clip import AnalysedClip, analyse_clip
from analysis.corpus import Clip, find_clips
from analysis.corpus_lips import LipSettings, check_source
from analysis.face import FaceFinder, FaceSettings
from analysis.g2p import speaking_lexicon
from analysis.guide import GuideSettings
from analysis.lag import LagSettings
from analysis.models import FaceModels, find_models
from analysis.motion import CropSettings, MotionSettings
from analysis.person import find_person
from analysis.shards import Shard, read_shard, write_shard
from analysis.texture import (
    TextureSettings,
)
from database.errors import CorpusError, DatabaseError, UnitselError
from database.lexicon import Lexicon
from database.mask import Camera, Mask
from database.media import probe
from database.pictures import find_codec
from database.writer import write_database

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, how much of it is done, and of how much."""


DATABASE_EXTENSIONS: Final = (".h5", ".hdf5")


@dataclass(frozen=True)
class BuildSettings:
    """How a database is built.

    Parameters
    ----------
    focal : float, optional
        Focal length of the camera in pixels; assumed where it is not known.
    codec : str
        Codec of the stored pictures.
    face, motion, crop, texture, align, lag, guide, lips
        Settings of the steps.
    """

    focal: float | None = None
    codec: str = "png"
    face: FaceSettings = field(default_factory=FaceSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    crop: CropSettings = field(default_factory=CropSettings)
    texture: TextureSettings = field(default_factory=TextureSettings)
    align: AlignSettings = field(default_factory=AlignSettings)
    lag: LagSettings = field(default_factory=LagSettings)
    guide: GuideSettings = field(default_factory=GuideSettings)
    lips: LipSettings = field(default_factory=LipSettings)


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
    """

    path: Path
    units: int
    sequences: int
    skipped: tuple[tuple[str, str], ...]
    repaired: tuple[tuple[str, str], ...]
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """The report for machines."""
        return {
            "database": str(self.path),
            "units": self.units,
            "sequences": self.sequences,
            "skipped": [{"clip": c, "reason": r} for c, r in self.skipped],
            "repaired": [{"clip": c, "note": n} for c, n in self.repaired],
            "seconds": round(self.seconds, 2),
        }


@dataclass(frozen=True)
class _Common:
    """What every worker needs; small, since it travels with every clip."""

    mask: Mask
    camera: Camera
    fps: float
    models: FaceModels
    lexicon: Lexicon
    settings: BuildSettings
    build: str = field(default_factory=lambda: uuid.uuid4().hex)
    """Tells this build from an earlier one in workers that serve several."""


def build_database(
    corpus: str | Path,
    output: str | Path,
    *,
    settings: BuildSettings | None = None,
    jobs: int = 2,
    limit: int | None = None,
    exclude: Sequence[str] = (),
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    progress: Progress | None = None,
) -> BuildReport:
    """Build a database from a folder of clips.

    Parameters
    ----------
    corpus : path
        Folder; see `analysis.corpus`.
    output : path
        The database, replaced when the new one is complete.
    settings : BuildSettings, optional
    jobs : int
        Clips analysed at a time.
    limit : int, optional
        Take only so many clips, spread evenly over the sorted names.
    exclude : sequence of str
        Clips to leave out.
    models : path, optional
        Folder with the face models; see `analysis.models`.
    dictionary : path, optional
        Pronunciations to add to the CMU dictionary's.
    progress : callable, optional

    Returns
    -------
    BuildReport

    Raises
    ------
    CorpusError
        If the folder holds no usable clip.
    ModelError, PronunciationError
        If the models or the dictionary cannot be read.
    DatabaseError
        If the database cannot be written.
    """
    started = time.monotonic()
    chosen = settings or BuildSettings()
    tell = progress or (lambda stage, done, total: None)
    target = Path(output)
    find_codec(chosen.codec)
    check_source(chosen.lips.source)
    marks = read_marks(chosen.lips.marks) if chosen.lips.marks else None
    if not target.parent.is_dir():
        raise DatabaseError(f"{target}: the folder {target.parent} does not exist; make it first")
    if target.is_dir():
        raise DatabaseError(f"{target}: is a folder; name a file")
    if target.suffix.lower() not in DATABASE_EXTENSIONS:
        # So that a slip of the hand never replaces footage.
        raise DatabaseError(f"{target}: must end in {' or '.join(DATABASE_EXTENSIONS)}")
    if jobs < 1:
        raise CorpusError(f"the number of jobs must be at least 1, not {jobs}")
    # Absolute, since a worker may have been started in another folder.
    clips = [c.absolute() for c in find_clips(corpus, limit=limit, exclude=exclude)]
    lexicon = speaking_lexicon(dictionary)
    face_models = find_models(models)

    fps, skipped = _frame_rate(clips)
    usable = [c for c in clips if c.name not in skipped]
    tell("finding the person", 0, 1)
    mask, camera = find_person(
        [c.media for c in usable],
        FaceFinder(face_models, chosen.face),
        focal=chosen.focal,
        crop=chosen.crop,
    )
    tell("finding the person", 1, 1)
    common = _Common(mask, camera, fps, face_models, lexicon, chosen)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent) as folder:
            shards = _analyse(usable, common, Path(folder).absolute(), jobs, skipped, tell)
            content, landmarks = assemble(
                shards,
                mask=mask,
                camera=camera,
                fps=fps,
                texture=chosen.texture,
                lag=chosen.lag,
                guide=chosen.guide,
                lips=chosen.lips,
                marks=marks,
                codec=chosen.codec,
                jobs=jobs,
                settings=asdict(chosen),
                skipped=skipped,
                tell=tell,
            )
            write_database(
                target,
                content,
                (data for shard in shards for data in read_shard(shard.path).pictures()),
                landmarks,
                chosen.codec,
                jobs,
                lambda done, total: tell("writing", done, total),
            )
    except OSError as error:
        raise DatabaseError(f"{target}: cannot be written ({error.strerror or error})") from error
    return BuildReport(
        target,
        len(content.units),
        len(content.sequences),
        tuple(skipped.items()),
        tuple((r["clip"], r["note"]) for r in content.report["repaired"]),
        time.monotonic() - started,
    )


def _frame_rate(clips: Sequence[Clip]) -> tuple[float, dict[str, str]]:
    """The commonest frame rate, and the clips that cannot be used, with reasons."""
    rates: dict[str, float] = {}
    skipped: dict[str, str] = {}
    for clip in clips:
        try:
            rates[clip.name] = probe(clip.media).fps
        except UnitselError as error:
            skipped[clip.name] = str(error)
    if not rates:
        raise CorpusError(
            f"no clip of the corpus can be read; the first: {next(iter(skipped.values()))}"
        )
    fps = Counter(round(r, 3) for r in rates.values()).most_common(1)[0][0]
    for clip in clips:
        rate = rates.get(clip.name)
        if rate is not None and rate < 0.98 * fps:
            skipped[clip.name] = (
                f"{clip.media}: has {rate:g} frames a second, less than the corpus's {fps:g}"
            )
    return fps, skipped


@cache
def _finder(models: FaceModels, settings: FaceSettings) -> FaceFinder:
    return FaceFinder(models, settings)


_aligners: dict[str, Aligner] = {}


def _aligner(common: _Common) -> Aligner:
    """One aligner a process and build: its acoustic model takes a third of a second to load."""
    if common.build not in _aligners:
        _aligners.clear()
        _aligners[common.build] = Aligner(common.lexicon, common.settings.align)
    return _aligners[common.build]


def _analyse_into(clip: Clip, common: _Common, path: Path) -> Shard | str:
    """Analyse a clip in a worker; its shard, or the reason why it is skipped."""
    cv2.setNumThreads(1)  # Clips run side by side; threads inside would fight.
    try:
        analysed: AnalysedClip = analyse_clip(
            clip,
            common.mask,
            common.camera,
            _finder(common.models, common.settings.face),
            _aligner(common),
            fps=common.fps,
            codec=common.settings.codec,
            settings=common.settings.motion,
        )
    except UnitselError as error:
        return str(error)
    except Exception as error:  # One bad clip never ends an hour's build.
        return f"{clip.media}: unexpected {type(error).__name__}: {error}"
    return write_shard(path, analysed)


def _analyse(
    clips: Sequence[Clip],
    common: _Common,
    folder: Path,
    jobs: int,
    skipped: dict[str, str],
    tell: Progress,
) -> list[Shard]:
    """Shards of the usable clips, in the clips' order; the others are added to `skipped`."""
    tasks = (
        delayed(_numbered)(i, clip, common, folder / f"{i}.npz") for i, clip in enumerate(clips)
    )
    results: dict[int, Shard | str] = {}
    tell("analysing clips", 0, len(clips))
    try:
        run = Parallel(n_jobs=min(jobs, len(clips)), return_as="generator_unordered", batch_size=1)
        for i, result in run(tasks):
            results[i] = result
            tell("analysing clips", len(results), len(clips))
    except TerminatedWorkerError as error:
        raise CorpusError(
            "a worker of the build was ended from outside (out of memory?); fewer --jobs need less"
        ) from error
    shards = []
    for i, clip in enumerate(clips):
        result = results[i]
        if isinstance(result, Shard):
            shards.append(result)
        else:
            skipped[clip.name] = result
    if not shards:
        first = next(iter(skipped.values()))
        raise CorpusError(f"none of the {len(clips)} clips could be used; the first: {first}")
    return shards


def _numbered(i: int, clip: Clip, common: _Common, path: Path) -> tuple[int, Shard | str]:
    return i, _analyse_into(clip, common, path)
