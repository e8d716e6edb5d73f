"""The least path cost by looking at every pair of units: what the search is checked against.

Nothing is left out and nothing is shared with the search but the definition of the costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numba import njit

from unitsel.costs import Weights

if TYPE_CHECKING:
    from unitsel.search.space import SearchSpace

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def least_cost(
    space: SearchSpace,
    candidates: Sequence[npt.NDArray[np.integer]],
    target: Sequence[npt.NDArray[np.floating]],
    weights: Weights,
) -> float:
    """Least path cost (equation 9), in float64; see `unitsel.search.search`.

    Memory is that of a few frames; time grows with the square of the candidates.
    """
    features = np.ascontiguousarray(space.features.T, dtype=np.float64)
    skip = space.skip * float(weights.concatenation * weights.skip)
    visual = float(weights.concatenation * weights.visual)
    cost = weights.target * np.asarray(target[0], dtype=np.float64)
    for before, after, own in zip(candidates, candidates[1:], target[1:], strict=False):
        onward = np.full(len(after), np.inf)
        _every_pair(
            np.asarray(before, dtype=np.int64), cost, np.asarray(after, dtype=np.int64),
            features[:, before].T.copy(), features[:, after], space.sequence[before],
            space.frame[before], space.sequence[after], space.frame[after], space.groups, visual,
            skip, onward,
        )  # fmt: skip
        cost = onward + weights.target * np.asarray(own, dtype=np.float64)
    return float(cost.min())


@njit(cache=True, nogil=True)
def _every_pair(
    before: IntArray,
    cost: FloatArray,
    after: IntArray,
    rows: FloatArray,
    columns: FloatArray,
    sequence_before: npt.NDArray[np.int32],
    frame_before: npt.NDArray[np.int32],
    sequence_after: npt.NDArray[np.int32],
    frame_after: npt.NDArray[np.int32],
    groups: IntArray,
    visual: float,
    skip: FloatArray,
    onward: FloatArray,
) -> None:
    """Cheapest arrival at each unit of `after`, (m, G) and (G, n) features, to (n,)."""
    n = after.size
    p = skip.size - 1
    f = np.empty(n)
    square = np.empty(n)
    for i in range(before.size):
        f[:] = 0.0
        for g in range(groups.size - 1):
            square[:] = 0.0
            for k in range(groups[g], groups[g + 1]):
                x = rows[i, k]
                column = columns[k]
                for j in range(n):
                    d = column[j] - x
                    square[j] += d * d
            for j in range(n):
                f[j] += np.sqrt(square[j])
        for j in range(n):
            step = frame_after[j] - frame_before[i]
            near = sequence_after[j] == sequence_before[i] and 0 <= step < p
            c = cost[i] + visual * f[j] + (skip[step] if near else skip[p])
            onward[j] = min(onward[j], c)
