"""Pareto optimisation by NSGA-II (Deb et al. 2002, here pymoo's), until the front is stable.

The numbers only: a set is a point of a box, its objectives are to be small, and what they mean
is the caller's. Everything follows from the start and the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

REFERENCE = 1.1
"""Each side of the box whose hypervolume is measured; the start's front spans 0..1 of it."""


@dataclass(frozen=True)
class ParetoSettings:
    """How long and how widely the optimisation looks.

    Parameters
    ----------
    population : int
        Sets of a generation.
    generations : int
        At most so many.
    stable : int
        The front is stable when its hypervolume has grown by no more than `tolerance` over this
        many generations.
    tolerance : float
        In relation to the hypervolume.
    seed : int
        Of all that is random.

    Raises
    ------
    SelectionError
        If a value cannot be used.
    """

    population: int = 60
    generations: int = 100
    stable: int = 10
    tolerance: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("population", 4), ("generations", 1), ("stable", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise SelectionError(
                    f"training: {name} must be {least} or more, got {getattr(self, name)}"
                )
        if not (np.isfinite(self.tolerance) and self.tolerance >= 0):
            raise SelectionError(f"training: tolerance must be 0 or more, got {self.tolerance}")


@dataclass(frozen=True)
class Box:
    """Where sets may lie: on a lattice inside a box.

    Equal sets are then equal numbers, so none needs to be tried twice.

    Parameters
    ----------
    lower, upper, step : (D,) float64
        The lattice starts at `lower`; `upper` lies on it.
    apart : float
        The first two numbers differ by no more than this, a multiple of their step.
    """

    lower: FloatArray
    upper: FloatArray
    step: FloatArray
    apart: float = np.inf

    def snap(self, sets: FloatArray) -> FloatArray:
        """The points of the lattice next to some sets, (n, D) float64."""
        inside = np.clip(sets, self.lower, self.upper)
        if np.isfinite(self.apart):
            # The greater gives way.
            inside[:, :2] = np.minimum(inside[:, :2], inside[:, 1::-1] + self.apart)
        snapped = self.lower + np.round((inside - self.lower) / self.step) * self.step
        return np.asarray(np.round(snapped, 6), dtype=np.float64)


@dataclass(frozen=True)
class Evolution:
    """How an optimisation went.

    Parameters
    ----------
    generations : int
        That followed the start.
    stable : bool
        Whether the front became stable; else the generations were used up.
    hypervolumes : tuple of float
        After the start and after each generation.
    """

    generations: int
    stable: bool
    hypervolumes: tuple[float, ...]


def non_dominated(objectives: FloatArray) -> IntArray:
    """Indexes of the front: of the sets that no other one beats, (m,) int64, ascending.

    Parameters
    ----------
    objectives : (n, M) float64
        To be small. Of sets with the same objectives the first is taken.
    """
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    _, first = np.unique(objectives, axis=0, return_index=True)
    first = np.sort(first)
    front = NonDominatedSorting().do(objectives[first], only_non_dominated_front=True)
    return np.asarray(first[np.sort(front)], dtype=np.int64)


def evolve(
    objectives: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    box: Box,
    settings: ParetoSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Evolution:
    """Evolve a front from a start until its hypervolume is stable.

    Parameters
    ----------
    objectives : callable
        From sets (n, D) to their objectives (n, M), to be small. It sees every set once or more
        and may keep what it found: the result is in what it saw.
    start : (n, D) float64
        The sets to begin with, on the box's lattice; the best of them are the first parents.
    box : Box
    settings : ParetoSettings, optional
    progress : callable, optional
        Called with the generations done and the most there may be.

    Returns
    -------
    Evolution
    """
    # Half a second of imports that no other command needs.
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.indicators.hv import HV

    settings = settings or ParetoSettings()
    seen: list[FloatArray] = []

    class Trained(Problem):  # type: ignore[misc]
        """The caller's objectives as pymoo asks for them."""

        def _evaluate(self, x: FloatArray, out: dict[str, FloatArray], **_: object) -> None:
            found = np.asarray(objectives(x), dtype=np.float64)
            seen.append(found)
            out["F"] = found

    class Lattice(Repair):  # type: ignore[misc]
        """Children are put on the lattice before they are compared with their elders."""

        def _do(self, _: Problem, x: FloatArray, **__: object) -> FloatArray:
            return box.snap(x)

    # Three objectives are the paper's; pymoo only wants to know the number.
    problem = Trained(n_var=len(box.lower), n_obj=3, xl=box.lower, xu=box.upper)
    algorithm = NSGA2(pop_size=settings.population, sampling=start, repair=Lattice())
    algorithm.setup(problem, termination=("n_gen", settings.generations + 1), seed=settings.seed)
    algorithm.next()
    first = seen[0][non_dominated(seen[0])]
    low, high = first.min(axis=0), first.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    measure = HV(ref_point=np.full(first.shape[1], REFERENCE))

    def hypervolume() -> float:
        every = (np.concatenate(seen) - low) / span
        return float(measure(every[non_dominated(every)]))

    volumes = [hypervolume()]
    stable = False
    while not stable and algorithm.has_next():
        algorithm.next()
        volumes.append(hypervolume())
        if progress is not None:
            progress(len(volumes) - 1, settings.generations)
        if len(volumes) > settings.stable:
            grown = volumes[-1] - volumes[-1 - settings.stable]
            stable = grown <= settings.tolerance * volumes[-1]
    return Evolution(len(volumes) - 1, stable, tuple(volumes))
