"""A recorded sentence against the selections from a database and what they are compared with.

The references (references.py) are random units of the right viseme, the smoothed mean of
each phoneme (no selection at all), the unit nearest to the real frame (the best that the
database could do), and the guide's own prediction.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.align import Aligner
from analysis.corpus import Clip
from analysis.face import FaceFinder
from analysis.g2p import speaking_lexicon
from analysis.models import find_models
from database.errors import SelectionError
from database.reader import UnitDatabase
from database.schema import GuideModel
from database.track import context_windows, frame_times
from unitsel.likeness.eye_measures import greatest_join_jump
from unitsel.likeness.measures import sl_avg, speech_frames, tc_avg, vc_avg
from unitsel.likeness.recorded import Footage, Target, analysed_target, stored_target
from unitsel.likeness.references import (
    nearest_units,
    predicted_mouths,
    random_units,
    smoothed_means,
)
from unitsel.likeness.rulers import Rulers
from unitsel.likeness.scores import PathScores, Recording, Scores, Trajectories
from unitsel.select import Selection, TargetGraph, select_path, sequence_indexes, target_graph
from unitsel.settings import (
    TARGETS,
    SelectionSettings,
    TargetSettings,
    default_settings,
    settings_for,
)
from unitsel.source import SelectionInput

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

METHODS: Final = (
    "selected",
    *TARGETS,
    *("random", "phoneme_mean", "nearest", "prediction", "prediction_sound", "real"),
)
"""All rows that an evaluation may have: the settings' own selection; that by each target cost;
the references; the recording itself."""

ALL: Final = "all"
"""Stands for every target cost that the database has the guide for."""


@dataclass(frozen=True)
class Sentence:
    """A recorded sentence and how the methods did on it.

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
        Of the recording itself too, as ``"real"``.
    fallbacks : tuple of str
        Visemes that the database lacks.
    footage : Footage or None
        Where the recording is.
    selection : Selection or None
        What was selected, where it is to be kept.
    """

    clip: str
    words: str
    seconds: FloatArray
    inside: npt.NDArray[np.bool_]
    real: Trajectories
    made: dict[str, Trajectories]
    scores: dict[str, Scores]
    fallbacks: tuple[str, ...]
    footage: Footage | None = None
    selection: Selection | None = None


class Evaluator:
    """Compares selections from a database with recordings.

    Parameters
    ----------
    database : UnitDatabase
    settings : SelectionSettings, optional
        What is evaluated as "selected"; the database's own by default.
    methods : collection of str, optional
        Other target costs to evaluate (`unitsel.settings.TARGETS`), each with our own weights
        for it, or `ALL` for all that the database has the guide for.
    models, dictionary : path, optional
        As for a build; only `target` needs them.
    keep_selections : bool
        Whether sentences keep what was selected.

    Raises
    ------
    SelectionError
        If a target cost needs a guide that the database does not hold.
    """

    def __init__(
        self,
        database: UnitDatabase,
        settings: SelectionSettings | None = None,
        *,
        methods: Collection[str] = (),
        models: str | Path | None = None,
        dictionary: str | Path | None = None,
        keep_selections: bool = False,
    ) -> None:
        self.database = database
        self.settings = settings or default_settings(database)
        self.compared = compared_settings(database, self.settings, methods)
        self.source = SelectionInput.of(database, self.settings.costs)
        self.rulers = Rulers(database)
        self._models, self._dictionary = models, dictionary
        self._keep_selections = keep_selections

    @cached_property
    def footage(self) -> tuple[FaceFinder, Aligner]:
        """What clips are analysed with."""
        return FaceFinder(find_models(self._models)), Aligner(speaking_lexicon(self._dictionary))

    def with_guides(self, models: Mapping[str, GuideModel]) -> Evaluator:
        """The same evaluator with other guides in the place of the database's."""
        other = copy.copy(self)
        other.source = self.source.with_guides(models)
        return other

    def target(self, clip: Clip) -> Target:
        """Analyse a held-out clip, in the database's mask, components and lighting."""
        return analysed_target(self.database, clip, *self.footage)

    def recorded(self, sequence: int) -> Target:
        """A sequence of the database as a target, as it is stored."""
        return stored_target(self.database, sequence, *self.rulers.mesh)

    def compare(self, target: Target, exclude_sequences: Sequence[int | str] = ()) -> Sentence:
        """Select a sentence and compare it, and the references, with the recording.

        Raises
        ------
        SelectionError
            If the sentence cannot be selected by the settings' own target cost.
        """
        db = self.database
        selections = self._selections(target, exclude_sequences)
        selected = selections["selected"]
        graph, n_frames = selected.graph, len(selected.units)
        frames = np.minimum(target.frames, n_frames - 1)
        recording = Recording(
            target.track,
            db.fps,
            target.frames,
            speech_frames(target.track, db.fps, n_frames)[frames],
            Trajectories(
                target.pca[:, 0].astype(np.float64), target.height, target.mesh, target.opening
            ),
            self.rulers.closed_at,
        )
        paths = {m: s.units for m, s in selections.items()}
        paths["random"] = random_units(graph.candidates)
        paths["nearest"] = self._nearest(target, n_frames, exclude_sequences)
        made = {m: self.rulers.trajectories(units[frames]) for m, units in paths.items()}
        smooth = smoothed_means(self.rulers.phoneme_means, graph.phonemes, db.fps)[frames]
        made["phoneme_mean"] = Trajectories(*smooth.T)
        made |= self._predictions(target, frames)
        scores = {
            m: recording.score(
                trajectories, self._path_scores(paths[m], graph) if m in paths else None
            )
            for m, trajectories in made.items()
        }
        scores["real"] = recording.score(recording.real)
        return Sentence(
            target.clip,
            target.words,
            frame_times(int(target.frames.max()) + 1, db.fps)[target.frames],
            recording.inside,
            recording.real,
            {m: made[m] for m in METHODS if m in made},
            {m: scores[m] for m in METHODS if m in scores},
            tuple(str(f) for f in selected.fallbacks),
            target.footage,
            selected if self._keep_selections else None,
        )

    def _selections(
        self, target: Target, exclude_sequences: Sequence[int | str]
    ) -> dict[str, Selection]:
        """The selection by each target cost; what two have in common is done once."""
        graphs: dict[str | None, TargetGraph] = {}
        found: dict[SelectionSettings, Selection] = {}
        selections = {}
        for method, settings in self.compared.items():
            chosen = settings.target
            if chosen.guide == "sound" and target.sound is None:
                if method == "selected":
                    raise SelectionError(
                        f"{target.clip}: has no sound, which the target cost 'sound' goes by; "
                        "choose another (--target)"
                    )
                continue
            if settings not in found:
                if chosen.guide is None and graphs:
                    graph = next(iter(graphs.values())).with_share(0.0)
                elif chosen.guide in graphs:
                    graph = graphs[chosen.guide].with_share(chosen.guided)
                else:
                    graph = graphs[chosen.guide] = target_graph(
                        self.source,
                        target.track,
                        exclude_sequences,
                        chosen,
                        target.sound,
                        settings.lips,
                    )
                found[settings] = select_path(self.source, graph, settings.weights)
            selections[method] = found[settings]
        return selections

    def _predictions(self, target: Target, frames: IntArray) -> dict[str, Trajectories]:
        """What the guides expect, those that hear only where they are evaluated."""
        wanted = {"phonemes": "prediction"}
        if target.sound is not None and any(
            s.target.guide == "sound" for s in self.compared.values()
        ):
            wanted["sound"] = "prediction_sound"
        found = {}
        for kind, method in wanted.items():
            if kind in self.source.guides:
                mouths = predicted_mouths(
                    self.source.guides[kind].model,
                    target.track,
                    self.database.fps,
                    target.sound if kind == "sound" else None,
                )
                found[method] = Trajectories(
                    mouths.pca[frames, 0].astype(np.float64),
                    mouths.mouth_height[frames].astype(np.float64),
                    None,
                    None,
                )
        return found

    def _path_scores(self, units: IntArray, graph: TargetGraph) -> PathScores:
        source, parameters = self.source, self.database.units
        wanted = context_windows(graph.phonemes, source.contexts.shape[1] // 2)
        target = source.phoneme_distance[wanted, source.contexts[units]] @ source.context_weights
        sequence, frame, pca = (
            parameters.sequence[units],
            parameters.frame[units],
            parameters.pca[units],
        )
        jump = None
        if self.rulers.natural_step > 0:
            jump = greatest_join_jump(pca, sequence, frame, self.rulers.natural_step)
        return PathScores(
            sl_avg(sequence, frame),
            tc_avg(target / source.target_scale),
            vc_avg(pca, sequence, frame),
            jump,
        )

    def _nearest(
        self, target: Target, n_frames: int, exclude_sequences: Sequence[int | str]
    ) -> IntArray:
        units = self.database.units
        out = sequence_indexes(self.source, exclude_sequences)
        found = nearest_units(units.pca, target.pca, np.flatnonzero(~np.isin(units.sequence, out)))
        # Frames without a face have nothing to be near to; they are not compared either.
        place = np.searchsorted(target.frames, np.arange(n_frames)).clip(0, len(target.frames) - 1)
        return np.asarray(found[place], dtype=np.int64)


def compared_settings(
    database: UnitDatabase, chosen: SelectionSettings, methods: Collection[str] = ()
) -> dict[str, SelectionSettings]:
    """Settings to evaluate by name, the chosen ones first, as "selected".

    Parameters
    ----------
    database : UnitDatabase
    chosen : SelectionSettings
        They stand for their own target cost too; their constants of the costs, and what they ask
        of lips, go for all.
    methods : collection of str
        Names of `unitsel.settings.TARGETS`, or `ALL`; each has the weights that are our own for
        it (`unitsel.settings.settings_for`), for one target cost's weights do not suit another.

    Raises
    ------
    SelectionError
        If a name is none of these, or the database lacks the guide that one needs.
    """
    held = (None, *database.guides)
    names = list(methods)
    if ALL in names:
        able = [n for n in TARGETS if TargetSettings(n).guide in held]
        names = [*able, *(n for n in names if n != ALL)]
    if unknown := [n for n in names if n not in TARGETS]:
        raise SelectionError(
            f"evaluation: {unknown[0]!r} is no target cost; there are {', '.join(TARGETS)} and "
            f"{ALL}"
        )
    wanted: dict[str, SelectionSettings] = {
        n: chosen
        if n == chosen.target.name
        else replace(settings_for(n), costs=chosen.costs, lips=chosen.lips)
        for n in TARGETS
        if n in names
    }
    for settings in (chosen, *wanted.values()):
        target = settings.target
        if target.guide not in held:
            raise SelectionError(
                f"{database.path}: the target cost {target.name!r} needs a guide from "
                f"{target.guide}, which this database does not hold; build it again from at least "
                "20 clips (with sound), or choose 'paper'"
            )
    return {"selected": chosen, **wanted}
