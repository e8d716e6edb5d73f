"""The cheapest path through the candidates: an exact Viterbi search.

The path cost of Liu and Ostermann 2009, equation 9, over candidates ``u_1 .. u_T``::

    wtc * sum_t TC(t, u_t) + wcc * sum_t [ wccf * f(u_t-1, u_t) + wccg * g(u_t-1, u_t) ]

Half of a sentence may be silence with ten thousand candidates a frame, so not every pair is
looked at. What is left out cannot be on a cheapest path:

* A step splits in two. A *special* leads to the same unit or a few frames on in the same
  sequence, and at most p sources of a unit are special. Every other step is a *jump* and costs
  the same skip penalty J, the greatest there is: ``min_v [A(v) + wcc wccf f(v, u)] + J``, with A
  the cheapest cost up to v. Counting specials among the jumps as well changes no minimum, since
  none costs more than J.
* Jumps are looked at in the order of A, and end where ``A(v) + J`` alone reaches the best found:
  f is not negative.
* f is a metric. If ``A(w) + wcc wccf f(w, v) <= A(v)``, a jump from w costs nobody more than one
  from v, so v is no source of jumps (it is dominated).

Costs add up in float64. Ties go to the natural continuation, then to the other specials, then
to the source with the lower A, then to the lower unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from database.errors import SelectionError
from unitsel.costs import Weights

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_DOMINATORS = 64
"""Sources that others are compared with for dominance. Any number is exact: where A hardly
differs, few are dominated, and more comparisons cost more than they save."""


@dataclass(frozen=True)
class SearchSpace:
    """All that a step between two units costs, before weights.

    Parameters
    ----------
    sequence, frame : (N,) int
        Sequence of each unit and its recorded frame number. A sequence's units stand one after
        another, in the order of their frames.
    features : (N, G) float32
        Scaled features (`database.cost_definition.visual_features`).
    groups : (n_groups + 1,) int64
        Where each group of features starts; f is the sum of the groups' Euclidean distances.
    skip : (p + 1,) float64
        g by difference of frame numbers (`database.cost_definition.skip_costs`).

    Raises
    ------
    SelectionError
        If the sizes do not fit, the units are out of order, or a feature is not finite.
    """

    sequence: npt.NDArray[np.int32]
    frame: npt.NDArray[np.int32]
    features: npt.NDArray[np.float32]
    groups: IntArray
    skip: FloatArray

    def __post_init__(self) -> None:
        sequence = np.ascontiguousarray(self.sequence, dtype=np.int32)
        frame = np.ascontiguousarray(self.frame, dtype=np.int32)
        features = np.ascontiguousarray(self.features, dtype=np.float32)
        n = len(sequence)
        if n == 0:
            raise SelectionError("database: holds no unit to select from")
        if frame.shape != (n,) or features.ndim != 2 or len(features) != n:
            raise SelectionError("database: sequences, frames and features differ in number")
        if not np.isfinite(features).all():
            bad = int(np.argmin(np.isfinite(features).all(axis=1)))
            raise SelectionError(
                f"database: features of unit {bad} are not finite; build the database again"
            )
        new = np.flatnonzero(np.diff(sequence) != 0) + 1
        runs = sequence[np.concatenate([[0], new])]
        falling = (np.diff(frame) <= 0) & (np.diff(sequence) == 0)
        if len(np.unique(runs)) != len(runs) or falling.any():
            raise SelectionError(
                "database: units are not in the order of their sequences and frames; "
                "build the database again"
            )
        for name, value in (("sequence", sequence), ("frame", frame), ("features", features)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "groups", np.ascontiguousarray(self.groups, dtype=np.int64))
        object.__setattr__(self, "skip", np.ascontiguousarray(self.skip, dtype=np.float64))

    def __len__(self) -> int:
        return len(self.sequence)

    def visual_costs(self, first: IntArray, second: IntArray) -> FloatArray:
        """Visual cost f of pairs of units, float64 of their shape (equation 7)."""
        total = np.zeros(np.shape(first))
        for start, end in zip(self.groups[:-1], self.groups[1:], strict=True):
            a = self.features[first, start:end].astype(np.float64)
            b = self.features[second, start:end].astype(np.float64)
            total += np.linalg.norm(a - b, axis=-1)
        return total

    def skip_costs(self, before: IntArray, after: IntArray) -> FloatArray:
        """Skip cost g of steps from `before` to `after`, float64 of their shape (equation 8)."""
        p = len(self.skip) - 1
        step = self.frame[after].astype(np.int64) - self.frame[before]
        near = (self.sequence[after] == self.sequence[before]) & (step >= 0) & (step < p)
        return self.skip[np.where(near, step, p)]


@dataclass(frozen=True)
class SearchResult:
    """The cheapest path and what it costs.

    Parameters
    ----------
    path : (T,) int64
        Unit of each frame.
    cost : float
        Path cost with the weights.
    target : (T,) float64
        Target cost of each frame, without weight.
    visual, skip : (T - 1,) float64
        f and g of each step, without weight.
    """

    path: IntArray
    cost: float
    target: FloatArray
    visual: FloatArray
    skip: FloatArray


def search(
    space: SearchSpace,
    candidates: Sequence[npt.NDArray[np.integer]],
    target: Sequence[npt.NDArray[np.floating]],
    weights: Weights,
    progress: Callable[[int, int], None] | None = None,
) -> SearchResult:
    """Find the path of least cost, exactly.

    Parameters
    ----------
    space : SearchSpace
        The units.
    candidates : T arrays of int
        Units to choose from at each frame, ascending, each once.
    target : T arrays of float
        Target cost of each candidate, without weight.
    weights : Weights
    progress : callable, optional
        Called with the frames done and the number of frames.

    Returns
    -------
    SearchResult

    Raises
    ------
    SelectionError
        If there is no frame, a frame has no candidate, or candidates or costs cannot be used.
    """
    if len(candidates) == 0 or len(candidates) != len(target):
        raise SelectionError(
            f"search: {len(candidates)} frames of candidates and {len(target)} of target costs; "
            "both must be the same number, at least 1"
        )
    candidates = list(candidates)
    # The few distinct lists (one a viseme) are checked once each.
    checked: dict[int, npt.NDArray[np.int32]] = {}
    units = [
        checked[id(c)] if id(c) in checked else checked.setdefault(id(c), _check(c, i, len(space)))
        for i, c in enumerate(candidates)
    ]
    visual_weight = float(weights.concatenation * weights.visual)
    skip = space.skip * float(weights.concatenation * weights.skip)
    place = np.full(len(space), -1, dtype=np.int32)
    cost = weights.target * _check_target(target[0], units[0], 0)
    sources: list[npt.NDArray[np.int32]] = []
    for t in range(1, len(units)):
        here = _check_target(target[t], units[t], t)
        onward = np.empty(len(here), dtype=np.float64)
        source = np.empty(len(here), dtype=np.int32)
        _step(
            units[t - 1], cost, units[t], space.sequence, space.frame, space.features,
            space.groups, visual_weight, skip, place, onward, source,
        )  # fmt: skip
        cost = onward + weights.target * here
        sources.append(source)
        if progress is not None:
            progress(t, len(units))
    at = int(np.argmin(cost))
    places = np.empty(len(units), dtype=np.int64)
    places[-1] = at
    for t in range(len(units) - 2, -1, -1):
        at = int(sources[t][at])
        places[t] = at
    if progress is not None:
        progress(len(units), len(units))
    path = np.array([u[i] for u, i in zip(units, places, strict=True)], dtype=np.int64)
    terms = np.array([float(c[i]) for c, i in zip(target, places, strict=True)])
    return priced(space, path, terms, weights)


def priced(
    space: SearchSpace, path: IntArray, target: FloatArray, weights: Weights
) -> SearchResult:
    """Price a given path (equations 9 to 11).

    Parameters
    ----------
    space : SearchSpace
    path : (T,) int
        Unit of each frame.
    target : (T,) float
        Target cost of each of them, without weight.
    weights : Weights

    Returns
    -------
    SearchResult
    """
    path = np.asarray(path, dtype=np.int64)
    visual = space.visual_costs(path[:-1], path[1:])
    skip = space.skip_costs(path[:-1], path[1:])
    cost = weights.target * math.fsum(target) + weights.concatenation * (
        weights.visual * math.fsum(visual) + weights.skip * math.fsum(skip)
    )
    return SearchResult(path, cost, np.asarray(target, dtype=np.float64), visual, skip)


def _check(candidates: npt.NDArray[np.integer], frame: int, n: int) -> npt.NDArray[np.int32]:
    """One frame's candidates as int32; raises `SelectionError` where they cannot be used."""
    c = np.ascontiguousarray(candidates, dtype=np.int32)
    if c.ndim != 1 or c.size == 0:
        raise SelectionError(f"search: frame {frame} has no candidate")
    if c[0] < 0 or c[-1] >= n or (np.diff(c) <= 0).any():
        raise SelectionError(
            f"search: candidates of frame {frame} must ascend, each once, within 0..{n - 1}"
        )
    return c


def _check_target(
    target: npt.NDArray[np.floating], units: npt.NDArray[np.int32], frame: int
) -> FloatArray:
    """One frame's target costs as float64; raises `SelectionError` where they cannot be used."""
    cost = np.asarray(target, dtype=np.float64)
    if cost.shape != units.shape or not np.isfinite(cost).all():
        raise SelectionError(
            f"search: frame {frame} needs {units.size} finite target costs, got {cost.size}"
        )
    return cost


@njit(cache=True, nogil=True)
def _visual(
    features: npt.NDArray[np.float32], groups: IntArray, a: int, b: int, limit: float
) -> float:
    """Distance f of two units; infinite where it reaches `limit`."""
    total = 0.0
    for g in range(groups.size - 1):
        square = 0.0
        for k in range(groups[g], groups[g + 1]):
            d = np.float64(features[a, k]) - np.float64(features[b, k])
            square += d * d
        total += math.sqrt(square)
        if total >= limit:
            return np.inf
    return total


@njit(cache=True, nogil=True)
def _step(
    before: npt.NDArray[np.int32],
    cost: FloatArray,
    after: npt.NDArray[np.int32],
    sequence: npt.NDArray[np.int32],
    frame: npt.NDArray[np.int32],
    features: npt.NDArray[np.float32],
    groups: IntArray,
    visual_weight: float,
    skip: FloatArray,
    place: npt.NDArray[np.int32],
    onward: FloatArray,
    source: npt.NDArray[np.int32],
) -> None:
    """One frame forward.

    Parameters
    ----------
    before : (m,) int32
        Units of the frame before, and `cost` (m,) the cheapest cost up to each.
    after : (n,) int32
        Units of this frame.
    visual_weight : float
        wcc * wccf.
    skip : (p + 1,)
        g times wcc * wccg.
    place : (N,) int32
        Scratch, all -1 before and after.
    onward : (n,) float64
        Out: the cheapest cost up to each unit of this frame, its target cost left out.
    source : (n,) int32
        Out: place in `before` of the unit it comes from.
    """
    m = before.size
    p = skip.size - 1
    jump = skip[p]
    order = np.argsort(cost, kind="mergesort")
    for i in range(m):
        place[before[i]] = i
    # Sources of jumps that nobody dominates, found as far as they are needed, cheapest first.
    sources = np.empty(m, dtype=np.int32)
    kept = 0
    seen = 0
    for c in range(after.size):
        u = after[c]
        best = np.inf
        came = -1
        for n in range(p):
            v = u - (n if n > 1 else 1 - n)
            if v < 0 or sequence[v] != sequence[u] or place[v] < 0:
                continue
            difference = frame[u] - frame[v]
            if difference >= p:
                continue
            base = cost[place[v]] + skip[difference]
            if base >= best:
                continue
            if visual_weight > 0:
                base += visual_weight * _visual(features, groups, v, u, np.inf)
            if base < best:
                best = base
                came = place[v]
        r = 0
        while True:
            if r == kept:
                while seen < m and cost[order[seen]] + jump < best:
                    i = order[seen]
                    seen += 1
                    dominated = False
                    for s in range(min(kept, _DOMINATORS)):
                        room = cost[i] - cost[sources[s]]
                        if visual_weight > 0:
                            limit = room / visual_weight
                            f = _visual(
                                features, groups, before[sources[s]], before[i], limit + 1e-9
                            )
                            dominated = visual_weight * f <= room
                        else:
                            dominated = True
                        if dominated:
                            break
                    if not dominated:
                        sources[kept] = i
                        kept += 1
                        break
                if r == kept:
                    break
            i = sources[r]
            r += 1
            base = cost[i] + jump
            if base >= best:
                break
            if visual_weight > 0:
                limit = (best - base) / visual_weight
                base += visual_weight * _visual(features, groups, before[i], u, limit)
            if base < best:
                best = base
                came = i
        onward[c] = best
        source[c] = came
    for i in range(m):
        place[before[i]] = -1
