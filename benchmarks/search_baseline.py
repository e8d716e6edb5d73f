"""The opponent of the search: every pair of candidates of every frame, as fast as numba does it.

All transitions are priced as jumps in single precision, two threads, the features of the units
beside one another so that the processor works on whole registers and keeps a running minimum for
each; the few steps inside a sequence that cost less are added afterwards. The loops over
features are written out for the groups of `synthetic_database`, so that the compiler sees them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from unitsel.costs import Weights
from unitsel.search import SearchSpace

FloatArray = npt.NDArray[np.float64]
SingleArray = npt.NDArray[np.float32]

GROUPS = (0, 1, 2, 5, 16)
"""Groups of features that the loops below are written for."""

BLOCK = 128
"""Units of a frame that one thread looks at together."""


class Baseline:
    """A search that leaves nothing out.

    Parameters
    ----------
    space : SearchSpace
        With features in the groups of `GROUPS`.
    """

    def __init__(self, space: SearchSpace) -> None:
        if tuple(space.groups) != GROUPS:
            raise ValueError(f"the baseline is written for the groups {GROUPS}")
        self._space = space
        self._ready: dict[int, tuple[SingleArray, SingleArray]] = {}

    def least_cost(
        self,
        candidates: Sequence[npt.NDArray[np.int32]],
        target: Sequence[FloatArray],
        weights: Weights,
    ) -> float:
        """Least path cost, and the work of a search for the path but the way back."""
        visual = weights.concatenation * weights.visual
        skip = self._space.skip * weights.concatenation * weights.skip
        place = np.full(len(self._space), -1, dtype=np.int32)
        cost = weights.target * target[0]
        for before, after, own in zip(candidates, candidates[1:], target[1:], strict=False):
            rows, _ = self._lists(before)
            _, columns = self._lists(after)
            # Costs above the least, so that single precision is enough.
            least = cost.min()
            onward = np.empty(len(after), dtype=np.float32)
            _every_pair(
                (cost - least).astype(np.float32), rows, columns, np.float32(visual),
                np.float32(skip[-1]), onward,
            )  # fmt: skip
            total = onward.astype(np.float64) + least
            _specials(
                before, cost, after, self._space.sequence, self._space.frame,
                self._space.features, visual, skip, place, total,
            )  # fmt: skip
            cost = total + weights.target * own
        return float(cost.min())

    def _lists(self, units: npt.NDArray[np.int32]) -> tuple[SingleArray, SingleArray]:
        """Features of a list by row and by column, worked out once."""
        if id(units) not in self._ready:
            rows = np.ascontiguousarray(self._space.features[units])
            self._ready[id(units)] = rows, np.ascontiguousarray(rows.T)
        return self._ready[id(units)]


@njit(parallel=True, fastmath=True, cache=True, nogil=True)
def _every_pair(
    cost: SingleArray,
    rows: SingleArray,
    columns: SingleArray,
    visual: float,
    jump: float,
    onward: SingleArray,
) -> None:
    """Least of ``cost[i] + visual * f(i, j) + jump`` over i, for each j."""
    n = onward.size
    for b in prange((n + BLOCK - 1) // BLOCK):
        lo, hi = b * BLOCK, min(b * BLOCK + BLOCK, n)
        w = hi - lo
        y0, y1, y2, y3 = columns[0, lo:hi], columns[1, lo:hi], columns[2, lo:hi], columns[3, lo:hi]
        y4, y5, y6, y7 = columns[4, lo:hi], columns[5, lo:hi], columns[6, lo:hi], columns[7, lo:hi]
        y8, y9, ya, yb = (
            columns[8, lo:hi],
            columns[9, lo:hi],
            columns[10, lo:hi],
            columns[11, lo:hi],
        )
        yc, yd, ye, yf = (
            columns[12, lo:hi],
            columns[13, lo:hi],
            columns[14, lo:hi],
            columns[15, lo:hi],
        )
        best = np.full(w, np.float32(np.inf), dtype=np.float32)
        for i in range(cost.size):
            x = rows[i]
            x0, x1, x2, x3, x4, x5, x6, x7 = x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]
            x8, x9, xa, xb, xc, xd, xe, xf = x[8], x[9], x[10], x[11], x[12], x[13], x[14], x[15]
            base = cost[i] + jump
            for j in range(w):
                lips = (y2[j] - x2) ** 2 + (y3[j] - x3) ** 2 + (y4[j] - x4) ** 2
                pca = (y5[j] - x5) ** 2 + (y6[j] - x6) ** 2 + (y7[j] - x7) ** 2
                pca += (y8[j] - x8) ** 2 + (y9[j] - x9) ** 2 + (ya[j] - xa) ** 2
                pca += (yb[j] - xb) ** 2 + (yc[j] - xc) ** 2 + (yd[j] - xd) ** 2
                pca += (ye[j] - xe) ** 2 + (yf[j] - xf) ** 2
                f = abs(y0[j] - x0) + abs(y1[j] - x1) + np.sqrt(lips) + np.sqrt(pca)
                best[j] = min(best[j], base + visual * f)
        for j in range(w):
            onward[lo + j] = best[j]


@njit(cache=True, nogil=True)
def _specials(
    before: npt.NDArray[np.int32],
    cost: FloatArray,
    after: npt.NDArray[np.int32],
    sequence: npt.NDArray[np.int32],
    frame: npt.NDArray[np.int32],
    features: SingleArray,
    visual: float,
    skip: FloatArray,
    place: npt.NDArray[np.int32],
    total: FloatArray,
) -> None:
    """Lower `total` to the steps inside a sequence that cost less than a jump."""
    p = skip.size - 1
    for i in range(before.size):
        place[before[i]] = i
    for j in range(after.size):
        u = after[j]
        for v in range(max(0, u - p + 1), u + 1):
            step = frame[u] - frame[v]
            if place[v] >= 0 and sequence[v] == sequence[u] and step < p:
                f = abs(features[u, 0] - features[v, 0]) + abs(features[u, 1] - features[v, 1])
                lips = pca = 0.0
                for k in range(2, 5):
                    lips += (features[u, k] - features[v, k]) ** 2
                for k in range(5, 16):
                    pca += (features[u, k] - features[v, k]) ** 2
                f += np.sqrt(lips) + np.sqrt(pca)
                total[j] = min(total[j], cost[place[v]] + skip[step] + visual * f)
    for i in range(before.size):
        place[before[i]] = -1
