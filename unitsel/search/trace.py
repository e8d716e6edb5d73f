"""The way back along what a search kept, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from unitsel.search.kernels import FloatArray, IntArray, SingleArray, UnitArray, distance


@njit(cache=True, nogil=True)
def find_step(
    unit: int,
    row: int,
    rows: SingleArray,
    before: UnitArray,
    rows_before: SingleArray,
    places: UnitArray,
    costs: FloatArray,
    sequence: UnitArray,
    frame: UnitArray,
    skip: FloatArray,
    visual: float,
    ends: IntArray,
) -> int:
    """Which of the units alive before a special came from: its index among them.

    Parameters
    ----------
    unit, row : int
        The unit that was reached, and where its row of `rows` starts.
    before, rows_before
        The list of the frame before.
    places : (k,) int32
        Places in it of the units that were alive, ascending, and `costs` (k,) up to them.
    """
    width = rows_before.size // before.size
    p = skip.size - 1
    best = np.inf
    found = -1
    for n in range(p):
        # The natural step first, so that it wins a tie.
        v = unit - (n if n > 1 else 1 - n)
        if v < 0 or sequence[v] != sequence[unit] or frame[unit] - frame[v] >= p:
            continue
        i = int(np.searchsorted(before, v))
        if i == before.size or before[i] != v:
            continue
        k = int(np.searchsorted(places, i))
        if k == places.size or places[k] != i:
            continue
        f = distance(rows_before, i * width, rows, row, ends)
        c = (costs[k] + skip[frame[unit] - frame[v]]) + visual * f
        if c < best:
            best = c
            found = k
    return found


@njit(cache=True, nogil=True)
def trace_back(
    here: int,
    last: int,
    first: int,
    bounds: IntArray,
    places: UnitArray,
    costs: FloatArray,
    sources: UnitArray,
    units: UnitArray,
    rows: SingleArray,
    places_before: UnitArray,
    costs_before: FloatArray,
    before: UnitArray,
    rows_before: SingleArray,
    sequence: UnitArray,
    frame: UnitArray,
    skip: FloatArray,
    visual: float,
    ends: IntArray,
    out: IntArray,
) -> int:
    """Places of a cheapest path in a stretch of frames with one list of candidates.

    Parameters
    ----------
    here, last
        Where the path is, and in which frame of the stretch.
    first : int
        Frame to go back to; its predecessor is what is returned.
    bounds, places, costs, sources
        What was alive in the stretch; see `unitsel.search.forward.advance`.
    places_before, costs_before, before, rows_before
        The same of the last frame before the stretch, and its list.
    out : (last + 1,) int64
        Out: the places.

    Returns
    -------
    int
        Place in frame ``first - 1``, or -1 if that is not asked for (no list before).
    """
    width = rows.size // units.size
    for t in range(last, first - 1, -1):
        out[t] = here
        if t == 0 and before.size == 0:
            return -1
        a, b = bounds[t], bounds[t + 1]
        source = sources[a + np.searchsorted(places[a:b], here)]
        if source >= 0:
            here = source
        elif t > 0:
            a, b = bounds[t - 1], bounds[t]
            k = find_step(
                units[here], here * width, rows, units, rows, places[a:b], costs[a:b],
                sequence, frame, skip, visual, ends,
            )  # fmt: skip
            here = places[a + k]
        else:
            k = find_step(
                units[here], here * width, rows, before, rows_before, places_before,
                costs_before, sequence, frame, skip, visual, ends,
            )  # fmt: skip
            here = places_before[k]
    return here
