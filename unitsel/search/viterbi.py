"""The cheapest path through the candidates: an exact Viterbi search.

The path cost of Liu and Ostermann 2009, equation 9, over candidates ``u_1 .. u_T``::

    wtc * sum_t TC(t, u_t) + wcc * sum_t [ wccf * f(u_t-1, u_t) + wccg * g(u_t-1, u_t) ]

Looking at every pair of units is what takes time, so hardly any pair is looked at. What is left out
cannot be on a cheapest path. A is the least cost up to a unit, J the greatest skip penalty, and f
is weighted here:

* A step splits in two. A *special* leads to the same unit or a few frames on in the same
  sequence; there are at most p to a unit, and their f are worked out once a database. Every other
  step is a *jump* and costs ``min_v [A(v) + f(v, u)] + J``. Counting specials among the jumps as
  well changes no minimum, since none costs more than J.
* A unit needs a jump only if the cheapest source and J alone cost less than its specials, and less
  than jumping to whatever follows from the cheapest unit of its own frame
  (jumps.mark_needed).
* f is a metric. If ``A(w) + f(w, v) <= A(v)``, a jump from w costs nobody more than one from v: v
  is no source of jumps (sources.find_sources).
* A jump can wait. If some w of this frame has ``A(w) + f(v, w) <= A(v) + TC(u)``, jumping from v to
  u now is no better than going to w and jumping a frame later (sources.find_gains).
* A unit is dead if ``A(w) + J + f(w, u) <= A(u)`` for some w of the same frame: one may as well
  jump from w to whatever follows. Only units alive are kept (alive.keep_alive).
* Only A is kept, and where jumps came from; the other steps are found again along the path.

What is looked at is decided in float32, with a margin, sixteen units at a time; costs add up in
float64. Ties go to specials, and among them to the natural continuation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search.check import least_cost
from unitsel.search.forward_pass import ForwardPass
from unitsel.search.result import SearchResult, priced
from unitsel.search.space import CandidateList, SearchSpace
from unitsel.search.stream import StreamingSearch

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def search(
    space: SearchSpace,
    candidates: Sequence[npt.NDArray[np.integer]],
    target: Sequence[npt.NDArray[np.floating]],
    weights: Weights,
    progress: Callable[[int, int], None] | None = None,
    *,
    lookahead: int | None = None,
    verify: bool = False,
) -> SearchResult:
    """Find the path of least cost, exactly.

    Parameters
    ----------
    space : SearchSpace
        The units.
    candidates : T arrays of int
        Units to choose from at each frame, ascending, each once. Frames that share a list should
        share the array.
    target : T arrays of float
        Target cost of each candidate, without weight.
    weights : Weights
    progress : callable, optional
        Called with the frames done and the number of frames.
    lookahead : int, optional
        Decide each frame when so many more have been seen (`StreamingSearch`); the path may then
        cost more than the least, and `SearchResult.excess` says how much.
    verify : bool
        Find the least cost once more by looking at every pair, which takes long.

    Returns
    -------
    SearchResult

    Raises
    ------
    SelectionError
        If there is no frame, a frame has no candidate, candidates or costs cannot be used, or the
        check finds another cost.
    """
    if len(candidates) == 0 or len(candidates) != len(target):
        raise SelectionError(
            f"search: {len(candidates)} frames of candidates and {len(target)} of target costs; "
            "both must be the same number, at least 1"
        )
    if lookahead is not None:
        stream = StreamingSearch(space, weights, lookahead)
        for t, (units, costs) in enumerate(zip(candidates, target, strict=True)):
            stream.push(units, costs)
            if progress is not None and t > 0:
                progress(t, len(candidates))
        result = stream.finish()
        if progress is not None:
            progress(len(candidates), len(candidates))
    else:
        result = _search(space, candidates, target, weights, progress)
    if not verify:
        return result
    checked = least_cost(space, candidates, target, weights)
    optimum = result.cost if result.optimum is None else result.optimum
    if not math.isclose(optimum, checked, rel_tol=1e-6, abs_tol=1e-12):
        raise SelectionError(
            f"search: the least cost is {checked:.9g} by looking at every pair, not {optimum:.9g}; "
            "please report this"
        )
    return replace(result, checked=checked)


def _search(
    space: SearchSpace,
    candidates: Sequence[npt.NDArray[np.integer]],
    target: Sequence[npt.NDArray[np.floating]],
    weights: Weights,
    progress: Callable[[int, int], None] | None,
) -> SearchResult:
    forward = ForwardPass(space, weights)
    ready: dict[int, CandidateList] = {}
    lists: list[CandidateList] = []
    for i, units in enumerate(candidates):
        found = ready.get(id(units))
        if found is None:
            found = ready[id(units)] = space.candidate_list(units, i)
        lists.append(found)
    n_frames = len(lists)
    start = 0
    while start < n_frames:
        end = start + 1
        while end < n_frames and lists[end] is lists[start]:
            end += 1
        forward.extend(lists[start], target[start:end])
        if progress is not None:
            for t in range(max(1, start), min(end, n_frames)):
                progress(t, n_frames)
        start = end
    places = forward.best(0)
    path = np.array([c.units[i] for c, i in zip(lists, places, strict=True)], dtype=np.int64)
    terms = np.array([float(c[i]) for c, i in zip(target, places, strict=True)])
    if progress is not None:
        progress(n_frames, n_frames)
    return replace(priced(space, path, terms, weights), optimum=forward.least)
