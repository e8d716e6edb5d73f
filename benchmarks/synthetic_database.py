"""A made-up database of the size the paper's speaker has, and sentences to search in it.

Nothing here is recorded. Phones follow one another at random, with the shares that visemes have in
running speech (the largest holds 18 % of the units); features pass smoothly through one target a
phone, which differs from phone to phone of a viseme as coarticulation makes it; target costs
are those of equation 1, so they are as smooth in time and as skewed as real ones. Then all is
scaled to what a setting says: the median f of two random units of a viseme is 1, and the target
costs of a frame have a standard deviation of s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from database.cost_definition import context_weights, skip_costs
from unitsel.costs import target_costs
from unitsel.search import SearchSpace

FloatArray = npt.NDArray[np.float64]

FPS = 50
CONTEXT = 10
"""Frames on each side (0.2 s)."""
N_VISEMES = 22
LARGEST = 0.18
"""Share of the largest viseme; the others fall off so that a frame has 2,900 candidates in the
mean at 36,358 units."""
FALL = 0.868
PHONE = 4.5
"""Mean length of a phone, frames."""
GROUPS = (0, 1, 2, 5, 16)
"""Tongue, teeth, lips, PCA, as `database.cost_definition.visual_features` orders them."""


@dataclass(frozen=True)
class SyntheticDatabase:
    """Units and what sentences need of them.

    Parameters
    ----------
    space : SearchSpace
    candidates : 22 arrays of int32
        Units of each viseme.
    contexts : (N, 2n + 1) uint8
        Visemes around each unit.
    distance : (43, 43) float64
        M, of visemes here.
    """

    space: SearchSpace
    candidates: tuple[npt.NDArray[np.int32], ...]
    contexts: npt.NDArray[np.uint8]
    distance: FloatArray

    def sentence(
        self, n_frames: int, s: float, seed: int
    ) -> tuple[list[npt.NDArray[np.int32]], list[FloatArray]]:
        """Candidates and target costs of the frames of a random sentence.

        Parameters
        ----------
        n_frames : int
        s : float
            Standard deviation of the target costs of each frame.
        seed : int
        """
        visemes = phones(n_frames, np.random.default_rng(seed))
        weights = context_weights(CONTEXT, FPS, -0.3)
        candidates, target = [], []
        for viseme, context in zip(visemes, _windows(visemes), strict=True):
            units = self.candidates[viseme]
            cost = target_costs(context, self.contexts, self.distance, weights, units)
            candidates.append(units)
            target.append(cost * (s / cost.std()))
        return candidates, target


def make_database(
    n_units: int = 36_358, n_sequences: int = 180, seed: int = 0
) -> SyntheticDatabase:
    """Make up a database.

    Parameters
    ----------
    n_units, n_sequences : int
    seed : int
    """
    rng = np.random.default_rng(seed)
    bounds = np.linspace(0, n_units, n_sequences + 1).astype(int)
    means = rng.normal(size=(N_VISEMES, GROUPS[-1]))
    visemes, contexts, features = [], [], []
    for length in np.diff(bounds):
        spoken = phones(int(length), rng)
        changes = np.flatnonzero(np.diff(spoken, prepend=-1))
        own = means[spoken[changes]] + rng.normal(size=(len(changes), GROUPS[-1]))
        path = np.repeat(own, np.diff(changes, append=length), axis=0)
        path = gaussian_filter1d(path, 1.5, axis=0, mode="nearest")
        # A phone is no straight line: the mouth's own small motion.
        path += 0.3 * gaussian_filter1d(rng.normal(size=path.shape), 2.0, axis=0)
        visemes.append(spoken)
        contexts.append(_windows(spoken))
        features.append(path)
    viseme = np.concatenate(visemes)
    candidates = tuple(np.flatnonzero(viseme == v).astype(np.int32) for v in range(N_VISEMES))
    # PCA weights are weighed by their eigenvalues, so few of them matter.
    scale = np.concatenate([[0.6, 0.6], [0.6, 0.6, 0.6], 1.2 / np.arange(1, 12) ** 1.0])
    space = SearchSpace(
        np.repeat(np.arange(n_sequences), np.diff(bounds)),
        np.concatenate([np.arange(n) for n in np.diff(bounds)]),
        (np.concatenate(features) * scale).astype(np.float32),
        np.array(GROUPS),
        skip_costs(0.6, 5),
    )
    pairs = [rng.choice(c, (2, 2000)) for c in candidates]
    f = np.concatenate([space.visual_costs(a, b) for a, b in pairs])
    space = SearchSpace(
        space.sequence,
        space.frame,
        (space.features / np.median(f)).astype(np.float32),
        space.groups,
        space.skip,
    )
    places = rng.normal(size=(43, 6))
    distance = np.linalg.norm(places[:, None] - places, axis=2)
    return SyntheticDatabase(space, candidates, np.concatenate(contexts), distance)


def phones(length: int, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Viseme of each frame of a random utterance."""
    share = np.concatenate([[LARGEST], FALL ** np.arange(N_VISEMES - 1)])
    share[1:] *= (1 - LARGEST) / share[1:].sum()
    n = 2 * int(length / PHONE) + 10
    order = rng.choice(N_VISEMES, n, p=share)
    frames = 1 + rng.poisson(PHONE - 1, n)
    return np.repeat(order, frames)[:length]


def _windows(visemes: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    """Visemes around each frame, (T, 2n + 1); the ends are repeated."""
    padded = np.pad(visemes.astype(np.uint8), CONTEXT, mode="edge")
    return np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * CONTEXT + 1))
