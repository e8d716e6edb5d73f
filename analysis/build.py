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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from analysis.align import Aligner, AlignSettings
from analysis.clip import AnalysedClip, analyse_clip
from analysis.corpus import Clip, find_clips
from analysis.cost_model import fit_cost_model
from analysis.face import FaceFinder, FaceSettings
from analysis.g2p import speaking_lexicon
from analysis.models import FaceModels, find_models
from analysis.motion import CropSettings, MotionSettings
from analysis.person import find_person
from analysis.shards import Shard, read_shard, write_shard
from analysis.texture import (
    TextureSettings,
    fit_texture,
    lighting_of,
    normalise,
    texture_weights,
)
from database.errors import CorpusError, DatabaseError, UnitselError
from database.lexicon import Lexicon
from database.mask import Camera, Mask
from database.media import probe
from database.phonemes import VISEME_OF
from database.pictures import find_codec
from database.schema import DatabaseContent, Phones, Sequences, TextureModel, Units
from database.track import context_frames, context_windows
from database.writer import write_database

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, how much of it is done, and of how much."""


@dataclass(frozen=True)
class BuildSettings:
    """How a database is built.

    Parameters
    ----------
    focal : float, optional
        Focal length of the camera in pixels; assumed where it is not known.
    codec : str
        Codec of the stored pictures.
    face, motion, crop, texture, align
        Settings of the steps.
    """

    focal: float | None = None
    codec: str = "png"
    face: FaceSettings = field(default_factory=FaceSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    crop: CropSettings = field(default_factory=CropSettings)
    texture: TextureSettings = field(default_factory=TextureSettings)
    align: AlignSettings = field(default_factory=AlignSettings)


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
    if not target.parent.is_dir():
        raise DatabaseError(f"{target}: the folder {target.parent} does not exist; make it first")
    if target.is_dir():
        raise DatabaseError(f"{target}: is a folder; name a file")
    if jobs < 1:
        raise CorpusError(f"the number of jobs must be at least 1, not {jobs}")
    clips = find_clips(corpus, limit=limit, exclude=exclude)
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
            shards = _analyse(usable, common, Path(folder), jobs, skipped, tell)
            content, landmarks = _assemble(shards, common, skipped, tell)
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
        tuple((s.name, note) for s in shards for note in s.notes),
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


def _assemble(
    shards: Sequence[Shard], common: _Common, skipped: dict[str, str], tell: Progress
) -> tuple[DatabaseContent, npt.NDArray[np.float32]]:
    """All that the database keeps but pictures, and the landmarks."""
    tell("describing mouths", 0, len(shards))
    opened = [read_shard(s.path) for s in shards]
    counts = np.array([s.units for s in shards], np.int32)
    reference = np.mean([s.clip_mean for s in shards], axis=0).astype(np.float32)
    lighting = np.stack([lighting_of(s.clip_mean, reference) for s in shards])

    def crops() -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        for i, shard in enumerate(opened):
            yield i, normalise(shard["reduced"], lighting[i])

    def joined(name: str) -> npt.NDArray[Any]:
        return np.concatenate([shard[name] for shard in opened])

    heights = joined("mouth_height")
    texture = _fit_texture(crops(), counts, heights, reference, common.settings.texture)
    pca = []
    for i, normalised in crops():
        pca.append(texture_weights(normalised, texture))
        tell("describing mouths", i + 1, len(shards))

    first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    n = context_frames(common.fps)
    contexts = []
    for shard, analysed in zip(shards, opened, strict=True):
        sampled = shard.track.sample(common.fps, shard.frames)
        contexts.append(context_windows(sampled, n)[analysed["frame"]])
    context = np.concatenate(contexts)
    phoneme = context[:, n]
    units = Units(
        sequence=np.repeat(np.arange(len(shards), dtype=np.int32), counts),
        frame=joined("frame"),
        phoneme=phoneme,
        viseme=VISEME_OF[phoneme],
        pca=np.concatenate(pca),
        mouth_width=joined("mouth_width"),
        mouth_height=heights,
        inner_opening=joined("inner_opening"),
        teeth=joined("teeth"),
        tongue=joined("tongue"),
        rotation=joined("rotation"),
        translation=joined("translation"),
    )
    sequences = Sequences(
        name=tuple(s.name for s in shards),
        words=tuple(s.words for s in shards),
        media=tuple(s.media for s in shards),
        sha256=tuple(s.sha256 for s in shards),
        fps=np.array([s.fps for s in shards], np.float32),
        frames=np.array([s.frames for s in shards], np.int32),
        first_unit=first,
        units=counts,
        lighting=lighting,
    )
    tracks = [s.track for s in shards]
    phones = Phones(
        sequence=np.repeat(
            np.arange(len(tracks), dtype=np.int32), [len(t.phonemes) for t in tracks]
        ),
        phoneme=np.concatenate([t.phonemes for t in tracks]).astype(np.uint8),
        start=np.concatenate([t.boundaries[:-1] for t in tracks]),
        end=np.concatenate([t.boundaries[1:] for t in tracks]),
    )
    report = {
        "skipped": [{"clip": c, "reason": r} for c, r in skipped.items()],
        "repaired": [{"clip": s.name, "note": note} for s in shards for note in s.notes],
    }
    content = DatabaseContent(
        fps=common.fps,
        units=units,
        sequences=sequences,
        phones=phones,
        mask=common.mask,
        camera=common.camera,
        texture=texture,
        costs=fit_cost_model(units, context, texture.eigenvalues, common.fps),
        settings=asdict(common.settings),
        report=report,
    )
    return content, joined("landmarks")


def _fit_texture(
    crops: Iterator[tuple[int, npt.NDArray[np.float32]]],
    counts: npt.NDArray[np.int32],
    heights: npt.NDArray[np.float32],
    reference: npt.NDArray[np.float32],
    settings: TextureSettings,
) -> TextureModel:
    """Principal components of a random sample of all frames."""
    total = int(counts.sum())
    rng = np.random.default_rng(settings.seed)
    chosen = np.sort(rng.choice(total, min(settings.sample, total), replace=False))
    ends = np.cumsum(counts)
    sample = []
    for i, normalised in crops:
        mine = chosen[(chosen >= ends[i] - counts[i]) & (chosen < ends[i])]
        sample.append(normalised[mine - (ends[i] - counts[i])])
    return fit_texture(np.concatenate(sample), heights[chosen], reference, settings)
