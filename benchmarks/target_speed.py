"""How fast a sentence's target costs are, by runs of equal phonemes and frame by frame.

The database is made up, of the paper's larger size (synthetic_database.py). Both ways give the
same costs to 1e-9; the baseline is the same numba look-up for every frame of every context that
`unitsel.costs.target_costs` makes. Least of several runs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from database.cost_definition import context_weights
from database.track import context_windows
from unitsel.costs import target_costs
from unitsel.target_runs import RunTargets

sys.path.insert(0, str(Path(__file__).parent))  # `make bench` leaves a script's folder out

from synthetic_database import CONTEXT, FPS, SyntheticDatabase, make_database, phones

RUNS = 7


def best_of(work: Callable[[], object]) -> float:
    """Least time of some runs, seconds."""
    times = []
    for _ in range(RUNS):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def frame_by_frame(
    made: SyntheticDatabase,
    weights: npt.NDArray[np.float64],
    wanted: npt.NDArray[np.uint8],
    candidates: Sequence[npt.NDArray[np.int32]],
) -> list[npt.NDArray[np.float64]]:
    """Every frame of every context looked up."""
    return [
        target_costs(window, made.contexts, made.distance, weights, units)
        for window, units in zip(context_windows(wanted, CONTEXT), candidates, strict=True)
    ]


def main() -> None:
    """Print the table."""
    made = make_database()
    weights = context_weights(CONTEXT, FPS, -0.3)
    runs = RunTargets(made.contexts, made.distance, weights)
    print(f"{len(made.space):,} units; seconds a second of video")
    print(f"{'frames':>6} {'frame by frame':>14} {'by runs':>9} {'ratio':>6}")
    for length in (150, 1500):
        wanted = phones(length, np.random.default_rng(1)).astype(np.uint8)
        candidates = [made.candidates[v] for v in wanted]
        slow = partial(frame_by_frame, made, weights, wanted, candidates)
        fast = partial(runs.costs, wanted, candidates)
        for one, other in zip(fast(), slow(), strict=True):
            if not np.allclose(one, other, rtol=1e-9):
                sys.exit("the two ways give different costs")
        seconds = length / FPS
        plain, ours = best_of(slow) / seconds, best_of(fast) / seconds
        print(f"{length:>6} {plain:>14.5f} {ours:>9.5f} {plain / ours:>6.1f}")


if __name__ == "__main__":
    main()
