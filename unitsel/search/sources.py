"""Sources of jumps: which are worth looking at, and how long they can wait, compiled.

What is rounded to float32 here only decides what is looked at, with a margin.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from unitsel.search.kernels import (
    FRONT,
    FloatArray,
    IntArray,
    SingleArray,
    UnitArray,
    apart,
    apart_first,
    apart_rest,
)
from unitsel.search.lanes import (
    LANES,
    absolute,
    add,
    at_most,
    choose,
    count,
    fma,
    least,
    less,
    load,
    load_less,
    lowest,
    mul,
    root,
    splat,
    store,
    sub,
)

MARGIN: Final = np.float32(4e-6)
"""Relative; some ten times what rounding to float32 changes in a distance."""

ABOVE: Final = np.float32(1) + MARGIN

BELOW: Final = np.float32(1) - MARGIN

INFINITE: Final = np.float32(np.inf)

CHAMPIONS: Final = 64
"""Cheap units of a frame that the others are compared with, at most."""


@njit(cache=True, nogil=True)
def gather(rows: SingleArray, width: int, units: UnitArray, n: int, tiles: SingleArray) -> None:
    """Rows of n units, as tiles."""
    for lo in range(0, n, LANES):
        here = min(LANES, n - lo)
        for i in range(width):
            to = (lo // LANES * width + i) * LANES
            for k in range(here):
                tiles[to + k] = rows[units[lo + k] * width + i]


@njit(cache=True, nogil=True)
def sort_by(
    values: FloatArray,
    low: float,
    high: float,
    units: UnitArray,
    n: int,
    out: UnitArray,
) -> None:
    """Sort units by value, low to high, into 64 classes."""
    scale = 63.999 / (high - low) if high > low else 0.0
    first = np.zeros(65, dtype=np.int64)
    for e in range(n):
        first[int((values[units[e]] - low) * scale) + 1] += 1
    for c in range(64):
        first[c + 1] += first[c]
    for e in range(n):
        c = int((values[units[e]] - low) * scale)
        out[first[c]] = units[e]
        first[c] += 1


@njit(cache=True, nogil=True)
def find_sources(
    cost: FloatArray,
    least_cost: float,
    first: int,
    rows: SingleArray,
    width: int,
    columns: SingleArray,
    n: int,
    most: float,
    needed: int,
    visual: float,
    ends: IntArray,
    gathered: SingleArray,
    rest: SingleArray,
    ids: UnitArray,
    own: SingleArray,
    places: UnitArray,
) -> int:
    """Sources of jumps that no other dominates, or a few more.

    Parameters
    ----------
    cost, least_cost, first
        Costs up to the units of a list, the least, and its place.
    most : float
        Sources that cost so much above the least are of no use.
    needed : int
        How many units look for one.
    gathered, rest, ids
        Scratch: features, costs and places of those that are still in question.
    own : (k + LANES,) float32
        Out: cost of each source above the least.
    places : (k,) int32
        Out: the sources.

    Returns
    -------
    int
        How many.
    """
    wide = splat(np.float32(visual * (1 + 4e-6)))
    limit = splat(np.float32(most))
    places[0] = first
    own[0] = np.float32(0)
    found = 1
    m = 0
    for j in range(0, n, LANES):
        x = load_less(cost, FRONT + j, 1.0, least_cost)
        if less(x, limit) == 0:
            continue
        bits = less(x, mul(wide, apart(columns, j * width, rows, first * width, ends)))
        while bits != 0:
            ids[m] = j + lowest(bits)
            m += 1
            bits &= bits - 1
    gather(rows, width, ids, m, gathered)
    lowest_rest = INFINITE
    for k in range(m):
        rest[k] = cost[FRONT + ids[k]] - least_cost
        lowest_rest = min(lowest_rest, rest[k])
    for k in range(m, m + LANES):
        rest[k] = INFINITE
    nowhere = splat(INFINITE)
    # The next least in each round; whom it dominates leaves.
    live = m
    before = m
    rounds = 0
    while live > 0 and lowest_rest < INFINITE:
        here = 0
        target = splat(lowest_rest)
        for j in range(0, m, LANES):
            bits = at_most(load(rest, j), target)
            if bits != 0:
                here = j + lowest(bits)
                break
        own[found] = rest[here]
        places[found] = ids[here]
        found += 1
        base = splat(rest[here])
        rest[here] = INFINITE
        place = ids[here] * width
        running = nowhere
        live = 0
        for j in range(0, m, LANES):
            x = load(rest, j)
            bits = less(x, nowhere)
            total, square = apart_first(gathered, j * width, rows, place, ends)
            if less(x, fma(wide, add(total, root(square)), base)) != bits:
                d = apart_rest(total, square, gathered, j * width, rows, place, ends)
                x = choose(x, fma(wide, d, base), x, nowhere)
                store(rest, j, x)
                bits = less(x, nowhere)
            running = choose(x, running, x, running)
            live += count(bits)
        lowest_rest = least(running)
        rounds += 1
        if rounds % 8 == 0:
            # Where few leave, a round costs more than it saves.
            if (before - live) * needed < 24 * live:
                break
            before = live
        if 2 * live < m and m > 2 * LANES:
            c = 0
            for k in range(m):
                if rest[k] < INFINITE:
                    rest[c] = rest[k]
                    ids[c] = ids[k]
                    c += 1
            m = c
            gather(rows, width, ids, m, gathered)
            for k in range(m, m + LANES):
                rest[k] = INFINITE
    for k in range(m):
        if rest[k] < INFINITE:
            own[found] = rest[k]
            places[found] = ids[k]
            found += 1
    for k in range(found, found + LANES):
        own[k] = INFINITE
    return found


@njit(cache=True, nogil=True)
def find_champions(
    total: FloatArray,
    champion: int,
    same: bool,
    places: UnitArray,
    n_sources: int,
    needed: int,
    pair_to: UnitArray,
    units: UnitArray,
    ordered: UnitArray,
) -> int:
    """Cheap units of a frame, the cheapest first, in `ordered`: places, and how many.

    They are looked for where specials lead from the sources.
    """
    ordered[0] = champion
    most = min(CHAMPIONS, n_sources // 2, needed // 16)
    if most < 2:
        return 1
    n = total.size
    k = 0
    high = -np.inf
    count_of = n_sources if same else pair_to.size
    for s in range(count_of):
        first = places[s] if same else pair_to[s]
        for u in range(first, min(first + 2, n) if same else first + 1):
            if total[u] < np.inf and k < units.size:
                units[k] = u
                high = max(high, total[u])
                k += 1
    sort_by(total, total[champion], high, units, k, ordered)
    return min(k, most)


@njit(cache=True, nogil=True)
def find_gains(
    cost: FloatArray,
    least_cost: float,
    places: UnitArray,
    own: SingleArray,
    n_sources: int,
    total: FloatArray,
    least_weighted: float,
    champions: UnitArray,
    n_champions: int,
    same: bool,
    near: FloatArray,
    rows_before: SingleArray,
    rows: SingleArray,
    width: int,
    visual: float,
    ends: IntArray,
    gathered: SingleArray,
    gain: SingleArray,
) -> None:
    """How dear, as a target, a unit may be for a jump to it from each source to be of use.

    From v one can also go to some w and jump a frame later. If that costs no more up to w, and the
    way back from w to v, than the target cost of u, nobody needs the jump from v to u: f is a
    metric, and whatever follows u would follow w at no more.

    Parameters
    ----------
    total : (n,) float64
        Costs up to the units of this frame that specials reach.
    champions : (n_champions,) int32
        Some of them.
    gathered
        Scratch.
    gain : (n_sources + LANES,) float32
        Out: ``min_w total[w] + f(v, w) - cost[v]`` over some w, above the least target cost, and
        a margin.
    """
    n = total.size
    for s in range(n_sources):
        i = places[s]
        g = np.inf
        if same:
            g = total[i]
            if near.shape[0] > 0 and i + 1 < n and near[0, i + 1] < np.inf:
                g = min(g, total[i + 1] + visual * near[0, i + 1])
        gain[s] = np.float32(g - cost[FRONT + i] - least_weighted)
        gain[s] += MARGIN * abs(gain[s])
    gather(rows_before, width, places, n_sources, gathered)
    weight = splat(np.float32(visual))
    margin = splat(MARGIN)
    for c in range(n_champions):
        u = champions[c]
        base = splat(np.float32(total[u] - least_cost - least_weighted))
        size = absolute(base)
        for j in range(0, n_sources, LANES):
            f = mul(weight, apart(gathered, j * width, rows, u * width, ends))
            a = load(own, j)
            g = fma(margin, add(add(size, f), a), sub(add(base, f), a))
            old = load(gain, j)
            store(gain, j, choose(g, old, g, old))
    for s in range(n_sources, n_sources + LANES):
        gain[s] = -INFINITE
