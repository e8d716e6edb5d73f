"""The search as it goes forward, and the way back along what it kept."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search.forward import advance
from unitsel.search.kernels import FRONT
from unitsel.search.lanes import LANES
from unitsel.search.space import CandidateList, Pairs, SearchSpace
from unitsel.search.trace import trace_back

FloatArray = npt.NDArray[np.float64]
SingleArray = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
UnitArray = npt.NDArray[np.int32]

_AT_ONCE: Final = 65_536
"""Candidates of several frames that are looked at in one go; bounds the scratch."""

_NO_PAIRS: Final = Pairs.none()

_NO_LIST: Final = CandidateList(
    -1, np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32),
    np.zeros(0, np.float32), 0.0, np.zeros((0, 0)), _NO_PAIRS,
)  # fmt: skip


@dataclass(frozen=True)
class _Stretch:
    """What is kept of some frames of one list of candidates.

    Parameters
    ----------
    candidates : CandidateList
    bounds : (m + 1,) int64
        Where each frame starts in the others.
    place, source : int32
        Units that may be on a cheapest path, by place in the list, and the place they were jumped
        to from in the list of the frame before, -1 if a special led there.
    cost : float64
        Up to each.
    """

    candidates: CandidateList
    bounds: IntArray
    place: UnitArray
    cost: FloatArray
    source: UnitArray

    def last_frame(self) -> tuple[UnitArray, FloatArray]:
        """Places of the units alive in the last frame, and costs up to them."""
        start = self.bounds[-2]
        return self.place[start:], self.cost[start:]


class ForwardPass:
    """Least costs up to the units of each frame, one frame after another.

    Parameters
    ----------
    space : SearchSpace
    weights : Weights
    """

    def __init__(self, space: SearchSpace, weights: Weights) -> None:
        self._space = space
        scale = space.scale
        visual = float(weights.concatenation * weights.visual) * scale
        skip = space.skip * float(weights.concatenation * weights.skip)
        target = float(weights.target)
        # Costs are counted in a unit that suits float32 where the weights are far from 1.
        largest = max(visual, float(skip[-1]))
        unit = 1.0
        if largest > 0 and not 1e-15 < largest < 1e15:
            unit = 2.0 ** math.floor(math.log2(largest))
        self._unit = unit
        self._visual = visual / unit
        self._skip = skip / unit
        self._target = target / unit
        self._ends = space.ends
        self._cost = np.empty(0)
        self._other = np.empty(0)
        self._place = np.empty(0, dtype=np.int32)
        self._least = 0.0
        self._first = 0
        self._before: CandidateList | None = None
        self._stretches: list[_Stretch] = []
        self._starts: list[int] = []
        self.frames = 0

    @property
    def least(self) -> float:
        """Least cost of a path up to the last frame."""
        return self._least * self._unit

    def extend(self, candidates: CandidateList, target: Sequence[npt.NDArray[np.floating]]) -> None:
        """Go on over frames that share a list of candidates.

        Parameters
        ----------
        candidates : CandidateList
        target : m arrays (n,) of float
            Target costs of each frame, without weight.

        Raises
        ------
        SelectionError
            If a frame has not one finite target cost a candidate.
        """
        n = len(candidates)
        for i, costs in enumerate(target):
            if np.shape(costs) != (n,):
                raise _bad_target(self.frames + i, n, np.size(costs))
        at_once = max(1, _AT_ONCE // n)
        for i in range(0, len(target), at_once):
            self._extend(candidates, target[i : i + at_once])

    def _extend(
        self, candidates: CandidateList, target: Sequence[npt.NDArray[np.floating]]
    ) -> None:
        m, n = len(target), len(candidates)
        if self._place.size < m * n:
            size = max(m * n, _AT_ONCE)
            self._targets = np.empty(size)
            self._place = np.empty(size, dtype=np.int32)
            self._kept_cost = np.empty(size)
            self._source = np.empty(size, dtype=np.int32)
        place, cost, source = self._place, self._kept_cost, self._source
        costs = self._targets[: m * n].reshape(m, n)
        for i, row in enumerate(target):
            costs[i] = row
        start = self._before is None
        before = candidates if self._before is None else self._before
        again = before is candidates and not start
        cross = _NO_PAIRS if start or again else self._space.pairs(before, candidates)
        self._make_room(n)
        own = candidates.pairs
        bounds = np.empty(m + 1, dtype=np.int64)
        done, least, first = advance(
            start, again, self._cost, self._other, self._least, self._first,
            before.rows, before.columns, len(before), before.centre, before.radius,
            candidates.rows, candidates.columns, candidates.centre, candidates.radius,
            candidates.near,
            cross.before, cross.after, cross.step, cross.visual,
            own.before, own.after, own.step, own.visual,
            costs, self._target, self._visual, self._skip, self._ends,
            self._doubles, self._singles, self._integers, self._gathered,
            place, cost, source, bounds,
        )  # fmt: skip
        if done < m:
            raise _bad_target(self.frames + done, n, n)
        if m % 2:
            self._cost, self._other = self._other, self._cost
        self._least, self._first = float(least), int(first)
        self._before = candidates
        end = int(bounds[m])
        self._starts.append(self.frames)
        self._stretches.append(
            _Stretch(candidates, bounds, place[:end].copy(), cost[:end].copy(), source[:end].copy())
        )
        self.frames += m

    def _make_room(self, n: int) -> None:
        """Scratch for lists of n units; what is there stays."""
        if self._cost.size >= FRONT + n + 2 * LANES:
            return
        size = -(-max(n, 1024) // LANES) * LANES + 2 * LANES
        cost = np.full(FRONT + size, np.inf)
        cost[: self._cost.size] = self._cost
        self._cost = cost
        self._other = np.full(FRONT + size, np.inf)
        width = self._space.width
        self._doubles = np.empty((4, size))
        self._singles = np.empty((7, size), dtype=np.float32)
        self._integers = np.full((7, size), -1, dtype=np.int32)
        self._gathered = np.empty(width * size, dtype=np.float32)

    def trace(self, last: int, place: int, first: int) -> list[int]:
        """Places of a cheapest path, from frame `last`, where it is at `place`, back to `first`."""
        path = np.empty(last - first + 1, dtype=np.int64)
        k = bisect.bisect_right(self._starts, last) - 1
        end = last
        while end >= first:
            stretch, start = self._stretches[k], self._starts[k]
            if k > 0:
                earlier = self._stretches[k - 1]
                before = earlier.candidates
                places, costs = earlier.last_frame()
            else:
                before, places, costs = _NO_LIST, _NO_PAIRS.before, _NO_PAIRS.visual
            # Frames of the stretch that are asked for, and what led to the first of them.
            into = max(start, first)
            out = np.empty(end - start + 1, dtype=np.int64)
            place = trace_back(
                place, end - start, into - start, stretch.bounds, stretch.place, stretch.cost,
                stretch.source, stretch.candidates.units, stretch.candidates.rows, places, costs,
                before.units, before.rows, self._space.sequence, self._space.frame, self._skip,
                self._visual, self._ends, out,
            )  # fmt: skip
            path[into - first : end - first + 1] = out[into - start :]
            end = start - 1
            k -= 1
        return [int(p) for p in path]

    def best(self, first: int) -> list[int]:
        """Places of a cheapest path from frame `first` to the last."""
        return self.trace(self.frames - 1, self._first, first)

    def unit(self, frame: int, place: int) -> int:
        """Unit at a place of a frame's list."""
        k = bisect.bisect_right(self._starts, frame) - 1
        return int(self._stretches[k].candidates.units[place])

    def forget(self, frame: int) -> None:
        """Drop what only paths before a frame need."""
        while len(self._starts) > 1 and self._starts[1] <= frame:
            del self._starts[0], self._stretches[0]


def _bad_target(frame: int, n: int, got: int) -> SelectionError:
    return SelectionError(f"search: frame {frame} needs {n} finite target costs, got {got}")
