"""From a phoneme track to a path of units: candidates, their target costs, the search.

The work is split where the weights come in: `target_graph` does not depend on them, so that
many weights can be tried on one graph.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from database.cost_definition import CostSettings
from database.errors import SelectionError
from database.phonemes import N_PHONEMES, N_VISEMES, PHONEMES, VISEME_OF, VISEMES
from database.track import PhonemeTrack, context_windows, frame_count
from unitsel.costs import Weights, target_costs
from unitsel.search import SearchResult, search
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
        Wanted phoneme of each frame, at the database's rate.
    candidates : T arrays of int32
        Units to choose from; frames of one viseme share an array.
    target : T arrays of float64
        Target cost of each, scaled.
    fallbacks : tuple of Fallback
    duration : float
        Length of the sentence, seconds.
    """

    phonemes: npt.NDArray[np.uint8]
    candidates: tuple[npt.NDArray[np.int32], ...]
    target: tuple[FloatArray, ...]
    fallbacks: tuple[Fallback, ...]
    duration: float


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
    """

    units: IntArray
    fps: float
    duration: float
    costs: SearchResult
    fallbacks: tuple[Fallback, ...]

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
) -> TargetGraph:
    """Candidates of each frame of a track and their target costs.

    Parameters
    ----------
    source : SelectionInput
    track : PhonemeTrack
        What is said.
    exclude_sequences : collection of int or str
        Sequences, by index or name, whose units may not be used.

    Raises
    ------
    SelectionError
        If an excluded sequence does not exist or no unit is left.
    """
    allowed = ~np.isin(source.space.sequence, sequence_indexes(source, exclude_sequences))
    if not allowed.any():
        raise SelectionError("selection: every sequence of the database is excluded")
    viseme = source.viseme
    by_viseme = [np.flatnonzero((viseme == v) & allowed).astype(np.int32) for v in range(N_VISEMES)]
    present = np.bincount(source.phoneme[allowed], minlength=N_PHONEMES) > 0
    phonemes = track.sample(source.fps)
    used: dict[int, int] = {}
    fallbacks = []
    for p in np.unique(phonemes):
        wanted = int(VISEME_OF[p])
        used[int(p)] = wanted
        if by_viseme[wanted].size == 0:
            used[int(p)] = _nearest_viseme(int(p), source, by_viseme, present)
            frames = int((phonemes == p).sum())
            fallbacks.append(Fallback(int(p), wanted, used[int(p)], frames))
    contexts = context_windows(phonemes, source.contexts.shape[1] // 2)
    candidates = tuple(by_viseme[used[int(p)]] for p in phonemes)
    target: list[FloatArray] = []
    for t, c in enumerate(candidates):
        # Long silences and vowels repeat their context.
        if t > 0 and c is candidates[t - 1] and (contexts[t] == contexts[t - 1]).all():
            target.append(target[-1])
            continue
        costs = target_costs(
            contexts[t], source.contexts, source.phoneme_distance, source.context_weights, c
        )
        target.append(costs / source.target_scale)
    return TargetGraph(phonemes, candidates, tuple(target), tuple(fallbacks), track.end)


def select_path(
    source: SelectionInput,
    graph: TargetGraph,
    weights: Weights,
    progress: Callable[[int, int], None] | None = None,
) -> Selection:
    """Search the cheapest path through a graph; see `select_units`."""
    found = search(source.space, graph.candidates, graph.target, weights, progress)
    return Selection(found.path, source.fps, graph.duration, found, graph.fallbacks)


def select_units(
    source: SelectionInput | UnitSource,
    track: PhonemeTrack,
    weights: Weights | None = None,
    settings: CostSettings | None = None,
    exclude_sequences: Collection[int | str] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Selection:
    """Choose a unit for each frame of a phoneme track, at least path cost.

    Parameters
    ----------
    source : SelectionInput or UnitSource
        The database. For many sentences prepare it once with `SelectionInput.of`.
    track : PhonemeTrack
        What is said.
    weights : Weights, optional
        Weights of the path cost.
    settings : CostSettings, optional
        Constants of the costs; only for a database that is not prepared yet.
    exclude_sequences : collection of int or str
        Sequences, by index or name, whose units may not be used.
    progress : callable, optional
        Called with the frames done and the number of frames.

    Returns
    -------
    Selection
        At the database's frame rate; `Selection.at_rate` gives that of a video.

    Raises
    ------
    SelectionError
        If the database holds no unit, all are excluded, or settings come with a prepared one.
    """
    if isinstance(source, SelectionInput):
        if settings is not None:
            raise SelectionError(
                "selection: the database is prepared already; give settings to SelectionInput.of"
            )
    else:
        source = SelectionInput.of(source, settings)
    graph = target_graph(source, track, exclude_sequences)
    return select_path(source, graph, weights or Weights(), progress)


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


def _nearest_viseme(
    phoneme: int,
    source: SelectionInput,
    by_viseme: list[npt.NDArray[np.int32]],
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
