"""The cheapest jump to each unit of a frame that may need one, compiled."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from unitsel.search.kernels import (
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
    choose,
    count,
    fma,
    greatest,
    least,
    less,
    load,
    load_less,
    lowest,
    mul,
    root,
    select,
    splat,
    store,
    sub,
)
from unitsel.search.sources import ABOVE, BELOW, INFINITE, MARGIN, gather, sort_by

MANY: Final = 128
"""Sources from which on units are sorted by target cost before they look for one."""


@njit(cache=True, nogil=True, forceinline=True)
def try_sources(
    columns: SingleArray,
    at: int,
    sources: SingleArray,
    width: int,
    own: SingleArray,
    gain: SingleArray,
    n: int,
    low: np.float32,
    visual: np.float32,
    ends: IntArray,
    best: SingleArray,
    argument: SingleArray,
    to: int,
) -> None:
    """Cheapest source for sixteen units.

    Parameters
    ----------
    columns, at
        The units: their tile, from place `at`.
    sources, own, gain
        Features of n sources, what they cost, and their gains, descending (float32, above the
        zero of `low`).
    low : float32
        Least target cost of the units. Sources whose gain is not above it are left out.
    best : float32, from place `to` on
        In: what a jump must cost less than. Out: what the cheapest costs, infinite if none does.
    argument : float32, from place `to` on
        Out: its source.
    """
    b = load(best, to)
    g = splat(np.float32(-1))
    weight = splat(visual)
    floor = splat(low)
    some = 0
    for k in range(0, n, LANES):
        some += count(less(floor, load(gain, k)))
    for s in range(some):
        o = s * width
        base = splat(own[s])
        total, square = apart_first(columns, at, sources, o, ends)
        if less(fma(weight, add(total, root(square)), base), b) == 0:
            continue
        c = fma(weight, apart_rest(total, square, columns, at, sources, o, ends), base)
        g = choose(c, b, splat(np.float32(s)), g)
        b = choose(c, b, c, b)
    store(best, to, choose(g, splat(np.float32(0)), splat(INFINITE), b))
    store(argument, to, g)


@njit(cache=True, nogil=True)
def try_tiles(
    columns: SingleArray,
    tiles: UnitArray,
    lows: SingleArray,
    n_tiles: int,
    sources: SingleArray,
    width: int,
    own: SingleArray,
    gain: SingleArray,
    n: int,
    visual: np.float32,
    ends: IntArray,
    best: SingleArray,
    argument: SingleArray,
) -> None:
    """`try_sources` for the tiles whose first units are given, with their least target costs."""
    for e in range(n_tiles):
        j = tiles[e]
        try_sources(
            columns, j * width, sources, width, own, gain, n, lows[e], visual, ends, best,
            argument, j,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def mark_needed(
    weighted: FloatArray,
    least_weighted: float,
    special: FloatArray,
    n: int,
    champion: int,
    headroom: float,
    floor: float,
    rows: SingleArray,
    columns: SingleArray,
    width: int,
    visual: float,
    ends: IntArray,
    best: SingleArray,
    lows: SingleArray,
    tiles: UnitArray,
    masks: UnitArray,
) -> tuple[int, int, float]:
    """Find the units that may need a jump, and what it must cost less than.

    Parameters
    ----------
    weighted, least_weighted, special
        Target cost of each unit, the least of them, and the cheapest arrival by a special.
    champion, headroom
        The cheapest unit that specials reach (-1 if none), and what it costs above the least cost
        of the frame before.
    floor : float
        Least cost of the frame before, with the skip penalty.
    best : float32
        Out: what a jump to each must cost less than, above the floor; infinite in tiles where none
        is needed.
    lows, tiles, masks
        Out: the tiles where one is: least target cost above the least of all, first unit, and
        which units.

    Returns
    -------
    number of such tiles, of such units, and the most that a jump may cost above the floor
    """
    nothing = splat(np.float32(0))
    nowhere = splat(INFINITE)
    wide = splat(np.float32(visual * (1 + 4e-6)))
    above = splat(ABOVE)
    margin = splat(MARGIN)
    n_tiles = 0
    needed = 0
    most = nothing
    for j in range(0, n, LANES):
        x = load_less(weighted, j, 1.0, least_weighted)
        bound = load_less(special, j, 1.0, floor)
        if champion >= 0:
            # A jump that the champion can make a frame later at no more is of no use.
            d = apart(columns, j * width, rows, champion * width, ends)
            y = load_less(weighted, j, 1.0, headroom)
            y = fma(margin, absolute(y), fma(wide, d, sub(nothing, y)))
            bound = choose(y, bound, y, bound)
        bits = less(nothing, bound) & less(x, nowhere)
        chosen = select(bits)
        lows[n_tiles] = least(choose(chosen, nothing, x, nowhere))
        tiles[n_tiles] = j
        masks[n_tiles] = bits
        if bits == 0:
            store(best, j, nowhere)
        else:
            bound = choose(chosen, nothing, mul(bound, above), nothing)
            store(best, j, bound)
            most = choose(most, bound, bound, most)
            needed += count(bits)
            n_tiles += 1
    return n_tiles, needed, np.float64(greatest(most))


@njit(cache=True, nogil=True)
def try_jumps(
    weighted: FloatArray,
    least_weighted: float,
    n: int,
    n_tiles: int,
    rows: SingleArray,
    columns: SingleArray,
    sources: SingleArray,
    width: int,
    own: SingleArray,
    gain: SingleArray,
    n_sources: int,
    visual: float,
    ends: IntArray,
    units: UnitArray,
    ordered: UnitArray,
    gathered: SingleArray,
    bounds: SingleArray,
    found: SingleArray,
    lows: SingleArray,
    tiles: UnitArray,
    masks: UnitArray,
    best: SingleArray,
    argument: SingleArray,
) -> bool:
    """The cheapest jump to each unit that may need one.

    Parameters
    ----------
    sources, own, gain, n_sources
        See `try_sources`.
    units .. found
        Scratch.
    lows, tiles, masks, n_tiles
        The tiles where a unit needs one, as `mark_needed` found them; changed here.
    best, argument : float32
        In: what a jump must cost less than. Out: cost above the floor of the cheapest jump to each
        unit, infinite where there is none, and its source.

    Returns
    -------
    bool
        Whether there may be any.
    """
    weight = np.float32(visual)
    if n_sources <= MANY:
        try_tiles(
            columns, tiles, lows, n_tiles, sources, width, own, gain, n_sources, weight, ends,
            best, argument,
        )  # fmt: skip
        return n_tiles > 0
    # Units of one tile alike in target cost, so that few sources are tried for each.
    theta = np.float64(gain[0]) + least_weighted
    low = np.inf
    high = -np.inf
    nu = 0
    for e in range(n_tiles):
        j = tiles[e]
        bits = masks[e]
        while bits != 0:
            u = j + lowest(bits)
            bits &= bits - 1
            if weighted[u] < theta:
                units[nu] = u
                low = min(low, weighted[u])
                high = max(high, weighted[u])
                nu += 1
    sort_by(weighted, low, high, units, nu, ordered)
    gather(rows, width, ordered, nu, gathered)
    n_tiles = 0
    for lo in range(0, nu, LANES):
        end = min(lo + LANES, nu)
        low = np.inf
        for k in range(lo, end):
            u = ordered[k]
            low = min(low, weighted[u])
            bounds[k] = best[u]
        for k in range(end, lo + LANES):
            bounds[k] = np.float32(0)
        lows[n_tiles] = np.float32(low - least_weighted) * BELOW
        tiles[n_tiles] = lo
        n_tiles += 1
    try_tiles(
        gathered, tiles, lows, n_tiles, sources, width, own, gain, n_sources, weight, ends,
        bounds, found,
    )  # fmt: skip
    for j in range(0, n, LANES):
        store(best, j, splat(INFINITE))
    for k in range(nu):
        best[ordered[k]] = bounds[k]
        argument[ordered[k]] = found[k]
    return nu > 0
