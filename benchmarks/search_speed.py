"""How fast the search is, against a plain Viterbi in numpy over all pairs of candidates.

The units are made up: sequences of 75 frames whose features wander smoothly, as a mouth's do, and
one list of candidates for all frames, as in a silence. Both find the same least cost, which is
checked. Run as ``python benchmarks/search_speed.py [CANDIDATES ...]``.
"""

from __future__ import annotations

import itertools
import sys
import time

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from database.cost_definition import skip_costs
from unitsel.costs import Weights
from unitsel.search import SearchSpace, search

FloatArray = npt.NDArray[np.float64]

FRAMES = 25
CLIP = 75
GROUPS = (0, 12, 14, 15, 16)
"""PCA weights, lips, teeth, tongue."""


def make_up(n: int, rng: np.random.Generator) -> tuple[SearchSpace, list[FloatArray]]:
    """Units, and the target costs of all of them at each frame."""
    noise = gaussian_filter1d(rng.normal(size=(n, GROUPS[-1])), 3, axis=0)
    features = noise / noise.std(axis=0) / np.sqrt(np.repeat(np.diff(GROUPS), np.diff(GROUPS)))
    unit = np.arange(n)
    space = SearchSpace(
        (unit // CLIP).astype(np.int32),
        (unit % CLIP).astype(np.int32),
        features.astype(np.float32),
        np.array(GROUPS),
        skip_costs(0.6, 5),
    )
    target = [rng.gamma(4, 0.25, n) for _ in range(FRAMES)]
    return space, target


def all_pairs(space: SearchSpace, target: list[FloatArray], weights: Weights) -> float:
    """Least cost of a path; every frame looks at all pairs, in blocks of 256 sources."""
    n = len(space)
    groups = list(itertools.pairwise(GROUPS))
    lengths = [(space.features[:, a:b].astype(np.float64) ** 2).sum(axis=1) for a, b in groups]
    cost = weights.target * target[0]
    for wanted in target[1:]:
        best = np.full(n, np.inf)
        for start in range(0, n, 256):
            block = slice(start, start + 256)
            step = np.zeros((len(cost[block]), n))
            for (a, b), squared in zip(groups, lengths, strict=True):
                inner = space.features[block, a:b].astype(np.float64) @ space.features[:, a:b].T
                apart = squared[block, None] + squared - 2 * inner
                step += weights.visual * np.sqrt(np.maximum(apart, 0))
            difference = space.frame[None, :] - space.frame[block, None]
            same = space.sequence[block, None] == space.sequence
            near = same & (difference >= 0) & (difference < len(space.skip))
            skip = space.skip[np.where(near, difference, len(space.skip) - 1)]
            step += weights.skip * skip
            best = np.minimum(best, (cost[block, None] + weights.concatenation * step).min(axis=0))
        cost = best + weights.target * wanted
    return float(cost.min())


def main(sizes: list[int]) -> None:
    """Print a line for each number of candidates."""
    weights = Weights()
    rng = np.random.default_rng(0)
    warm, target = make_up(CLIP, rng)
    search(warm, [np.arange(CLIP)] * FRAMES, target, weights)  # compiles

    print(f"{FRAMES} frames; seconds")
    print(f"{'candidates':>10} {'search':>9} {'all pairs':>10} {'ratio':>7}")
    for n in sizes:
        space, target = make_up(n, rng)
        started = time.perf_counter()
        found = search(space, [np.arange(n)] * FRAMES, target, weights)
        between = time.perf_counter()
        least = all_pairs(space, target, weights)
        ended = time.perf_counter()
        if not np.isclose(found.cost, least, rtol=1e-6):
            sys.exit(f"{n} candidates: the search found {found.cost}, all pairs {least}")
        ours, plain = between - started, ended - between
        print(f"{n:>10} {ours:>9.3f} {plain:>10.3f} {plain / ours:>7.1f}")


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or [300, 1000, 3000])
