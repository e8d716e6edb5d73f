"""A search that does not wait for the end of the sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search.forward_pass import ForwardPass
from unitsel.search.result import SearchResult, priced
from unitsel.search.space import CandidateList, SearchSpace

FloatArray = npt.NDArray[np.float64]


class StreamingSearch:
    """A search that decides each frame as soon as a few more have been seen.

    What is decided stays, and later frames go on from it. Memory does not grow with the sentence,
    but for one unit and one cost a frame.

    Parameters
    ----------
    space : SearchSpace
    weights : Weights
    lookahead : int
        Frames to see beyond the one that is decided, 0 or more.

    Raises
    ------
    SelectionError
        If the look-ahead is negative.
    """

    def __init__(self, space: SearchSpace, weights: Weights, lookahead: int) -> None:
        if lookahead < 0:
            raise SelectionError(f"search: look-ahead must be 0 or more frames, got {lookahead}")
        self._space = space
        self._weights = weights
        self._lookahead = lookahead
        self._free = ForwardPass(space, weights)
        # From the last decision on, once the cheapest path of all leads elsewhere.
        self._bound: ForwardPass | None = None
        self._offset = 0
        self._window: list[tuple[CandidateList, FloatArray]] = []
        self._units: list[int] = []
        self._terms: list[float] = []

    def push(
        self, candidates: npt.NDArray[np.integer], target: npt.NDArray[np.floating]
    ) -> list[int]:
        """Add a frame.

        Parameters
        ----------
        candidates : (n,) int
            Units to choose from, ascending, each once.
        target : (n,) float
            Target cost of each, without weight.

        Returns
        -------
        list of int
            Units of the frames that are decided now, in order: one, or none at first.
        """
        ready = self._space.candidate_list(candidates, self._free.frames)
        # A frame that cannot be used must leave no trace in the window.
        self._free.extend(ready, [target])
        self._window.append((ready, np.asarray(target, dtype=np.float64)))
        if self._bound is not None:
            self._bound.extend(ready, [target])
        if self._free.frames - len(self._units) <= self._lookahead:
            return []
        return [self._decide()]

    def _decide(self) -> int:
        frame = len(self._units)
        place = self._next_place(frame)
        candidates, target = self._window.pop(0)
        self._units.append(int(candidates.units[place]))
        self._terms.append(float(target[place]))
        self._free.forget(frame)
        if self._bound is not None:
            self._bound.forget(frame - self._offset)
        return self._units[-1]

    def _next_place(self, frame: int) -> int:
        """Place of the unit to take at a frame, the first that is not decided."""
        if frame == 0:
            return self._free.best(0)[0]
        taken = self._units[-1]
        for forward, offset in ((self._free, 0), (self._bound, self._offset)):
            if forward is not None:
                before, here = forward.best(frame - 1 - offset)[:2]
                if forward.unit(frame - 1 - offset, before) == taken:
                    if forward is self._free:
                        self._bound = None
                    return here
        # Both lead elsewhere: start again from the last decision.
        bound = ForwardPass(self._space, self._weights)
        bound.extend(self._space.single(taken), [np.zeros(1)])
        for candidates, target in self._window:
            bound.extend(candidates, [target])
        self._bound, self._offset = bound, frame - 1
        return bound.best(0)[1]

    def finish(self) -> SearchResult:
        """Decide the frames that are left; the sentence is over.

        Returns
        -------
        SearchResult
            The whole path, with the optimum that an unlimited look-ahead would have found.

        Raises
        ------
        SelectionError
            If there was no frame.
        """
        if self._free.frames == 0:
            raise SelectionError("search: there was no frame")
        while self._window:
            self._decide()
        found = priced(
            self._space, np.array(self._units, dtype=np.int64), np.array(self._terms), self._weights
        )
        return replace(found, optimum=self._free.least)
