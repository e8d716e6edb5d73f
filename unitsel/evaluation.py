"""How like the real person: sentences selected from a database against their recordings.

Each held-out clip is aligned and analysed by default settings, with the database's mask,
principal components and lighting rule, and never put in step (analysis/lag.py); its phones are
given to the selection; the mouths that come back are compared with the recorded ones, frame by
frame. The same is done for three references: random units of the right viseme, the smoothed mean
of each phoneme (no selection at all), and the unit nearest to the real frame (the best that the
database could do).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from analysis.align import Aligner
from analysis.clip import AnalysedClip, analyse_clip, sha256_of
from analysis.corpus import Clip, find_clips
from analysis.face import FaceFinder
from analysis.g2p import speaking_lexicon
from analysis.lips import mesh_mouth_height
from analysis.models import find_models
from analysis.texture import describe_clip
from database.errors import CorpusError, UnitselError
from database.phonemes import N_PHONEMES
from database.reader import UnitDatabase
from database.track import PhonemeTrack, context_windows, frame_times
from unitsel.costs import Weights
from unitsel.measures import correlation, sd_ratio, sl_avg, speech_frames, tc_avg, vc_avg
from unitsel.select import TargetGraph, select_path, sequence_indexes, target_graph
from unitsel.source import SelectionInput

FloatArray = npt.NDArray[np.float64]

METHODS: Final = ("selected", "random", "phoneme_mean", "nearest")

SMOOTHING_SECONDS: Final = 0.12
"""Span over which the phoneme means are smoothed: three frames at 25 fps."""

RANDOM_SEED: Final = 0


@dataclass(frozen=True)
class Scores:
    """Likeness and costs; None where a method has no units to count.

    Parameters
    ----------
    r_pca, r_h : float
        Correlation of the first PCA weight and of the mouth height with the recording's
        (equation 16), over the whole sentence.
    r_pca_speech, r_h_speech : float
        The same from the first to the last phone that is not silence.
    sd_ratio : float
        Standard deviation of the mouth height inside speech in relation to the recording's.
    sd_ratio_pca : float
        The same of the first PCA weight.
    r_h_mesh, r_h_mesh_speech : float
        Correlation of the raw face mesh's mouth height: the ruler that analysis does not move.
    sl_avg, tc_avg, vc_avg : float or None
        Equations 12 to 15.
    """

    r_pca: float
    r_h: float
    r_pca_speech: float
    r_h_speech: float
    sd_ratio: float
    sd_ratio_pca: float
    r_h_mesh: float
    r_h_mesh_speech: float
    sl_avg: float | None
    tc_avg: float | None
    vc_avg: float | None


@dataclass(frozen=True)
class Trajectories:
    """First PCA weight and mouth height of a sentence, frame by frame."""

    pca: FloatArray
    height: FloatArray
    mesh: FloatArray


@dataclass(frozen=True)
class Sentence:
    """A held-out clip and how the methods did on it.

    Parameters
    ----------
    clip, words : str
    seconds : (n,) float64
        Middle of each compared frame.
    inside : (n,) bool
        Whether it lies inside speech.
    real : Trajectories
    made : dict of method to Trajectories
    scores : dict of method to Scores
    fallbacks : tuple of str
        Visemes that the database lacks.
    """

    clip: str
    words: str
    seconds: FloatArray
    inside: npt.NDArray[np.bool_]
    real: Trajectories
    made: dict[str, Trajectories]
    scores: dict[str, Scores]
    fallbacks: tuple[str, ...]


@dataclass(frozen=True)
class Evaluation:
    """Sentences, their means, and the clips that could not be used."""

    sentences: tuple[Sentence, ...]
    skipped: tuple[tuple[str, str], ...]

    @cached_property
    def means(self) -> dict[str, Scores]:
        """Mean over the sentences, method by method."""
        return {m: _mean([s.scores[m] for s in self.sentences]) for m in METHODS}

    def as_json(self) -> dict[str, Any]:
        """The evaluation for machines."""
        return {
            **{m: asdict(scores) for m, scores in self.means.items()},
            "sentences": [
                {
                    "clip": s.clip,
                    "words": s.words,
                    "fallbacks": list(s.fallbacks),
                    **{m: asdict(scores) for m, scores in s.scores.items()},
                }
                for s in self.sentences
            ],
            "skipped": [{"clip": c, "reason": r} for c, r in self.skipped],
        }


@dataclass(frozen=True)
class Target:
    """What a held-out clip asks for, and what was recorded of it.

    Parameters
    ----------
    clip, words : str
    track : PhonemeTrack
    frames : (n,) int64
        Numbers of the frames with a face, at the database's rate.
    pca : (n, K) float32
        PCA weights, in the database's components and lighting.
    height : (n,) float64
        Mouth height, mm.
    mesh : (n,) float64
        Mouth height of the raw face mesh (`analysis.lips.mesh_mouth_height`).
    """

    clip: str
    words: str
    track: PhonemeTrack
    frames: npt.NDArray[np.int64]
    pca: npt.NDArray[np.float32]
    height: FloatArray
    mesh: FloatArray


class Evaluator:
    """Compares selections from a database with recordings.

    Parameters
    ----------
    database : UnitDatabase
    models, dictionary : path, optional
        As for a build.
    """

    def __init__(
        self,
        database: UnitDatabase,
        *,
        models: str | Path | None = None,
        dictionary: str | Path | None = None,
    ) -> None:
        self.database = database
        self.source = SelectionInput.of(database)
        self._finder = FaceFinder(find_models(models))
        self._aligner = Aligner(speaking_lexicon(dictionary))
        units = database.units
        self._means = _phoneme_means(
            np.column_stack(
                [
                    units.pca[:, 0],
                    units.mouth_height,
                    mesh_mouth_height(database.landmarks(slice(None))),
                ]
            ),
            units.phoneme,
        )
        self._tree = cKDTree(units.pca)

    def target(self, clip: Clip) -> Target:
        """Analyse a held-out clip, in the database's mask, components and lighting."""
        db = self.database
        analysed: AnalysedClip = analyse_clip(
            clip, db.mask, db.camera, self._finder, self._aligner, fps=db.fps
        )
        pca = describe_clip(analysed.reduced, db.texture)
        return Target(
            clip.name,
            analysed.alignment.text,
            analysed.alignment.track,
            analysed.face.numbers.astype(np.int64),
            pca,
            analysed.lips.height.astype(np.float64),
            mesh_mouth_height(analysed.face.landmarks),
        )

    def compare(
        self, target: Target, weights: Weights, exclude_sequences: Sequence[int | str] = ()
    ) -> Sentence:
        """Select a sentence and compare it, and the references, with the recording."""
        graph = target_graph(self.source, target.track, exclude_sequences)
        selection = select_path(self.source, graph, weights)
        frames = np.minimum(target.frames, len(selection.units) - 1)
        inside = speech_frames(target.track, self.database.fps, len(selection.units))[frames]
        real = Trajectories(target.pca[:, 0].astype(np.float64), target.height, target.mesh)
        made: dict[str, Trajectories] = {}
        scores: dict[str, Scores] = {}
        paths = {
            "selected": selection.units,
            "random": _random_units(graph),
            "nearest": self._nearest(target, len(selection.units), exclude_sequences),
        }
        for method, units in paths.items():
            made[method] = self._trajectories(units[frames])
            scores[method] = _scores(made[method], real, inside, self._costs(units, graph))
        made["phoneme_mean"] = self._smoothed_means(graph.phonemes, frames)
        scores["phoneme_mean"] = _scores(made["phoneme_mean"], real, inside, (None, None, None))
        return Sentence(
            target.clip,
            target.words,
            frame_times(int(target.frames.max()) + 1, self.database.fps)[target.frames],
            inside,
            real,
            {m: made[m] for m in METHODS},
            {m: scores[m] for m in METHODS},
            tuple(str(f) for f in selection.fallbacks),
        )

    def _trajectories(self, units: npt.NDArray[np.int64]) -> Trajectories:
        parameters = self.database.units
        return Trajectories(
            parameters.pca[units, 0].astype(np.float64),
            parameters.mouth_height[units].astype(np.float64),
            mesh_mouth_height(self.database.landmarks(units)),
        )

    def _costs(
        self, units: npt.NDArray[np.int64], graph: TargetGraph
    ) -> tuple[float, float, float]:
        """Mean segment length, target cost and visual cost of a path."""
        source, parameters = self.source, self.database.units
        wanted = context_windows(graph.phonemes, source.contexts.shape[1] // 2)
        target = source.phoneme_distance[wanted, source.contexts[units]] @ source.context_weights
        sequence, frame = parameters.sequence[units], parameters.frame[units]
        return (
            sl_avg(sequence, frame),
            tc_avg(target / source.target_scale),
            vc_avg(parameters.pca[units], sequence, frame),
        )

    def _nearest(
        self, target: Target, n_frames: int, exclude_sequences: Sequence[int | str]
    ) -> npt.NDArray[np.int64]:
        """For each frame the unit whose texture is nearest to the recorded one's."""
        tree, ids = self._tree, np.arange(len(self.database))
        if exclude_sequences:
            out = sequence_indexes(self.source, exclude_sequences)
            ids = np.flatnonzero(~np.isin(self.database.units.sequence, out))
            tree = cKDTree(self.database.units.pca[ids])
        _, found = tree.query(target.pca)
        # Frames without a face have nothing to be near to; they are not compared either.
        place = np.searchsorted(target.frames, np.arange(n_frames)).clip(0, len(target.frames) - 1)
        return np.asarray(ids[found[place]], dtype=np.int64)

    def _smoothed_means(
        self, phonemes: npt.NDArray[np.uint8], frames: npt.NDArray[np.int64]
    ) -> Trajectories:
        span = max(1, round(SMOOTHING_SECONDS * self.database.fps))
        smooth = uniform_filter1d(self._means[phonemes], span, axis=0, mode="nearest")
        return Trajectories(smooth[frames, 0], smooth[frames, 1], smooth[frames, 2])


def evaluate(
    database: UnitDatabase,
    heldout: str | Path,
    *,
    weights: Weights | None = None,
    limit: int | None = None,
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Evaluation:
    """Evaluate a database on clips that it does not hold.

    Parameters
    ----------
    database : UnitDatabase
    heldout : path
        Folder of clips with their words or timings.
    weights : Weights, optional
    limit : int, optional
        Only so many clips.
    models, dictionary : path, optional
        As for a build.
    progress : callable, optional

    Returns
    -------
    Evaluation

    Raises
    ------
    CorpusError
        If no clip can be used; one that is part of the database cannot.
    """
    clips = find_clips(heldout, limit=limit)
    evaluator = Evaluator(database, models=models, dictionary=dictionary)
    known = set(database.sequences.sha256)
    sentences: list[Sentence] = []
    skipped: list[tuple[str, str]] = []
    for i, clip in enumerate(clips):
        if progress is not None:
            progress("evaluating", i, len(clips))
        try:
            if sha256_of(clip.media) in known:
                raise CorpusError(
                    f"{clip.media}: is part of the database, so it tests nothing; build without "
                    f"it (--exclude {clip.name})"
                )
            target = evaluator.target(clip)
            sentences.append(evaluator.compare(target, weights or Weights()))
        except UnitselError as error:
            skipped.append((clip.name, str(error)))
        except Exception as error:  # As in a build: one bad clip does not end the rest.
            what = f"{clip.media}: unexpected {type(error).__name__}: {error}"
            skipped.append((clip.name, what))
    if progress is not None:
        progress("evaluating", len(clips), len(clips))
    if not sentences:
        raise CorpusError(f"{heldout}: no clip could be evaluated; the first: {skipped[0][1]}")
    return Evaluation(tuple(sentences), tuple(skipped))


def _scores(
    made: Trajectories,
    real: Trajectories,
    inside: npt.NDArray[np.bool_],
    costs: tuple[float, float, float] | tuple[None, None, None],
) -> Scores:
    return Scores(
        r_pca=correlation(made.pca, real.pca),
        r_h=correlation(made.height, real.height),
        r_pca_speech=correlation(made.pca, real.pca, inside),
        r_h_speech=correlation(made.height, real.height, inside),
        sd_ratio=sd_ratio(made.height, real.height, inside),
        sd_ratio_pca=sd_ratio(made.pca, real.pca, inside),
        r_h_mesh=correlation(made.mesh, real.mesh),
        r_h_mesh_speech=correlation(made.mesh, real.mesh, inside),
        sl_avg=costs[0],
        tc_avg=costs[1],
        vc_avg=costs[2],
    )


def _mean(scores: Sequence[Scores]) -> Scores:
    rows = [asdict(s) for s in scores]
    means: dict[str, Any] = {}
    for name in rows[0]:
        values = [r[name] for r in rows if r[name] is not None]
        means[name] = float(np.mean(values)) if values else None
    return Scores(**means)


def _random_units(graph: TargetGraph) -> npt.NDArray[np.int64]:
    rng = np.random.default_rng(RANDOM_SEED)
    return np.array([rng.choice(c) for c in graph.candidates], dtype=np.int64)


def _phoneme_means(values: npt.NDArray[np.floating], phoneme: npt.NDArray[np.uint8]) -> FloatArray:
    """Mean of each phoneme's frames; phonemes without any get the mean of all."""
    out = np.tile(values.mean(axis=0, dtype=np.float64), (N_PHONEMES, 1))
    for p in np.unique(phoneme):
        out[p] = values[phoneme == p].mean(axis=0, dtype=np.float64)
    return out
