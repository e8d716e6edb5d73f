"""Frames of the search, one after another, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from unitsel.search.alive import keep_alive
from unitsel.search.jumps import mark_needed, try_jumps
from unitsel.search.kernels import (
    FRONT,
    FloatArray,
    IntArray,
    SingleArray,
    UnitArray,
    distance,
    least_of,
    stay_near,
)
from unitsel.search.lanes import (
    LANES,
    add,
    at_most,
    choose,
    least,
    load,
    load_less,
    lowest,
    splat,
)
from unitsel.search.sources import INFINITE, find_champions, find_gains, find_sources


@njit(cache=True, nogil=True)
def advance(
    start: bool,
    again: bool,
    cost: FloatArray,
    other: FloatArray,
    least_cost: float,
    first: int,
    rows_before: SingleArray,
    columns_before: SingleArray,
    n_before: int,
    centre_before: SingleArray,
    radius_before: float,
    rows: SingleArray,
    columns: SingleArray,
    centre: SingleArray,
    radius: float,
    near: FloatArray,
    cross_from: UnitArray,
    cross_to: UnitArray,
    cross_step: UnitArray,
    cross_visual: FloatArray,
    pair_from: UnitArray,
    pair_to: UnitArray,
    pair_step: UnitArray,
    pair_visual: FloatArray,
    targets: FloatArray,
    target_weight: float,
    visual: float,
    skip: FloatArray,
    ends: IntArray,
    doubles: FloatArray,
    singles: SingleArray,
    integers: UnitArray,
    gathered: SingleArray,
    alive: UnitArray,
    alive_cost: FloatArray,
    alive_source: UnitArray,
    bounds: IntArray,
) -> tuple[int, float, int]:
    """Frames of one list of candidates.

    Parameters
    ----------
    start : bool
        Whether the first of them is the first of all.
    again : bool
        Whether the frame before has the same list.
    cost, other : float64
        Costs up to the units of the frame before, ``FRONT`` places on, and room for the next; at
        the end the last costs are in `cost` if the number of frames is even.
    least_cost, first
        The least of them and its place.
    rows_before .. radius_before
        The list of the frame before.
    rows .. near, pair_from .. pair_visual
        This list, and the steps inside it that are not in `near`.
    cross_from .. cross_visual
        Steps from the list before that cost less than a jump.
    targets : (m, n) float64
        Target costs.
    doubles, singles, integers, gathered
        Scratch. Row 4 of `integers` is -1 before and after.
    alive, alive_cost, alive_source, bounds
        Out: units that may be on a cheapest path, in order, what they cost, and the place of the
        unit they were jumped to from, -1 if a special led there; frame t's are those from
        ``bounds[t]`` to ``bounds[t + 1]``.

    Returns
    -------
    frames done (short of m where a target cost is not finite), least cost, its place
    """
    m, n = targets.shape
    width = centre.size
    stride = columns.size // width
    jump = skip[skip.size - 1]
    special, total, weighted = doubles[0], doubles[1], doubles[2]
    own, rest, best, argument = singles[0], singles[1], singles[2], singles[3]
    gain, limits, lows = singles[4], singles[5], singles[6]
    tiles, masks = integers[5], integers[6]
    places, ids, units, ordered, source_of = (
        integers[0], integers[1], integers[2], integers[3], integers[4],
    )  # fmt: skip
    bounds[0] = 0
    for t in range(m):
        finite = 0
        for u in range(n):
            weighted[u] = target_weight * targets[t, u]
            finite += abs(weighted[u]) < np.inf
        if finite != n:
            return t, least_cost, first
        for u in range(n, stride):
            weighted[u] = np.inf
            special[u] = np.inf
            total[u] = np.inf
        # Specials.
        same = again or t > 0
        if start and not same:
            for u in range(n):
                special[u] = 0.0
        elif same:
            stay_near(cost, near, skip, visual, n, special)
        else:
            for u in range(n):
                special[u] = np.inf
        before, after, step, apart_by = cross_from, cross_to, cross_step, cross_visual
        if same:
            before, after, step, apart_by = pair_from, pair_to, pair_step, pair_visual
        for e in range(before.size):
            a = cost[FRONT + before[e]]
            if a < np.inf:
                c = (a + skip[step[e]]) + visual * apart_by[e]
                if c < special[after[e]]:
                    special[after[e]] = c
        for u in range(n):
            total[u] = special[u] + weighted[u]
        champion_cost, champion = least_of(total, n)
        if champion_cost == np.inf:
            champion = -1
        # Jumps.
        floor = least_cost + jump
        jumps = False
        needed = 0
        n_tiles = 0
        most = 0.0
        least_weighted = 0.0
        if same or not start:
            least_weighted, _ = least_of(weighted, n)
            n_tiles, needed, most = mark_needed(
                weighted, least_weighted, special, n, champion, champion_cost - least_cost, floor,
                rows, columns, width, visual, ends, best, lows, tiles, masks,
            )  # fmt: skip
        if needed > 0:
            ns = 1
            places[0] = first
            own[0] = np.float32(0)
            own[1 : 1 + LANES] = INFINITE
            if visual > 0:
                reach = radius_before + distance(rows_before, first * width, centre_before, 0, ends)
                ns = find_sources(
                    cost, least_cost, first, rows_before, width, columns_before, n_before,
                    min(most, visual * reach * (1 + 1e-5)), needed, visual, ends, gathered, rest,
                    ids, own, places,
                )  # fmt: skip
            champions = 0
            if champion >= 0:
                champions = find_champions(
                    total[:n], champion, same, places, ns, needed, after, units, ordered
                )
            find_gains(
                cost, least_cost, places, own, ns, total[:n], least_weighted, ordered, champions,
                same, near, rows_before, rows, width, visual, ends, gathered, limits,
            )  # fmt: skip
            # The most useful first.
            order = np.argsort(-limits[:ns])
            sources = np.empty(ns * width, dtype=np.float32)
            for s in range(ns):
                ids[s] = places[order[s]]
                rest[s] = own[order[s]]
                gain[s] = limits[order[s]]
            for s in range(ns):
                places[s] = ids[s]
                own[s] = rest[s]
                o = places[s] * width
                for i in range(width):
                    sources[s * width + i] = rows_before[o + i]
            for s in range(ns, ns + LANES):
                gain[s] = -INFINITE
            jumps = try_jumps(
                weighted, least_weighted, n, n_tiles, rows, columns, sources, width, own, gain,
                ns, visual, ends, units, ordered, gathered, rest, limits, lows, tiles, masks,
                best, argument,
            )  # fmt: skip
            if jumps:
                # The cheapest sum may be the new champion: what it costs is a path's cost.
                running = splat(INFINITE)
                for j in range(0, n, LANES):
                    x = add(load(best, j), load_less(weighted, j, 1.0, least_weighted))
                    running = choose(x, running, x, running)
                lowest_sum = least(running)
                if lowest_sum < INFINITE:
                    target = splat(lowest_sum)
                    for j in range(0, n, LANES):
                        x = add(load(best, j), load_less(weighted, j, 1.0, least_weighted))
                        bits = at_most(x, target)
                        if bits != 0:
                            u = j + lowest(bits)
                            i = places[int(argument[u])]
                            f = distance(rows_before, i * width, rows, u * width, ends)
                            c = (cost[FRONT + i] + jump) + visual * f
                            if c < special[u] and c + weighted[u] < champion_cost:
                                special[u] = c
                                total[u] = c + weighted[u]
                                source_of[u] = i
                                champion_cost = total[u]
                                champion = u
                            break
        if champion < 0:
            # Costs too far apart for float32: the cheapest source and target will do.
            _, champion = least_of(weighted, n)
            f = distance(rows_before, first * width, rows, champion * width, ends)
            special[champion] = (least_cost + jump) + visual * f
            champion_cost = special[champion] + weighted[champion]
            total[champion] = champion_cost
            source_of[champion] = first
        reach = radius + distance(rows, champion * width, centre, 0, ends)
        k = bounds[t]
        found, least_cost, first = keep_alive(
            champion, champion_cost, jump, floor, jumps, best, argument, weighted, special, total,
            cost, places, rows_before, rows, columns, reach, width, visual, ends, source_of,
            masks, tiles, other, alive[k:], alive_cost[k:], alive_source[k:],
        )  # fmt: skip
        bounds[t + 1] = k + found
        cost, other = other, cost
        rows_before, columns_before, n_before = rows, columns, n
        centre_before, radius_before = centre, radius
    return m, least_cost, first
