"""What is trained: a few free numbers, and the settings of a selection that they stand for.

The four weights of the path cost have two degrees of freedom (a common factor does not change
the cheapest path, and wcc goes with its two children), so two ratios are trained::

    visual = log10(wcc * wccf / wtc)        skip = log10(wcc * wccg / wtc)

By option there are the ratios of the feature weights, log2(k_d / k_pca), beta1, and the length
of the context in frames.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from database.cost_definition import FeatureWeights
from database.errors import SelectionError
from database.track import context_frames
from unitsel.costs import Weights
from unitsel.settings import SelectionSettings
from unitsel.training.pareto import Box

FloatArray = npt.NDArray[np.float64]

SETTINGS_PER_WEIGHT: Final = 10
"""Of the grid, as in the paper (section 6.2)."""

MIDDLE: Final = -1.25
"""Middle of the grid, log10 of both ratios: costs are in medians, so it lies near where a step
inside a viseme and a foreign context weigh alike."""

GRID_STEP: Final = 0.15
"""From one setting of a weight to the next, decades."""

RATIO_STEP: Final = 0.025
"""Decades; ratios nearer than this, 6 %, are one."""

APART: Final = (SETTINGS_PER_WEIGHT - 1) * GRID_STEP
"""How far the grid's two ratios are apart, decades: they share wcc and wtc."""

REACH: Final = 1.5 * APART
"""How far three weights together move a ratio from the middle, decades."""

CONTEXT_REACH: Final = 0.4
"""Longest context that is tried, seconds."""

SPREAD: Final = 200
"""Sets spread evenly over the box that the start has besides the grid, with features."""

RATIOS: Final = ("visual", "skip")
FEATURES: Final = ("lips", "teeth", "tongue", "beta1", "context")


@dataclass(frozen=True)
class WeightSpace:
    """The free numbers and their meaning.

    Parameters
    ----------
    base : SelectionSettings
        What is not free.
    fps : float
        Frame rate of the database, 1/s.
    features : bool
        Whether the feature weights, beta1 and the context are free too.
    """

    base: SelectionSettings
    fps: float
    features: bool = False
    box: Box = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bounds = [(MIDDLE - REACH, MIDDLE + REACH, RATIO_STEP)] * len(RATIOS)
        if self.features:
            bounds += [(-4.0, 4.0, 0.25)] * 3 + [(-1.0, 0.0, 0.05)]
            bounds.append((1.0, float(context_frames(self.fps, CONTEXT_REACH)), 1.0))
        lower, upper, step = np.array(bounds, dtype=np.float64).T
        box = Box(lower, upper, step, APART)
        object.__setattr__(self, "box", box)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the free numbers."""
        return RATIOS + (FEATURES if self.features else ())

    def settings(self, numbers: Sequence[float]) -> SelectionSettings:
        """The settings that a set of free numbers stands for."""
        given = dict(zip(self.names, numbers, strict=True))
        weights = Weights(1.0, 1.0, *(_short(10 ** given[n]) for n in RATIOS))
        if not self.features:
            return replace(self.base, weights=weights)
        k = (_short(2 ** given[n]) for n in ("lips", "teeth", "tongue"))
        costs = replace(
            self.base.costs,
            beta1=float(given["beta1"]),
            context=round(float(given["context"]) / self.fps, 6),
            features=FeatureWeights(1.0, *k),
        )
        return replace(self.base, weights=weights, costs=costs)

    def numbers(self, settings: SelectionSettings) -> tuple[float, ...]:
        """The free numbers of settings, on the lattice or not.

        Raises
        ------
        SelectionError
            If a ratio is 0 or infinite, so that it has no logarithm.
        """
        w, costs = settings.weights, settings.costs
        ratios = (w.concatenation * w.visual, w.concatenation * w.skip)
        k = costs.features
        if min(w.target, *ratios) <= 0 or (self.features and min(k.values) <= 0):
            raise SelectionError("training: weights of 0 are no ratio to start from")
        found = [math.log10(r / w.target) for r in ratios]
        if self.features:
            found += [math.log2(d / k.pca) for d in (k.lips, k.teeth, k.tongue)]
            found += [costs.beta1, context_frames(self.fps, costs.context)]
        return tuple(round(float(v), 6) for v in found)

    def grid(self) -> FloatArray:
        """Ten settings of each of the four weights, those with equal ratios once, (442, D).

        Of the 10,000 combinations as many differ in a ratio. The other numbers are the base's.
        """
        steps = (np.arange(SETTINGS_PER_WEIGHT) - (SETTINGS_PER_WEIGHT - 1) / 2) * GRID_STEP
        # wcc / wtc takes 19 values, and moves both ratios at a time.
        common = np.unique(np.round(np.subtract.outer(steps, steps), 6))
        ratios = [
            (MIDDLE + c + visual, MIDDLE + c + skip)
            for c, visual, skip in itertools.product(common, steps, steps)
        ]
        pairs = np.unique(np.round(ratios, 6), axis=0)
        rest = self.numbers(self.base)[len(RATIOS) :]
        return self.box.snap(np.column_stack([pairs, np.tile(rest, (len(pairs), 1))]))

    def start(self, seed: int) -> FloatArray:
        """The sets to begin with: the grid, and with features others spread over the box."""
        grid = self.grid()
        if not self.features:
            return grid
        spread = qmc.LatinHypercube(len(self.names), rng=np.random.default_rng(seed))
        others = qmc.scale(spread.random(SPREAD), self.box.lower, self.box.upper)
        return np.unique(np.concatenate([grid, self.box.snap(others)]), axis=0)


def _short(value: float) -> float:
    """Four digits are enough for a weight, and can be read."""
    return float(f"{value:.4g}")
