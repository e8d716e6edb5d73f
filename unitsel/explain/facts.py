"""What each frame of a chosen path cost, where it was recorded, and what else there was to choose.

Numbers only; strip.py and page.py show them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from database.cost_definition import visual_features
from database.errors import SelectionError
from database.phonemes import N_PHONEMES, VISEME_OF
from database.reader import UnitDatabase
from unitsel.costs import Weights
from unitsel.likeness.measures import joins
from unitsel.select import Selection, TargetGraph
from unitsel.settings import SelectionSettings

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

PROPORTIONAL = 1e-4
"""Greatest difference, as a part of the greatest value, of a feature and the parameter that it is
a multiple of: features are stored in single precision."""


@dataclass(frozen=True)
class Trajectory:
    """One parameter of the mouth over a sentence: as selected, and as it should have been.

    Parameters
    ----------
    name, unit : str
        For people; the unit may be empty.
    selected : (T,) float64
        Of the chosen units.
    wanted : (T,) float64
        The prediction that guided the selection, else the database's mean of each wanted phoneme.
    predicted : bool
        Which of the two `wanted` is.
    """

    name: str
    unit: str
    selected: FloatArray
    wanted: FloatArray
    predicted: bool


@dataclass(frozen=True)
class PathFacts:
    """The chosen path, frame by frame, at the database's rate.

    A step's costs stand at the frame that it leads to; at the first frame they are 0.

    Parameters
    ----------
    units : (T,) int64
    sequence, recorded_frame : (T,) int64
        Where each unit was recorded.
    wanted, recorded : (T,) uint8
        Phoneme of the sentence, and the one spoken when the unit was recorded.
    target, paper : (T,) float64
        Target cost that was searched with, and the paper's, without weight.
    guided : (T,) float64 or None
        Distance to the predicted trajectory, without weight.
    lips : (T,) float64 or None
        What lips that do not rest or close add to `target`; None where nothing was asked of lips.
    cheapest : (T,) float64
        Least target cost of any candidate.
    rank, candidates : (T,) int64
        Place of the unit among the candidates by target cost, from 1; number of candidates.
    visual, skip : (T,) float64
        f and g of the step to each frame, without weight.
    join : (T,) bool
        Whether the frame does not follow the one before it in the recording (`measures.joins`).
    weights : Weights
    trajectories : tuple of Trajectory
    """

    units: IntArray
    sequence: IntArray
    recorded_frame: IntArray
    wanted: npt.NDArray[np.uint8]
    recorded: npt.NDArray[np.uint8]
    target: FloatArray
    paper: FloatArray
    guided: FloatArray | None
    lips: FloatArray | None
    cheapest: FloatArray
    rank: IntArray
    candidates: IntArray
    visual: FloatArray
    skip: FloatArray
    join: BoolArray
    weights: Weights
    trajectories: tuple[Trajectory, ...]

    def __len__(self) -> int:
        return len(self.units)

    @property
    def weighted_target(self) -> FloatArray:
        """(T,) float64: each frame's part of the path cost that is target cost."""
        return np.asarray(self.weights.target * self.target)

    @property
    def weighted_visual(self) -> FloatArray:
        """(T,) float64: the part that is visual cost of the step to the frame."""
        return np.asarray(self.weights.concatenation * self.weights.visual * self.visual)

    @property
    def weighted_skip(self) -> FloatArray:
        """(T,) float64: the part that is skip cost of the step to the frame."""
        return np.asarray(self.weights.concatenation * self.weights.skip * self.skip)

    @property
    def weighted(self) -> FloatArray:
        """(T,) float64: each frame's part of the path cost."""
        return self.weighted_target + self.weighted_visual + self.weighted_skip

    @property
    def segment_starts(self) -> IntArray:
        """First frame of each recorded segment, (L,) int64."""
        starts = self.join.copy()
        starts[0] = True
        return np.flatnonzero(starts).astype(np.int64)

    @property
    def other_viseme(self) -> BoolArray:
        """(T,) bool: units of another viseme than the wanted one, for want of any."""
        return np.asarray(VISEME_OF[self.wanted] != VISEME_OF[self.recorded], dtype=np.bool_)

    def worst_frames(self, n: int) -> list[int]:
        """Frames of the greatest target cost, the greatest first, one of each wanted phone."""
        run = np.cumsum(np.diff(self.wanted.astype(np.int64), prepend=-1) != 0)
        order = np.argsort(-self.target, kind="stable")
        _, first = np.unique(run[order], return_index=True)
        return [int(t) for t in order[np.sort(first)][:n]]

    def worst_joins(self, n: int) -> list[int]:
        """Frames that the costliest joins lead to, the costliest first."""
        there = np.flatnonzero(self.join)
        cost = (self.weighted_visual + self.weighted_skip)[there]
        return [int(t) for t in there[np.argsort(-cost, kind="stable")][:n]]


def path_facts(
    database: UnitDatabase, selection: Selection, settings: SelectionSettings
) -> PathFacts:
    """Gather what there is to say about a path.

    Parameters
    ----------
    database : UnitDatabase
        Of the units.
    selection : Selection
    settings : SelectionSettings
        What it was selected with.

    Raises
    ------
    SelectionError
        If the selection is of another database.
    """
    graph, units = selection.graph, np.asarray(selection.units, dtype=np.int64)
    if selection.fps != database.fps or units.max() >= len(database):
        raise SelectionError(f"{database.path}: is not the database that this path goes through")
    sequence = database.units.sequence[units].astype(np.int64)
    frame = database.units.frame[units].astype(np.int64)
    places = [_place(graph, t, int(u)) for t, u in enumerate(units)]
    searched = zip(graph.target, selection.costs.target, strict=True)
    standing = [(float(costs.min()), int((costs < own).sum()) + 1) for costs, own in searched]
    guided, lips = graph.guided, graph.lips
    return PathFacts(
        units=units,
        sequence=sequence,
        recorded_frame=frame,
        wanted=graph.phonemes,
        recorded=database.units.phoneme[units],
        target=np.asarray(selection.costs.target, dtype=np.float64),
        paper=np.array([graph.paper[t][i] for t, i in enumerate(places)], dtype=np.float64),
        guided=None
        if guided is None
        else np.array([guided[t][i] for t, i in enumerate(places)], dtype=np.float64),
        lips=None
        if lips is None
        else np.array(
            [0.0 if x is None else x[i] for x, i in zip(lips, places, strict=True)],
            dtype=np.float64,
        ),
        cheapest=np.array([least for least, _ in standing], dtype=np.float64),
        rank=np.array([rank for _, rank in standing], dtype=np.int64),
        candidates=np.array([len(c) for c in graph.candidates], dtype=np.int64),
        visual=np.concatenate([[0.0], selection.costs.visual]),
        skip=np.concatenate([[0.0], selection.costs.skip]),
        join=np.concatenate([[False], joins(sequence, frame)]),
        weights=settings.weights,
        trajectories=_trajectories(database, selection, settings),
    )


def _place(graph: TargetGraph, t: int, unit: int) -> int:
    """Where a unit stands among the candidates of a frame."""
    candidates = graph.candidates[t]
    place = int(np.searchsorted(candidates, unit))
    if place == len(candidates) or candidates[place] != unit:
        raise SelectionError(f"selection: unit {unit} is no candidate of frame {t}")
    return place


def _trajectories(
    database: UnitDatabase, selection: Selection, settings: SelectionSettings
) -> tuple[Trajectory, ...]:
    """Mouth height and first PCA weight as selected, and as they should have been.

    A prediction is in scaled features, of which both parameters are multiples
    (`database.cost_definition.visual_features`); by that their columns are found. A group of
    weight 0 has none.
    """
    units, graph = database.units, selection.graph
    parameters = (
        ("mouth height", "mm", units.mouth_height.astype(np.float64)),
        ("first PCA weight", "", units.pca[:, 0].astype(np.float64)),
    )
    features = None
    if graph.predicted is not None:
        weights = settings.costs.features
        features, _ = visual_features(units, database.texture.eigenvalues, database.costs, weights)
    out = []
    for name, unit, values in parameters:
        column = None if features is None else _multiple_of(values, features)
        if column is None or graph.predicted is None:
            wanted = _means(values, units.phoneme)[graph.phonemes]
        else:
            wanted = graph.predicted[:, column[0]].astype(np.float64) / column[1]
        selected = values[selection.units]
        out.append(Trajectory(name, unit, selected, wanted, predicted=column is not None))
    return tuple(out)


def _means(values: FloatArray, phoneme: npt.NDArray[np.uint8]) -> FloatArray:
    """Mean of each phoneme's units, (43,); phonemes without any get the mean of all."""
    number = np.bincount(phoneme, minlength=N_PHONEMES)
    total = np.bincount(phoneme, weights=values, minlength=N_PHONEMES)
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), values.mean()))


def _multiple_of(values: FloatArray, features: npt.NDArray[np.float32]) -> tuple[int, float] | None:
    """Find the column of features that is a multiple of a parameter, and the factor."""
    size = float(values @ values)
    if size == 0:
        return None
    for c in range(features.shape[1]):
        column = features[:, c].astype(np.float64)
        factor = float(column @ values) / size
        rest = float(np.abs(column - factor * values).max())
        if factor > 0 and rest <= PROPORTIONAL * float(np.abs(column).max()):
            return c, factor
    return None
