"""What a cost is: the definitions that the build and the selection must share.

The build computes M and the scales of `database.schema.CostModel` with them, the selection
computes costs with them; both import this file, so that a stored scale always belongs to the
cost it scales. Formulas as in Liu and Ostermann 2009, equations 1 to 8:

* context: ``v_i = exp(beta1 * |i|)`` with ``i`` counted in steps of 1/50 s, whatever the frame
  rate, normalised to a sum of 1;
* visual cost: ``f(u1, u2) = sum_d k_d * |U1_d - U2_d| / (scale_d * visual_scale)`` over the
  groups of `GROUPS`, the ``k_d`` normalised to a sum of 1, so that only their ratios count;
* skip cost: ``g`` by the difference of recorded frame numbers, ``w_i = exp(beta3 * i)``.

A sum of Euclidean norms is a metric: the search leans on that (unitsel/search.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.guide_model import Mouths
from database.schema import CostModel
from database.track import CONTEXT_SECONDS

FloatArray = npt.NDArray[np.float64]

GROUPS: Final = ("pca", "lips", "teeth", "tongue")
"""Feature groups of the visual cost, in the order of ``costs/feature_scales``."""

CONTEXT_RATE: Final = 50.0
"""beta1 is per frame at this rate (1/s)."""


LONGEST_CONTEXT: Final = 1.0
"""Seconds; beyond it phonemes say nothing of the mouth any more."""


@dataclass(frozen=True)
class FeatureWeights:
    """Relative weights k_d of the feature groups; only their ratios count.

    Teeth and tongue are read from few pixels, so they are trusted less by default.
    """

    pca: float = 1.0
    lips: float = 1.0
    teeth: float = 0.5
    tongue: float = 0.5

    def __post_init__(self) -> None:
        values = self.values
        if not all(math.isfinite(v) and v >= 0 for v in values) or sum(values) <= 0:
            raise SelectionError(
                f"feature weights {values}: must be finite, 0 or more, and not all 0"
            )

    @property
    def values(self) -> tuple[float, float, float, float]:
        """The weights in the order of `GROUPS`."""
        return self.pca, self.lips, self.teeth, self.tongue

    @property
    def normalised(self) -> FloatArray:
        """(4,) float64: the weights, divided by their sum."""
        k = np.array(self.values, dtype=np.float64)
        return np.asarray(k / k.sum(), dtype=np.float64)


@dataclass(frozen=True)
class CostSettings:
    """Constants of the cost functions; the paper's by default.

    Parameters
    ----------
    beta1 : float
        Decay of the context weights per 1/50 s (equation 1).
    beta2 : float
        Decay of the PCA components' weights in M (equation 5); used by the build only.
    beta3 : float
        Growth of the skip cost, 0 or more (equation 8).
    p : int
        Difference of frame numbers from which on the skip cost is the greatest (equation 8).
    context : float
        Seconds of context on each side of a frame (equation 1).
    components : int
        K, the number of PCA weights in M (equation 5); used by the build only.
    features : FeatureWeights
        k_d, weights between the feature groups (equation 7).

    Raises
    ------
    SelectionError
        If a value cannot be used.
    """

    beta1: float = -0.3
    beta2: float = 0.1
    beta3: float = 0.6
    p: int = 5
    context: float = CONTEXT_SECONDS
    components: int = 12
    features: FeatureWeights = field(default_factory=FeatureWeights)

    def __post_init__(self) -> None:
        for name in ("beta1", "beta2", "beta3"):
            if not math.isfinite(getattr(self, name)):
                raise SelectionError(f"cost settings: {name} must be finite")
        # With a falling w_i a skip inside a sequence would cost more than a jump, and the
        # split into the two that the search makes would not be exact.
        if self.beta3 < 0:
            raise SelectionError(f"cost settings: beta3 must be 0 or more, got {self.beta3:g}")
        if self.p < 2:
            raise SelectionError(f"cost settings: p must be 2 or more, got {self.p}")
        if not 0 < self.context <= LONGEST_CONTEXT:
            raise SelectionError(
                f"cost settings: context must lie above 0 and up to {LONGEST_CONTEXT:g} seconds, "
                f"got {self.context:g}"
            )
        if self.components < 1:
            raise SelectionError(
                f"cost settings: components must be 1 or more, got {self.components}"
            )


def context_weights(n: int, fps: float, beta1: float) -> FloatArray:
    """Weights v_i of the context, divided by their sum (equation 1).

    Parameters
    ----------
    n : int
        Frames on each side (`database.track.context_frames`).
    fps : float
        Frames a second of the context.
    beta1 : float
        Decay per 1/50 s: at 25 fps one frame of offset counts as two.

    Returns
    -------
    (2n + 1,) float64
    """
    offsets = np.abs(np.arange(-n, n + 1)) * (CONTEXT_RATE / fps)
    v = np.exp(beta1 * offsets)
    return np.asarray(v / v.sum(), dtype=np.float64)


def skip_costs(beta3: float, p: int) -> FloatArray:
    """Skip cost g by difference of recorded frame numbers in one sequence (equation 8).

    Returns
    -------
    (p + 1,) float64
        Entry i is g for the difference i. The last, the greatest, is also that of any
        difference beyond p, of a negative one, and of another sequence.
    """
    g = np.exp(beta3 * np.arange(p + 1, dtype=np.float64))
    g[0] = g[1]
    g[1] = 0.0
    return g


def feature_groups(units: Mouths, eigenvalues: npt.NDArray[np.floating]) -> tuple[FloatArray, ...]:
    """Features of each unit, one array a group, scaled inside the group.

    Parameters
    ----------
    units : Mouths
        N units, or N predicted mouths.
    eigenvalues : (K or more,) float
        Variance along each PCA component.

    Returns
    -------
    4 arrays (N, size of the group) float64, in the order of `GROUPS`
        The Euclidean distance of two rows is the distance of the two units in the group: PCA
        ``sqrt(sum_k lambda_k / sum(lambda) * (dU_k)^2)`` in grey levels, lips (width, height,
        inner opening) in mm, teeth and tongue in their visibility, 0..1.
    """
    pca = np.asarray(units.pca, dtype=np.float64)
    share = np.maximum(np.asarray(eigenvalues, dtype=np.float64)[: pca.shape[1]], 0.0)
    # A texture without any variance has no PCA distances either.
    share = share / share.sum() if share.sum() > 0 else np.ones_like(share) / max(1, share.size)
    lips = np.stack([units.mouth_width, units.mouth_height, units.inner_opening], axis=1)
    return (
        pca * np.sqrt(share),
        lips.astype(np.float64),
        np.asarray(units.teeth, dtype=np.float64)[:, None],
        np.asarray(units.tongue, dtype=np.float64)[:, None],
    )


def visual_features(
    units: Mouths,
    eigenvalues: npt.NDArray[np.floating],
    costs: CostModel,
    weights: FeatureWeights,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """All features in one matrix, scaled so that f is a sum of Euclidean norms (equation 7).

    Parameters
    ----------
    units : Mouths
        N units, or N predicted mouths.
    eigenvalues : (K or more,) float
        Variance along each PCA component.
    costs : CostModel
        Its scales are divided by.
    weights : FeatureWeights
        k_d; groups of weight 0 are left out.

    Returns
    -------
    features : (N, G) float32
    groups : (n_groups + 1,) int64
        Group d is ``features[:, groups[d]:groups[d + 1]]``; f of two units is the sum over the
        groups of the Euclidean distance there. The small groups come first.
    """
    columns: list[FloatArray] = []
    groups = [0]
    k = weights.normalised
    # Small groups first: the search leaves off a distance as soon as it is too great.
    for d, values in reversed(list(enumerate(feature_groups(units, eigenvalues)))):
        if k[d] > 0:
            columns.append(values * (k[d] / (float(costs.feature_scales[d]) * costs.visual_scale)))
            groups.append(groups[-1] + values.shape[1])
    features = np.ascontiguousarray(np.concatenate(columns, axis=1), dtype=np.float32)
    return features, np.array(groups, dtype=np.int64)
