"""Target costs, and the weights of a search.

What both the build and the selection must agree on (context weights, feature groups, skip
costs) is defined in database/cost_definition.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from numba import njit

from database.cost_definition import CostSettings, FeatureWeights
from database.errors import SelectionError

__all__ = ["CostSettings", "FeatureWeights", "Weights", "target_costs"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Weights:
    """The four weights of the path cost (Liu and Ostermann 2009, equation 10).

    Parameters
    ----------
    target : float
        wtc, of the target costs.
    concatenation : float
        wcc, of both costs of a step.
    visual : float
        wccf, of the visual cost f.
    skip : float
        wccg, of the skip cost g.

    Raises
    ------
    SelectionError
        If a weight is not finite or below 0, or the weights make every path cost 0.
    """

    target: float = 1.0
    concatenation: float = 1.0
    visual: float = 0.05
    skip: float = 0.08

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.number):
                raise SelectionError(f"weights: {f.name} must be a number, got {value!r}")
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            if not (math.isfinite(number) and number >= 0):
                raise SelectionError(f"weights: {f.name} must be finite and 0 or more, got {value}")
            object.__setattr__(self, f.name, number)
        steps = (self.concatenation * self.visual, self.concatenation * self.skip)
        if not all(math.isfinite(s) for s in steps):
            raise SelectionError("weights: concatenation times visual or skip is not finite")
        if self.target <= 0 and max(steps) <= 0:
            raise SelectionError(
                "weights: are all 0 (concatenation multiplies visual and skip), "
                "so every path would cost the same; give one a value"
            )


def target_costs(
    target_context: npt.NDArray[np.uint8],
    contexts: npt.NDArray[np.uint8],
    phoneme_distance: npt.NDArray[np.floating],
    context_weights: FloatArray,
    candidates: npt.NDArray[np.integer] | None = None,
) -> FloatArray:
    """Target cost of each candidate for one frame (equation 1), before any scale.

    Parameters
    ----------
    target_context : (2n + 1,) uint8
        Phonemes around the frame.
    contexts : (N, 2n + 1) uint8
        Phonemes around each unit, at the same offsets in time.
    phoneme_distance : (43, 43) float
        M.
    context_weights : (2n + 1,) float64
        v, of sum 1 (`database.cost_definition.context_weights`).
    candidates : (m,) int, optional
        The units to look at; all by default.

    Returns
    -------
    (m,) float64
    """
    # One row of M an offset, so that a candidate costs one look-up an offset.
    table = context_weights[:, None] * np.asarray(phoneme_distance, np.float64)[target_context]
    if candidates is None:
        candidates = np.arange(len(contexts), dtype=np.int32)
    out = np.empty(len(candidates), dtype=np.float64)
    _gather(table, contexts, np.asarray(candidates, dtype=np.int32), out)
    return out


@njit(cache=True, nogil=True)
def _gather(
    table: FloatArray,
    contexts: npt.NDArray[np.uint8],
    candidates: npt.NDArray[np.int32],
    out: FloatArray,
) -> None:
    """Sum of ``table[i, contexts[u, i]]`` over i, (2n + 1, 43) and (N, 2n + 1), to (m,)."""
    for c in range(candidates.size):
        u = candidates[c]
        total = 0.0
        for i in range(table.shape[0]):
            total += table[i, contexts[u, i]]
        out[c] = total
