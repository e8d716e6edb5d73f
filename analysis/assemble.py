"""Analysed clips into a database's content: what depends on all clips together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.aam_points import Marks
from analysis.corpus_lips import CorpusLips, LipSettings, fit_corpus_lips
from analysis.cost_model import fit_cost_model
from analysis.guide import GuideClip, GuideSettings, fit_guides
from analysis.lag import LagSettings, find_lags, moved
from analysis.phone_marks import SpokenClip, mark_phones
from analysis.shards import OpenShard, Shard, read_shard
from analysis.sound_offset import (
    OffsetSettings,
    SoundOffset,
    correction,
    find_sound_offset,
    offset_note,
)
from analysis.texture import (
    TextureSettings,
    fit_texture,
    lighting_of,
    normalise,
    texture_weights,
)
from database.guide_model import mouth_parameters
from database.mask import Camera, Mask
from database.phonemes import VISEME_OF
from database.schema import DatabaseContent, Phones, Sequences, TextureModel, UnitLips, Units
from database.sound_features import moved_features
from database.track import PhonemeTrack, context_frames, context_windows

ALL_CLIPS = "all clips"
"""Who is named in the report where a note is on the corpus as a whole."""


def assemble(
    shards: Sequence[Shard],
    *,
    mask: Mask,
    camera: Camera,
    fps: float,
    texture: TextureSettings,
    lag: LagSettings,
    guide: GuideSettings,
    offset: OffsetSettings,
    lips: LipSettings,
    lip_marks: Marks | None,
    codec: str,
    jobs: int,
    settings: dict[str, Any],
    skipped: dict[str, str],
    tell: Callable[[str, int, int], None],
) -> tuple[DatabaseContent, npt.NDArray[np.float32]]:
    """All that a database keeps but pictures, and the landmarks.

    Parameters
    ----------
    shards : sequence of Shard
        The analysed clips, in order.
    mask, camera, fps
        Of the database.
    texture, lag, guide, offset, lips
        Settings of what depends on all clips.
    lip_marks : Marks, optional
        Lips marked by hand.
    codec : str
        Of the shards' pictures.
    jobs : int
        Networks, or clips' lips, fitted at a time.
    settings : dict
        All settings of the build, for the record.
    skipped : dict
        Clips left out, and why.
    tell : callable
        Progress: stage, done, total.

    Returns
    -------
    content : DatabaseContent
    landmarks : (N, 468, 2) float32
    """
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
    model = _fit_texture(crops(), counts, heights, reference, texture)
    pca = []
    for i, normalised in crops():
        pca.append(texture_weights(normalised, model))
        tell("describing mouths", i + 1, len(shards))

    found = fit_corpus_lips(
        shards,
        pca,
        mask=mask,
        codec=codec,
        settings=lips,
        marks=lip_marks,
        jobs=jobs,
        tell=tell,
    )
    width, heights, opening = _mouths(found if lips.source == "aam" else None, joined)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    frames = [shard["frame"] for shard in opened]
    in_step = _in_step(shards, opened, frames, np.split(heights, first[1:]), pca, fps, lag, offset)
    tracks, lags, notes, apart = in_step
    sound = tuple(
        moved_features(shard["sound"], seconds) for shard, seconds in zip(opened, lags, strict=True)
    )
    n = context_frames(fps)
    contexts = [
        context_windows(track.sample(fps, shard.frames), n)[numbers]
        for track, shard, numbers in zip(tracks, shards, frames, strict=True)
    ]
    context = np.concatenate(contexts)
    phoneme = context[:, n]
    units = Units(
        sequence=np.repeat(np.arange(len(shards), dtype=np.int32), counts),
        frame=np.concatenate(frames),
        phoneme=phoneme,
        viseme=VISEME_OF[phoneme],
        pca=np.concatenate(pca),
        mouth_width=width,
        mouth_height=heights,
        inner_opening=opening,
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
    phones = Phones(
        sequence=np.repeat(
            np.arange(len(tracks), dtype=np.int32), [len(t.phonemes) for t in tracks]
        ),
        phoneme=np.concatenate([t.phonemes for t in tracks]).astype(np.uint8),
        start=np.concatenate([t.boundaries[:-1] for t in tracks]),
        end=np.concatenate([t.boundaries[1:] for t in tracks]),
    )
    spoken = [
        SpokenClip((numbers + 0.5) / fps, opening, heard)
        for numbers, opening, heard in zip(
            frames, np.split(joined("inner_opening"), first[1:]), sound, strict=True
        )
    ]
    parameters = np.split(mouth_parameters(units), first[1:])
    learnt = [
        GuideClip(track, (numbers + 0.5) / fps, mouths, heard)
        for track, numbers, mouths, heard in zip(tracks, frames, parameters, sound, strict=True)
    ]
    report: dict[str, Any] = {
        "skipped": [{"clip": c, "reason": r} for c, r in skipped.items()],
        "repaired": [{"clip": c, "note": note} for c, note in notes],
        "sound_offset": None if apart is None else apart.as_json(),
    }
    starts = np.array([s.start for s in shards], np.float64)
    if found is not None:
        lost = [int((clip.found == 0).sum()) for clip in found.clips]
        report["lips"] = {
            "trained_on": found.trained_on,
            "marked": found.marked,
            "fallen_back": sum(lost),
        }
        report["repaired"] += [
            {"clip": shard.name, "note": _lost_lips(k)}
            for shard, k in zip(shards, lost, strict=True)
            if k
        ]
    content = DatabaseContent(
        fps=fps,
        units=units,
        sequences=sequences,
        phones=phones,
        mask=mask,
        camera=camera,
        texture=model,
        costs=fit_cost_model(units, context, model.eigenvalues, fps),
        marks=mark_phones(phones, spoken),
        sound=sound,
        guides=fit_guides(learnt, guide, jobs, tell),
        lips=_unit_lips(found),
        settings=settings,
        report=report,
        starts=starts if starts.any() else None,
    )
    return content, joined("landmarks")


def _mouths(
    found: CorpusLips | None, joined: Callable[[str], npt.NDArray[Any]]
) -> tuple[npt.NDArray[np.float32], ...]:
    """Width, height and inner opening of all units, (N,) each."""
    if found is None:
        return tuple(joined(name) for name in ("mouth_width", "mouth_height", "inner_opening"))
    mouths = [clip.geometry for clip in found.clips]
    parts = ([m.width for m in mouths], [m.height for m in mouths], [m.opening for m in mouths])
    return tuple(np.concatenate(part) for part in parts)


def _unit_lips(found: CorpusLips | None) -> UnitLips | None:
    if found is None:
        return None
    return UnitLips(
        found.model,
        np.concatenate([clip.points for clip in found.clips]),
        np.concatenate([clip.found for clip in found.clips]),
    )


def _lost_lips(frames: int) -> str:
    what = "frame" if frames == 1 else "frames"
    return f"lips not found by the lip model in {frames} {what}; the face mesh's stand in"


def _in_step(
    shards: Sequence[Shard],
    opened: Sequence[OpenShard],
    frames: Sequence[npt.NDArray[np.int32]],
    heights: Sequence[npt.NDArray[np.float32]],
    pca: Sequence[npt.NDArray[np.float32]],
    fps: float,
    lag_settings: LagSettings,
    offset: OffsetSettings,
) -> tuple[list[PhonemeTrack], list[float], tuple[tuple[str, str], ...], SoundOffset | None]:
    """Tracks in step with the picture, by how much each was moved, all repairs, the offset."""
    apart = find_sound_offset(frames, heights, [s["sound"] for s in opened], fps, offset)
    common = -correction(apart, offset)
    expected = [np.column_stack([h, p[:, 0]]) for h, p in zip(heights, pca, strict=True)]
    original = [s.track for s in shards]
    if common:
        original = [moved(s.track, common, s.frames / fps) for s in shards]
    lags = find_lags(original, frames, expected, fps, lag_settings)
    tracks = []
    applied = []
    note = offset_note(apart, offset)
    notes = [] if note is None else [(ALL_CLIPS, note)]
    for shard, track, lag in zip(shards, original, lags, strict=True):
        notes += [(shard.name, note) for note in shard.notes]
        if lag == 0.0:
            tracks.append(track)
            applied.append(common)
            continue
        side = "later" if lag > 0 else "earlier"
        what = f"lips move {abs(lag):.2f} s {side} than the "
        if shard.given:
            # Whoever times phones by hand knows better than we do.
            tracks.append(track)
            applied.append(common)
            what += "phones of the timing file, which were left as they are"
        else:
            tracks.append(moved(track, lag, shard.frames / fps))
            applied.append(common + lag)
            what += "sound; phones moved"
        notes.append((shard.name, what))
    return tracks, applied, tuple(notes), apart


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
