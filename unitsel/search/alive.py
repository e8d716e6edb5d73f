"""Units of a frame that may be on a cheapest path, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from unitsel.search.kernels import (
    FRONT,
    FloatArray,
    IntArray,
    SingleArray,
    UnitArray,
    apart,
    distance,
)
from unitsel.search.lanes import (
    LANES,
    absolute,
    add,
    fma,
    less,
    load,
    load_less,
    lowest,
    mul,
    splat,
)
from unitsel.search.sources import ABOVE, INFINITE, MARGIN


@njit(cache=True, nogil=True)
def mark_alive(
    champion: int,
    limit_cost: float,
    floor: float,
    jumps: bool,
    best: SingleArray,
    weighted: FloatArray,
    special: FloatArray,
    total: FloatArray,
    rows: SingleArray,
    columns: SingleArray,
    reach: float,
    width: int,
    stride: int,
    visual: float,
    ends: IntArray,
    masks: UnitArray,
    jumped: UnitArray,
) -> None:
    """Mark the units to keep, a mask a tile, and which of them a jump leads to."""
    nowhere = splat(INFINITE)
    limit = splat(np.float32(visual * reach) * ABOVE)
    wide = splat(np.float32(visual * (1 + 4e-6)))
    less_margin = splat(-MARGIN)
    narrow = splat(np.float32(1) - MARGIN)
    for j in range(0, stride, LANES):
        x = load_less(total, j, 1.0, limit_cost)
        z = nowhere
        cheaper = 0
        if jumps:
            b = load(best, j)
            y = load_less(weighted, j, 1.0, limit_cost - floor)
            z = fma(less_margin, add(b, absolute(y)), add(b, y))
            cheaper = less(mul(b, narrow), load_less(special, j, 1.0, floor))
        bits = less(x, limit)
        led = less(z, limit) & cheaper
        if bits | led != 0:
            within = mul(wide, apart(columns, j * width, rows, champion * width, ends))
            bits &= less(x, within)
            led &= less(z, within)
        if j <= champion < j + LANES:
            bits |= 1 << (champion - j)
        masks[j // LANES] = bits | led
        jumped[j // LANES] = led


@njit(cache=True, nogil=True)
def keep_alive(
    champion: int,
    champion_cost: float,
    jump: float,
    floor: float,
    jumps: bool,
    best: SingleArray,
    argument: SingleArray,
    weighted: FloatArray,
    special: FloatArray,
    total: FloatArray,
    cost: FloatArray,
    places: UnitArray,
    rows_before: SingleArray,
    rows: SingleArray,
    columns: SingleArray,
    reach: float,
    width: int,
    visual: float,
    ends: IntArray,
    source_of: UnitArray,
    masks: UnitArray,
    jumped: UnitArray,
    out: FloatArray,
    alive: UnitArray,
    alive_cost: FloatArray,
    alive_source: UnitArray,
) -> tuple[int, float, int]:
    """Cost up to each unit that may be on a cheapest path: exact, of jumps too.

    A unit is left out if one may as well jump on from the champion.

    Returns
    -------
    how many are alive, least cost, its place
    """
    stride = columns.size // width
    limit_cost = champion_cost + jump
    for j in range(FRONT + stride):
        out[j] = np.inf
    mark_alive(
        champion, limit_cost, floor, jumps, best, weighted, special, total, rows, columns, reach,
        width, stride, visual, ends, masks, jumped,
    )  # fmt: skip
    k = 0
    least_cost = np.inf
    first = 0
    for e in range(stride // LANES):
        bits = jumped[e]
        while bits != 0:
            u = e * LANES + lowest(bits)
            bits &= bits - 1
            i = places[int(argument[u])]
            f = distance(rows_before, i * width, rows, u * width, ends)
            c = (cost[FRONT + i] + jump) + visual * f
            if c < special[u]:
                total[u] = c + weighted[u]
                source_of[u] = i
        bits = masks[e]
        while bits != 0:
            u = e * LANES + lowest(bits)
            bits &= bits - 1
            c = total[u]
            out[FRONT + u] = c
            alive[k] = u
            alive_cost[k] = c
            alive_source[k] = source_of[u]
            source_of[u] = -1
            k += 1
            if c < least_cost:
                least_cost = c
                first = u
    return k, least_cost, first
