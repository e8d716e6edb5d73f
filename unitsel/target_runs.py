"""The paper's target cost for whole sentences, by runs of equal phonemes.

Frame by frame, equation 1 looks 2n + 1 phonemes up for every candidate. But a recording stays on
a phoneme for several frames. With the sums of the weighted distances up to each place of the
context, one table a target frame::

    C(i, a) = sum_j<i v_j M(T_j, a)

a run of phoneme a over the places i to k - 1 costs ``C(k, a) - C(i, a)``. A context with r changes
of phoneme takes 2r + 1 look-ups; a candidate has about four. Where they are does not depend on the
sentence, so it is worked out once for each list of candidates, and candidates with equally many
changes are done together. Nothing is approximated: only the order of the additions differs from
`unitsel.costs.target_costs`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from database.phonemes import N_PHONEMES, N_VISEMES
from database.track import context_windows

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

KEPT: Final = 4 * N_VISEMES
"""Lists of candidates whose runs are kept."""


@dataclass(frozen=True)
class ContextRuns:
    """The runs of the contexts of some units.

    Parameters
    ----------
    row : (m,) int32
        The units' places in their list, sorted by the number of changes.
    codes : (sum of m_k (2k + 1),) uint16
        Places in the table C that a unit adds and takes off by turns, unit after unit.
    changes, units : (groups,) int64
        Number of changes, and of units that have as many.
    """

    row: npt.NDArray[np.int32]
    codes: npt.NDArray[np.uint16]
    changes: IntArray
    units: IntArray

    @classmethod
    def of(cls, contexts: npt.NDArray[np.uint8]) -> ContextRuns:
        """Find the runs of (m, 2n + 1) contexts."""
        width = contexts.shape[1]
        contexts = contexts.astype(np.uint16)
        changed = contexts[:, 1:] != contexts[:, :-1]
        count = changed.sum(axis=1)
        row = np.argsort(count, kind="stable")
        found, units = np.unique(count, return_counts=True)
        codes = []
        for k, rows in zip(found, np.split(row, np.cumsum(units)[:-1]), strict=True):
            # Up to each change the phoneme before it is added, and the one after it taken off.
            place = np.nonzero(changed[rows])[1].reshape(len(rows), k) + 1
            mine = np.arange(len(rows))[:, None]
            group = np.empty((len(rows), 2 * k + 1), dtype=np.uint16)
            group[:, 0:-1:2] = place * N_PHONEMES + contexts[rows][mine, place - 1]
            group[:, 1::2] = place * N_PHONEMES + contexts[rows][mine, place]
            group[:, -1] = width * N_PHONEMES + contexts[rows, -1]
            codes.append(group.ravel())
        return cls(row.astype(np.int32), np.concatenate(codes), found.astype(np.int64), units)


class RunTargets:
    """Target costs of sentences for one database.

    Parameters
    ----------
    contexts : (N, 2n + 1) uint8
        Phonemes around each unit.
    phoneme_distance : (43, 43) float
        M.
    weights : (2n + 1,) float64
        v, of sum 1 (`database.cost_definition.context_weights`).
    """

    def __init__(
        self,
        contexts: npt.NDArray[np.uint8],
        phoneme_distance: npt.NDArray[np.floating],
        weights: FloatArray,
    ) -> None:
        self._contexts = contexts
        self._distance = np.ascontiguousarray(phoneme_distance, dtype=np.float64)
        self._weights = np.ascontiguousarray(weights, dtype=np.float64)
        # A list that is kept here keeps its identity: no other can be mistaken for it.
        self._runs: OrderedDict[int, tuple[npt.NDArray[np.int32], ContextRuns]] = OrderedDict()

    def costs(
        self,
        phonemes: npt.NDArray[np.uint8],
        candidates: Sequence[npt.NDArray[np.int32]],
        scale: float = 1.0,
    ) -> tuple[FloatArray, ...]:
        """Target costs of a sentence's candidates (equation 1).

        Parameters
        ----------
        phonemes : (T,) uint8
            Wanted phoneme of each frame; beyond the ends is silence.
        candidates : T arrays of int32
            Units to look at; frames may share an array, and frames that want the same in a row
            then share their costs.
        scale : float
            Costs are divided by it.

        Returns
        -------
        T arrays of float64
        """
        windows = context_windows(phonemes, len(self._weights) // 2)
        weights = self._weights / scale
        out: list[FloatArray] = []
        for t, units in enumerate(candidates):
            # Long silences and vowels repeat their context.
            if t > 0 and units is candidates[t - 1] and (windows[t] == windows[t - 1]).all():
                out.append(out[-1])
                continue
            runs = self._runs_of(units)
            cost = np.empty(len(units))
            _costs(
                windows[t], weights, self._distance, runs.row, runs.codes, runs.changes,
                runs.units, cost,
            )  # fmt: skip
            out.append(cost)
        return tuple(out)

    def _runs_of(self, units: npt.NDArray[np.int32]) -> ContextRuns:
        if id(units) not in self._runs:
            self._runs[id(units)] = (units, ContextRuns.of(self._contexts[units]))
            if len(self._runs) > KEPT:
                self._runs.popitem(last=False)
        return self._runs[id(units)][1]


@njit(cache=True, nogil=True)
def _costs(
    window: npt.NDArray[np.uint8],
    weights: FloatArray,
    distance: FloatArray,
    row: npt.NDArray[np.int32],
    codes: npt.NDArray[np.uint16],
    changes: IntArray,
    units: IntArray,
    cost: FloatArray,
) -> None:
    n = distance.shape[1]
    table = np.zeros((window.size + 1) * n)
    for i in range(window.size):
        for a in range(n):
            table[(i + 1) * n + a] = table[i * n + a] + weights[i] * distance[window[i], a]
    at = 0
    c = 0
    for group in range(changes.size):
        k = changes[group]
        for _ in range(units[group]):
            total = table[codes[at + 2 * k]]
            for j in range(k):
                total += table[codes[at + 2 * j]] - table[codes[at + 2 * j + 1]]
            cost[row[c]] = total
            at += 2 * k + 1
            c += 1
