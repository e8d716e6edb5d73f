"""Distances of units and the steps inside a sequence, compiled.

Candidate lists are laid out as `unitsel.search.space.CandidateList` says. Costs up to the units of
a list have `FRONT` more places in front, so that looking back a few places needs no check.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numba import njit

from unitsel.search.lanes import LANES, absolute, add, fma, load, mul, root, splat, square4, sub

FloatArray = npt.NDArray[np.float64]
SingleArray = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
UnitArray = npt.NDArray[np.int32]

REACH: Final = 8
"""Frames that a list's table of near steps looks back; what is farther goes with the pairs."""

FRONT: Final = 16
"""Places in front of the costs of a list: at least `REACH`."""

_STRIP: Final = 1024
"""Units whose costs stay in the first cache while all their near steps are looked at."""


@njit(cache=True, nogil=True, forceinline=True)
def distance(a: SingleArray, i: int, b: SingleArray, j: int, ends: IntArray) -> float:
    """Visual cost f of the row from place i of `a` and that from place j of `b`, in float64."""
    total = abs(np.float64(a[i]) - np.float64(b[j]))
    total += abs(np.float64(a[i + 1]) - np.float64(b[j + 1]))
    total += math.sqrt(square4(a, i + 2, b, j + 2))
    start = 6
    for g in range(ends.size):
        square = 0.0
        for r in range(start, ends[g], 4):
            square += square4(a, i + r, b, j + r)
        total += math.sqrt(square)
        start = ends[g]
    return total


@njit(cache=True, nogil=True, forceinline=True)
def apart_in_short(tiles: SingleArray, at: int, rows: SingleArray, o: int) -> Any:
    """What the short groups of features add to `apart`."""
    total = absolute(sub(load(tiles, at), splat(rows[o])))
    total = add(total, absolute(sub(load(tiles, at + LANES), splat(rows[o + 1]))))
    d = sub(load(tiles, at + 2 * LANES), splat(rows[o + 2]))
    square = mul(d, d)
    d = sub(load(tiles, at + 3 * LANES), splat(rows[o + 3]))
    square = fma(d, d, square)
    d = sub(load(tiles, at + 4 * LANES), splat(rows[o + 4]))
    square = fma(d, d, square)
    d = sub(load(tiles, at + 5 * LANES), splat(rows[o + 5]))
    square = fma(d, d, square)
    return add(total, root(square))


@njit(cache=True, nogil=True, forceinline=True)
def square_of(
    square: Any, tiles: SingleArray, at: int, rows: SingleArray, o: int, start: int, end: int
) -> Any:
    """Add the squared differences of features `start` to `end`, a multiple of four."""
    for r in range(start, end, 4):
        t = at + r * LANES
        k = o + r
        d = sub(load(tiles, t), splat(rows[k]))
        square = fma(d, d, square)
        d = sub(load(tiles, t + LANES), splat(rows[k + 1]))
        square = fma(d, d, square)
        d = sub(load(tiles, t + 2 * LANES), splat(rows[k + 2]))
        square = fma(d, d, square)
        d = sub(load(tiles, t + 3 * LANES), splat(rows[k + 3]))
        square = fma(d, d, square)
    return square


@njit(cache=True, nogil=True, forceinline=True)
def apart_first(tiles: SingleArray, at: int, rows: SingleArray, o: int, ends: IntArray) -> Any:
    """`apart` in two parts: what `apart_rest` needs, a sum and a sum of squares.

    The sum and the root of the other are together at most what is asked, and most of it: the first
    features of a group weigh most. Rounding changes nothing in that.
    """
    square = splat(np.float32(0))
    if ends.size > 0:
        square = square_of(square, tiles, at, rows, o, 6, 10)
    return apart_in_short(tiles, at, rows, o), square


@njit(cache=True, nogil=True, forceinline=True)
def apart_rest(
    total: Any, square: Any, tiles: SingleArray, at: int, rows: SingleArray, o: int, ends: IntArray
) -> Any:
    """`apart`, from what `apart_first` found."""
    start = 10
    for g in range(ends.size):
        square = square_of(square, tiles, at, rows, o, start, ends[g])
        total = add(total, root(square))
        square = splat(np.float32(0))
        start = ends[g]
    return total


@njit(cache=True, nogil=True, forceinline=True)
def apart(tiles: SingleArray, at: int, rows: SingleArray, o: int, ends: IntArray) -> Any:
    """Visual costs of the sixteen units of a tile, from place `at`, to a row: `Lanes`."""
    total, square = apart_first(tiles, at, rows, o, ends)
    return apart_rest(total, square, tiles, at, rows, o, ends)


@njit(cache=True, nogil=True)
def distances(rows: SingleArray, centre: SingleArray, ends: IntArray) -> FloatArray:
    """Visual cost of each row to one row, float64."""
    width = centre.size
    out = np.empty(rows.size // width, dtype=np.float64)
    for k in range(out.size):
        out[k] = distance(rows, k * width, centre, 0, ends)
    return out


@njit(cache=True, nogil=True)
def find_pairs(
    before: UnitArray,
    rows_before: SingleArray,
    after: UnitArray,
    rows: SingleArray,
    sequence: UnitArray,
    frame: UnitArray,
    p: int,
    ends: IntArray,
) -> tuple[UnitArray, UnitArray, UnitArray, FloatArray]:
    """Steps between two lists that cost less than a jump.

    Returns
    -------
    places in `before`, places in `after`, differences of frames, visual costs
        Ascending by place in `after`.
    """
    width = rows.size // after.size
    count = 0
    places = np.empty(0, dtype=np.int32)
    to = np.empty(0, dtype=np.int32)
    step = np.empty(0, dtype=np.int32)
    visual = np.empty(0, dtype=np.float64)
    for fill in (False, True):
        if fill:
            places = np.empty(count, dtype=np.int32)
            to = np.empty(count, dtype=np.int32)
            step = np.empty(count, dtype=np.int32)
            visual = np.empty(count, dtype=np.float64)
        count = 0
        start = 0
        for j in range(after.size):
            u = after[j]
            # A sequence's units differ in frame at least as much as in place.
            while start < before.size and before[start] <= u - p:
                start += 1
            i = start
            while i < before.size and before[i] <= u:
                v = before[i]
                if sequence[v] == sequence[u] and frame[u] - frame[v] < p:
                    if fill:
                        places[count] = i
                        to[count] = j
                        step[count] = frame[u] - frame[v]
                        visual[count] = distance(rows_before, i * width, rows, j * width, ends)
                    count += 1
                i += 1
    return places, to, step, visual


@njit(cache=True, nogil=True)
def stay_near(
    cost: FloatArray, near: FloatArray, skip: FloatArray, visual: float, n: int, out: FloatArray
) -> None:
    """Cheapest arrival of each unit from itself or from a few places before it in the same list.

    Parameters
    ----------
    cost : (FRONT + n or more,) float64
        Up to the units of the frame before; infinite in front.
    near : (r, n or more) float64
        See `CandidateList`.
    out : (n or more,) float64
    """
    stay = skip[0]
    for lo in range(0, n, _STRIP):
        hi = min(lo + _STRIP, n)
        to = out[lo:hi]
        before = cost[FRONT + lo : FRONT + hi]
        for i in range(hi - lo):
            to[i] = before[i] + stay
        for d in range(1, near.shape[0] + 1):
            price = skip[d]
            f = near[d - 1, lo:hi]
            before = cost[FRONT + lo - d : FRONT + hi - d]
            for i in range(hi - lo):
                # No number (0 times infinite) is not less.
                c = (before[i] + price) + visual * f[i]
                to[i] = c if c < to[i] else to[i]


@njit(cache=True, nogil=True)
def least_of(values: FloatArray, n: int) -> tuple[float, int]:
    """The least of the first n values, and its first place."""
    found = np.full(32, np.inf)
    whole = n // 32 * 32
    for b in range(0, whole, 32):
        for i in range(32):
            found[i] = min(found[i], values[b + i])
    value = np.inf
    for i in range(32):
        value = min(value, found[i])
    for j in range(whole, n):
        value = min(value, values[j])
    for j in range(n):
        if values[j] == value:
            return value, j
    return value, 0
