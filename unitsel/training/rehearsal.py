"""Settings played on recorded sentences: select each, and measure what comes out.

A trial is one `select_path` a sentence. What the weights do not change (the database as the
selection sees it, each sentence's candidates and target costs) is made once and kept.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from database.cost_definition import CostSettings
from database.reader import UnitDatabase
from database.track import PhonemeTrack
from unitsel.likeness.measures import correlation, sd_ratio, sl_avg, speech_frames, tc_avg, vc_avg
from unitsel.select import Selection, TargetGraph, select_path, target_graph
from unitsel.settings import SelectionSettings
from unitsel.source import SelectionInput

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class TrainingSentence:
    """A recorded sentence: what is said, and how the mouth really moved.

    Parameters
    ----------
    clip, words : str
    track : PhonemeTrack
    frames : (n,) int64
        Numbers of the frames with a face, at the database's rate.
    pca : (n,) float64
        First PCA weight.
    height : (n,) float64
        Mouth height, mm.
    sound : (steps, 26) float, optional
        Sound features, for a target cost that hears.
    """

    clip: str
    words: str
    track: PhonemeTrack
    frames: IntArray
    pca: FloatArray
    height: FloatArray
    sound: npt.NDArray[np.floating] | None = None


@dataclass(frozen=True)
class TrialMeasures:
    """How settings did, means over the sentences.

    Parameters
    ----------
    tc_avg : float
        Equation 12, of the target cost that is searched and in its scale. Constants of the
        costs that are trained do not move it: it is counted with those that the training
        started from, so that sets can be compared.
    sl_avg, vc_avg : float
        Equations 13 to 15: frames; PCA weights.
    r_pca_speech, r_h_speech : float
        Equation 16, inside speech: first PCA weight and mouth height.
    sd_ratio : float
        Standard deviation of the mouth height inside speech over the recording's.
    sentences : tuple of float
        Likeness of each sentence.
    """

    tc_avg: float
    sl_avg: float
    vc_avg: float
    r_pca_speech: float
    r_h_speech: float
    sd_ratio: float
    sentences: tuple[float, ...]

    @property
    def means(self) -> dict[str, float]:
        """All but the single sentences."""
        return {name: getattr(self, name) for name in MEANS}

    @property
    def objectives(self) -> tuple[float, float, float]:
        """TC_avg, -SL_avg, VC_avg: all to be small."""
        return self.tc_avg, -self.sl_avg, self.vc_avg

    @property
    def likeness(self) -> float:
        """Mean of the two correlations."""
        return (self.r_pca_speech + self.r_h_speech) / 2


MEANS: Final = tuple(f.name for f in fields(TrialMeasures) if f.name != "sentences")
"""What is measured on each sentence, in the order of `TrialMeasures`."""


@dataclass(frozen=True)
class Rehearsal:
    """All that a process needs to try settings.

    Parameters
    ----------
    database : Path
    sentences : tuple of TrainingSentence
    base : SelectionSettings
        The target cost and the lips, and the constants that TC_avg is counted with.
    """

    database: Path
    sentences: tuple[TrainingSentence, ...]
    base: SelectionSettings

    @property
    def token(self) -> str:
        """Equal for equal rehearsals; what a worker keeps is known by it."""
        digest = hashlib.sha256(repr((self.database, self.base.as_json())).encode())
        for s in self.sentences:
            digest.update(s.clip.encode())
            for values in (s.track.phonemes, s.track.boundaries, s.frames, s.pca, s.height):
                digest.update(values.tobytes())
            if s.sound is not None:
                digest.update(s.sound.tobytes())
        return digest.hexdigest()


class Player:
    """Selects the sentences of a rehearsal with settings, and measures.

    Parameters
    ----------
    database : UnitDatabase
    rehearsal : Rehearsal
    """

    def __init__(self, database: UnitDatabase, rehearsal: Rehearsal) -> None:
        self.database = database
        self.rehearsal = rehearsal
        self.sentences = rehearsal.sentences
        self.base = rehearsal.base
        self._prepared: dict[CostSettings, tuple[SelectionInput, list[TargetGraph]]] = {}

    def _graphs(self, costs: CostSettings) -> tuple[SelectionInput, list[TargetGraph]]:
        """The database and each sentence's graph with some constants; the base's are kept."""
        if costs not in self._prepared:
            # Others come once each, so only the last is kept: a graph has millions of costs.
            for old in [c for c in self._prepared if c != self.base.costs]:
                del self._prepared[old]
            source = SelectionInput.of(self.database, costs)
            graphs = [
                _slim(
                    target_graph(
                        source,
                        s.track,
                        target=self.base.target,
                        sound=s.sound,
                        lips=self.base.lips,
                    )
                )
                for s in self.sentences
            ]
            self._prepared[costs] = source, graphs
        return self._prepared[costs]

    def select(self, settings: SelectionSettings, sentence: int) -> Selection:
        """Select a sentence, given by its place."""
        source, graphs = self._graphs(settings.costs)
        return select_path(source, graphs[sentence], settings.weights)

    def trajectories(self, units: IntArray, sentence: int) -> tuple[FloatArray, FloatArray]:
        """First PCA weight and mouth height of a path in the frames that were recorded."""
        parameters = self.database.units
        path = units[np.minimum(self.sentences[sentence].frames, len(units) - 1)]
        return (
            parameters.pca[path, 0].astype(np.float64),
            parameters.mouth_height[path].astype(np.float64),
        )

    def measure(self, settings: SelectionSettings) -> TrialMeasures:
        """Select all sentences and take the means of what is measured on each."""
        rows = np.array([self._measure(settings, i) for i in range(len(self.sentences))])
        likeness = tuple(float(v) for v in rows[:, 3:5].mean(axis=1))
        means = dict(zip(MEANS, rows.mean(axis=0).tolist(), strict=True))
        return TrialMeasures(**means, sentences=likeness)

    def _measure(self, settings: SelectionSettings, i: int) -> tuple[float, ...]:
        """What `MEANS` names, of one sentence."""
        sentence, parameters = self.sentences[i], self.database.units
        selection = self.select(settings, i)
        units = selection.units
        target = selection.costs.target
        if settings.costs != self.base.costs:
            target = _priced(self._graphs(self.base.costs)[1][i], units)
        sequence, frame = parameters.sequence[units], parameters.frame[units]
        pca, height = self.trajectories(units, i)
        inside = speech_frames(sentence.track, self.database.fps, len(units))
        inside = inside[np.minimum(sentence.frames, len(units) - 1)]
        return (
            tc_avg(target),
            sl_avg(sequence, frame),
            vc_avg(parameters.pca[units], sequence, frame),
            correlation(pca, sentence.pca, inside),
            correlation(height, sentence.height, inside),
            sd_ratio(height, sentence.height, inside),
        )


def _slim(graph: TargetGraph) -> TargetGraph:
    """The same target cost without what it was mixed from: a third of the memory."""
    return replace(graph, paper=graph.target, guided=None, predicted=None, share=0.0, lips=None)


def _priced(graph: TargetGraph, units: IntArray) -> FloatArray:
    """Target costs of a path in a graph, (T,)."""
    return np.array(
        [
            costs[np.searchsorted(candidates, u)]
            for u, candidates, costs in zip(units, graph.candidates, graph.target, strict=True)
        ]
    )
