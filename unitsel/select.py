"""From a phoneme track to a path of units: candidates, their target costs, the search.

The work is split where the weights come in: `target_graph` does not depend on them, so that
many weights can be tried on one graph.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.phonemes import N_PHONEMES, PHONEMES, VISEME_OF, VISEMES
from database.sound import Sound
from database.track import PhonemeTrack, frame_count
from unitsel.costs import Weights
from unitsel.guide import Guide, guided_costs
from unitsel.lip_targets import OFF, RestSettings, lip_costs, wanted_phonemes
from unitsel.search import SearchResult, search
from unitsel.search.result import priced
from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.source import SelectionInput, UnitSource

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Fallback:
    """A viseme that no candidate has, and the one whose units stand in.

    Parameters
    ----------
    phoneme : int
        The phoneme that was wanted.
    missing, used : int
        Visemes.
    frames : int
        Frames of the sentence that this concerns.
    """

    phoneme: int
    missing: int
    used: int
    frames: int

    def __str__(self) -> str:
        return (
            f"no unit shows {PHONEMES[self.phoneme]} (viseme {self.missing}): {self.frames} "
            f"frames use units of viseme {self.used} ({' '.join(VISEMES[self.used])})"
        )


@dataclass(frozen=True)
class TargetGraph:
    """Candidates of each frame of a sentence and what they cost as targets, before weights.

    Parameters
    ----------
    phonemes : (T,) uint8
        Wanted phoneme of each frame, at the database's rate
        (`unitsel.lip_targets.wanted_phonemes`).
    candidates : T arrays of int32
        Units to choose from; frames of one viseme share an array.
    paper : T arrays of float64
        The paper's target cost of each, scaled.
    guided : T arrays of float64, or None
        Their guided target cost, scaled, where a guide was asked for.
    predicted : (T, G) float32, or None
        Features of the mouths that the guide expects.
    share : float
        Of the guided cost in the target cost.
    fallbacks : tuple of Fallback
    duration : float
        Length of the sentence, seconds.
    lips : T of float64 arrays or None, optional
        What lips that do not rest or close add to the target cost
        (`unitsel.lip_targets.lip_costs`), with its weights.
    """

    phonemes: npt.NDArray[np.uint8]
    candidates: tuple[npt.NDArray[np.int32], ...]
    paper: tuple[FloatArray, ...]
    guided: tuple[FloatArray, ...] | None
    predicted: npt.NDArray[np.float32] | None
    share: float
    fallbacks: tuple[Fallback, ...]
    duration: float
    lips: tuple[FloatArray | None, ...] | None = None

    @cached_property
    def target(self) -> tuple[FloatArray, ...]:
        """T arrays of float64: the target cost that is searched.

        The paper's and the guided in shares, and what lips add.
        """
        alike = self._alike
        if self.lips is None:
            return alike
        return tuple(a if x is None else a + x for a, x in zip(alike, self.lips, strict=True))

    @property
    def _alike(self) -> tuple[FloatArray, ...]:
        """The paper's cost and the guided in shares."""
        if self.guided is None or self.share == 0:
            return self.paper
        if self.share == 1:
            return self.guided
        return tuple(
            (1 - self.share) * p + self.share * g
            for p, g in zip(self.paper, self.guided, strict=True)
        )

    def with_share(self, share: float) -> TargetGraph:
        """The same graph with another share of the guided cost.

        Raises
        ------
        SelectionError
            If there is no guided cost to have a share.
        """
        if share > 0 and self.guided is None:
            raise SelectionError("selection: this graph was made without a guide")
        return replace(self, share=share)


@dataclass(frozen=True)
class Selection:
    """The units chosen for a sentence, at the database's frame rate.

    Parameters
    ----------
    units : (T,) int64
        Unit of each frame.
    fps : float
        Frame rate of the database, 1/s.
    duration : float
        Length of the sentence, seconds.
    costs : SearchResult
        Path cost and its terms.
    fallbacks : tuple of Fallback
        Visemes that the database lacks.
    graph : TargetGraph
        What was asked for.
    """

    units: IntArray
    fps: float
    duration: float
    costs: SearchResult
    fallbacks: tuple[Fallback, ...]
    graph: TargetGraph

    def at_rate(self, fps: float, n_frames: int | None = None) -> IntArray:
        """Resample to a video of another rate: the unit nearest in time of each frame.

        Parameters
        ----------
        fps : float
            Frames a second of the video.
        n_frames : int, optional
            Frames of the video; by default as many as the sentence is long. Beyond the end the
            last unit stays.

        Returns
        -------
        (n_frames,) int64
        """
        if not (np.isfinite(fps) and fps > 0):
            raise SelectionError(f"selection: frame rate must be positive, got {fps!r}")
        n = frame_count(self.duration, fps) if n_frames is None else n_frames
        # The frame whose middle is nearest is the one whose span holds the time. A time on the
        # border of two belongs to the later one, whatever the rounding.
        place = np.floor((np.arange(n) + 0.5) * (self.fps / fps) + 1e-9).astype(np.int64)
        units: IntArray = self.units[np.minimum(place, len(self.units) - 1)]
        return units


def target_graph(
    source: SelectionInput,
    track: PhonemeTrack,
    exclude_sequences: Collection[int | str] = (),
    target: TargetSettings | None = None,
    sound: Sound | npt.NDArray[np.floating] | None = None,
    lips: RestSettings | None = None,
) -> TargetGraph:
    """Candidates of each frame of a track and their target costs.

    Parameters
    ----------
    source : SelectionInput
    track : PhonemeTrack
        What is said.
    exclude_sequences : collection of int or str
        Sequences, by index or name, whose units may not be used.
    target : TargetSettings, optional
        Which target cost; the paper's by default.
    sound : Sound or (steps, 26) float, optional
        What is heard, for a guide that hears.
    lips : RestSettings, optional
        How lips are held to rest and closure; not at all by default.

    Raises
    ------
    SelectionError
        If an excluded sequence does not exist, no unit is left, or the target cost needs a
        guide that the database does not hold, or sound that is not given.
    """
    chosen = target or TargetSettings("paper")
    lips = lips or OFF
    guide = _guide(source, chosen)
    by_viseme = source.candidates(sequence_indexes(source, exclude_sequences))
    if not any(len(units) for units in by_viseme):
        raise SelectionError("selection: every sequence of the database is excluded")
    present = np.zeros(N_PHONEMES, dtype=np.bool_)
    for units in by_viseme:
        present[source.phoneme[units]] = True
    phonemes = wanted_phonemes(track, source.fps, lips)
    used: dict[int, int] = {}
    fallbacks = []
    for p in np.unique(phonemes):
        wanted = int(VISEME_OF[p])
        used[int(p)] = wanted
        if by_viseme[wanted].size == 0:
            used[int(p)] = _nearest_viseme(int(p), source, by_viseme, present)
            frames = int((phonemes == p).sum())
            fallbacks.append(Fallback(int(p), wanted, used[int(p)], frames))
    candidates = tuple(by_viseme[used[int(p)]] for p in phonemes)
    paper = source.run_targets.costs(phonemes, candidates, source.target_scale)
    predicted, guided = None, None
    if guide is not None:
        predicted = guide.predicted(track, source.fps, sound)
        space = source.space
        guided = tuple(
            guided_costs(mouth, space.features, space.groups, c) / source.guide_scale
            for mouth, c in zip(predicted, candidates, strict=True)
        )
    return TargetGraph(
        phonemes,
        candidates,
        paper,
        guided,
        predicted,
        chosen.guided,
        tuple(fallbacks),
        track.end,
        lip_costs(source.lips, track, source.fps, candidates, lips),
    )


def select_path(
    source: SelectionInput,
    graph: TargetGraph,
    weights: Weights,
    progress: Callable[[int, int], None] | None = None,
    after: int | None = None,
) -> Selection:
    """Search the cheapest path through a graph; see `select_units`."""
    if after is None:
        found = search(source.space, graph.candidates, graph.target, weights, progress)
    else:
        # The unit before is a frame with one candidate, which costs nothing.
        start = np.array([after], dtype=np.int32)
        whole = search(
            source.space,
            (start, *graph.candidates),
            (np.zeros(1), *graph.target),
            weights,
            progress,
        )
        found = priced(source.space, whole.path[1:], whole.target[1:], weights)
    return Selection(found.path, source.fps, graph.duration, found, graph.fallbacks, graph)


def select_units(
    source: SelectionInput | UnitSource,
    track: PhonemeTrack,
    settings: SelectionSettings | Weights | None = None,
    exclude_sequences: Collection[int | str] = (),
    sound: Sound | npt.NDArray[np.floating] | None = None,
    progress: Callable[[int, int], None] | None = None,
    after: int | None = None,
) -> Selection:
    """Choose a unit for each frame of a phoneme track, at least path cost.

    Parameters
    ----------
    source : SelectionInput or UnitSource
        The database. For many sentences prepare it once with `SelectionInput.of`.
    track : PhonemeTrack
        What is said.
    settings : SelectionSettings or Weights, optional
        Weights, constants of the costs, target cost and lips; weights alone go with the paper's
        cost and nothing else.
    exclude_sequences : collection of int or str
        Sequences, by index or name, whose units may not be used.
    sound : Sound or (steps, 26) float, optional
        What is heard, for a guide that hears.
    progress : callable, optional
        Called with the frames done and the number of frames.
    after : int, optional
        Unit that is shown right before, which the first one is to follow from.

    Returns
    -------
    Selection
        At the database's frame rate; `Selection.at_rate` gives that of a video.

    Raises
    ------
    SelectionError
        If the database holds no unit, all are excluded, or a prepared one was prepared with
        other constants.
    """
    if settings is None or isinstance(settings, Weights):
        settings = SelectionSettings(
            settings or Weights(), target=TargetSettings("paper"), lips=OFF
        )
    if not isinstance(source, SelectionInput):
        source = SelectionInput.of(source, settings.costs)
    elif source.costs != settings.costs:
        raise SelectionError(
            "selection: the database was prepared with other constants of the costs; give these "
            "to SelectionInput.of"
        )
    graph = target_graph(source, track, exclude_sequences, settings.target, sound, settings.lips)
    return select_path(source, graph, settings.weights, progress, after)


def sequence_indexes(source: SelectionInput, sequences: Collection[int | str]) -> list[int]:
    """Indexes of sequences given by index or name."""
    if isinstance(sequences, str):
        sequences = (sequences,)
    indexes = []
    for s in sequences:
        if isinstance(s, str):
            if s not in source.names:
                raise SelectionError(f"selection: the database has no sequence {s!r} to exclude")
            indexes.append(source.names.index(s))
        else:
            if not 0 <= s < len(source.names):
                raise SelectionError(
                    f"selection: sequences to exclude must lie in 0..{len(source.names) - 1}, "
                    f"got {s}"
                )
            indexes.append(int(s))
    return indexes


def _guide(source: SelectionInput, target: TargetSettings) -> Guide | None:
    """Find the guide that a target cost needs."""
    if target.guide is None:
        return None
    if target.guide not in source.guides:
        held = ", ".join(source.guides) or "none"
        raise SelectionError(
            f"selection: target cost {target.name!r} needs a guide from {target.guide}, the "
            f"database holds {held}; build it again from more clips, or choose 'paper'"
        )
    return source.guides[target.guide]


def _nearest_viseme(
    phoneme: int,
    source: SelectionInput,
    by_viseme: Sequence[npt.NDArray[np.int32]],
    present: npt.NDArray[np.bool_],
) -> int:
    """Find the viseme with units whose phonemes look most like a phoneme, by their mean M."""
    row = source.phoneme_distance[phoneme].astype(np.float64)
    best, nearest = np.inf, -1
    for v, units in enumerate(by_viseme):
        members = present & np.equal(VISEME_OF, v)
        if units.size and row[members].mean() < best:
            best, nearest = float(row[members].mean()), v
    return nearest
