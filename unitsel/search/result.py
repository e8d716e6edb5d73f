"""A path and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from unitsel.costs import Weights
from unitsel.search.space import SearchSpace

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class SearchResult:
    """A path and what it costs.

    Parameters
    ----------
    path : (T,) int64
        Unit of each frame.
    cost : float
        Path cost with the weights.
    target : (T,) float64
        Target cost of each frame, without weight.
    visual, skip : (T - 1,) float64
        f and g of each step, without weight.
    optimum : float, optional
        Least cost of any path, as the search found it going forward; nothing if the path was only
        priced.
    checked : float, optional
        The same as found by looking at every pair, if that was asked for.
    """

    path: IntArray
    cost: float
    target: FloatArray
    visual: FloatArray
    skip: FloatArray
    optimum: float | None = None
    checked: float | None = None

    @property
    def excess(self) -> float:
        """How much the path costs above the optimum; 0 if that is not known."""
        return 0.0 if self.optimum is None else max(0.0, self.cost - self.optimum)

    @property
    def relative_excess(self) -> float:
        """The same as a share of the optimum."""
        if self.optimum is None or self.excess == 0:
            return 0.0
        return self.excess / self.optimum if self.optimum > 0 else math.inf


def priced(
    space: SearchSpace, path: IntArray, target: FloatArray, weights: Weights
) -> SearchResult:
    """Price a given path (equations 9 to 11).

    Parameters
    ----------
    space : SearchSpace
    path : (T,) int
        Unit of each frame.
    target : (T,) float
        Target cost of each of them, without weight.
    weights : Weights

    Returns
    -------
    SearchResult
    """
    path = np.asarray(path, dtype=np.int64)
    visual = space.visual_costs(path[:-1], path[1:])
    skip = space.skip_costs(path[:-1], path[1:])
    cost = weights.target * math.fsum(target) + weights.concatenation * (
        weights.visual * math.fsum(visual) + weights.skip * math.fsum(skip)
    )
    return SearchResult(path, cost, np.asarray(target, dtype=np.float64), visual, skip)
