"""The order in which a background's frames are shown when it must last longer than it is.

A video texture (Schoedl et al., 2000): the frames are played forwards, and now and then the
picture changes, in a blend, to other frames that are like those that would have come
(`render.similar_frames`). Where to leave and where to go on is drawn from a seeded generator among
the ways that are alike enough and lead on; what was shown lately is avoided, so that no loop is
seen. Several backgrounds are first shown one after another. Where a background offers too few ways
it is played forth and back.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from render.background import IntArray, Material
from render.similar_frames import Likeness, blend_weights

FloatArray = npt.NDArray[np.float64]

LIMIT: Final = 1.5
"""Greatest cost of a change (`Likeness.cost`) that is used."""

SHORTEST_STAY: Final = 0.4
"""Seconds that are played between two changes at least."""

NEAREST: Final = 0.6
"""Seconds that a change leads away at least, in its own background: less would be a stutter."""

FEWEST_WAYS: Final = 8
"""Different changes (`WAY_SIZE` apart) that a walk needs, lest it be a loop."""

WAY_SIZE: Final = 0.2
"""Seconds: changes that leave and enter within so much of each other are one way."""

DISCOUNT: Final = 0.9
"""How much of a change's cost counts a second earlier, when it is asked where a way leads."""

SPREAD: Final = 0.35
"""Spread of the draw: a change that costs so much more is 2.7 times as rare."""

MOST_ROUNDS: Final = 1000
"""Rounds in which the costs of what must follow settle; some tens do."""

SHOWN_COST: Final = 1.0
"""Cost of going where everything was shown just now, or the way that was taken just now."""

FORGOTTEN: Final = 12.0
"""Seconds after which that has fallen to a third."""

SKIPPED_COST: Final = 1.0
"""Cost of a second of a background that its first showing leaves out."""

FIRST_PART: Final = 0.6
"""Share of a background that is shown at least before it is left for the first time."""


@dataclass(frozen=True)
class Step:
    """What is shown at one step, frames numbered as in `Material`.

    Parameters
    ----------
    frame : int
    other : int
        Frame it is blended with; the same where it is not.
    weight : float
        Share of the other.
    """

    frame: int
    other: int
    weight: float = 0.0


@dataclass(frozen=True)
class Ways:
    """The changes that a walk may make.

    Parameters
    ----------
    cost : (n, n) float64
        Of each change, infinite where it is not to be used.
    ahead : (n,) float64
        Cost of what must follow, from each frame on; infinite where nothing leads on.
    blend : int
        Frames of a change.
    """

    cost: FloatArray
    ahead: FloatArray
    blend: int

    @property
    def endless(self) -> bool:
        """Whether they lead on from the first frame without end."""
        return bool(np.isfinite(self.ahead[0]))


def find_ways(material: Material, likeness: Likeness, limit: float = LIMIT) -> Ways:
    """Choose the changes that are good enough, far enough and lead on.

    Parameters
    ----------
    material : Material
    likeness : Likeness
    limit : float
        Greatest cost.
    """
    n, blend = len(material), likeness.blend
    cost = likeness.cost.astype(np.float64)
    cost[cost > limit] = np.inf
    here = np.arange(n)
    away = np.abs(here[:, None] + 1 - here[None])
    same = material.part[:, None] == material.part[None]
    cost[same & (away < NEAREST * material.fps)] = np.inf
    # No frame may be entered from which the next change cannot be reached.
    step = DISCOUNT ** (1 / material.fps)
    ahead = np.zeros(n)
    entered = np.minimum(here + blend, material.ends - 1)
    for _ in range(MOST_ROUNDS):
        leaving = (cost + step ** (blend + 1) * ahead[entered][None]).min(axis=1)
        found = _soonest(leaving, material, step)
        known = np.isfinite(found)
        same_ones = np.array_equal(known, np.isfinite(ahead))
        settled = same_ones and np.allclose(found[known], ahead[known], atol=1e-3)
        ahead = found
        if settled:
            break
    cost[:, ~np.isfinite(ahead[entered])] = np.inf
    return Ways(cost, ahead, blend)


def _soonest(leaving: FloatArray, material: Material, step: float) -> FloatArray:
    """Cheapest change at each frame or a later one of its background, later ones discounted."""
    out = np.empty_like(leaving)
    for k in range(len(material.parts)):
        mine = np.flatnonzero(material.part == k)
        powers = step ** np.arange(len(mine), dtype=np.float64)
        out[mine] = np.minimum.accumulate((powers * leaving[mine])[::-1])[::-1] / powers
    return out


def enough(material: Material, ways: Ways) -> bool:
    """Whether there are so many different ways that a walk over them is no loop."""
    if not ways.endless:
        return False
    size = max(1.0, WAY_SIZE * material.fps)
    leave, enter = np.nonzero(np.isfinite(ways.cost))
    different = np.unique(np.stack([leave, enter], axis=1) // size, axis=0)
    return len(different) >= FEWEST_WAYS


def walk(
    material: Material, likeness: Likeness, ways: Ways, seed: int, *, free: bool
) -> Iterator[Step]:
    """Walk over backgrounds without end; the same for the same seed.

    Parameters
    ----------
    material : Material
    likeness : Likeness
    ways : Ways
    seed : int
    free : bool
        Whether there are `enough` ways; if not, the last background is played forth and back.

    Yields
    ------
    Step
    """
    chooser = _Chooser(material, likeness, ways, np.random.default_rng(seed))
    weights = blend_weights(ways.blend)
    at = now = 0
    for visit in itertools.count(1):
        if visit < len(material.parts):
            leave, enter = chooser.join(at, visit)
        elif not free:
            first = int(np.flatnonzero(material.part == material.part[at])[0])
            yield from forth_and_back(first, int(material.ends[at]), at)
        elif visit == len(material.parts):
            leave, enter = chooser.join(at, None)
        else:
            leave, enter = chooser.next_change(at, now)
        for frame in range(at, leave + 1):
            yield Step(frame, frame)
        chooser.saw(at, leave, enter, now)
        for k, weight in enumerate(weights):
            yield Step(leave + 1 + k, enter + k, float(weight))
        now += leave + 1 - at + ways.blend
        at = enter + ways.blend


def forth_and_back(first: int, end: int, at: int) -> Iterator[Step]:
    """Play forwards, backwards and so on; no frame is shown twice for turning.

    Parameters
    ----------
    first, end : int
        The frames: from the first to before the end.
    at : int
        The one to begin with, forwards.
    """
    n = end - first
    period = max(2 * (n - 1), 1)
    for step in itertools.count(at - first):
        frame = first + (min(step % period, period - step % period) if n > 1 else 0)
        yield Step(frame, frame)


class _Chooser:
    """Draws where to leave and where to go on, remembering what was shown."""

    def __init__(
        self,
        material: Material,
        likeness: Likeness,
        ways: Ways,
        random: np.random.Generator,
    ) -> None:
        self._material, self._likeness, self._ways = material, likeness, ways
        self._random = random
        n = len(material)
        self._entered = np.minimum(np.arange(n) + ways.blend, material.ends - 1)
        self._shown = np.full(n, -np.inf)  # Step at which each frame was shown last.
        self._taken: list[tuple[int, int, int]] = []  # Frames left and entered of late, and when.
        self._stay = max(1, round(SHORTEST_STAY * material.fps))
        self._forgotten = FORGOTTEN * material.fps

    def saw(self, at: int, leave: int, enter: int, now: int) -> None:
        """Note what is shown from a step on: frames up to `leave`, then a change."""
        self._shown[at : leave + 1] = now + np.arange(leave + 1 - at)
        then = now + leave + 1 - at
        blend = self._ways.blend
        self._shown[enter : enter + blend] = then + np.arange(blend)
        self._taken = [old for old in self._taken if then - old[2] < 3 * self._forgotten]
        self._taken.append((leave, enter, then))

    def join(self, at: int, part: int | None) -> tuple[int, int]:
        """From a background shown for the first time on to a part, or to anywhere.

        As late as possible, as early there as possible, and as alike as possible, whether or not
        there is a way that is good enough.
        """
        material, fps = self._material, self._material.fps
        end = int(material.ends[at])
        rows = np.arange(min(end - 1, at + int(FIRST_PART * (end - at))), end)
        goal = np.arange(len(material)) if part is None else np.flatnonzero(material.part == part)
        if part is None:
            costs = self._costs(rows)
        else:
            costs = self._likeness.cost[np.ix_(rows, goal)].astype(np.float64)
        costs = costs + SKIPPED_COST * (end - 1 - rows)[:, None] / fps
        if part is not None:
            costs = costs + SKIPPED_COST * (goal - goal[0])[None] / fps
        if not np.isfinite(costs).any():
            if part is None:
                return self.next_change(at, 0)
            raise RenderError(
                f"{material.parts[part].path}: too short to be joined to another background; it "
                f"or {material.parts[part - 1].path} has fewer than {self._ways.blend + 2} frames"
            )
        i, j = np.unravel_index(int(np.argmin(costs)), costs.shape)
        return int(rows[i]), int(goal[j])

    def next_change(self, at: int, now: int) -> tuple[int, int]:
        """Draw the next change after frame `at`, which is shown at step `now`."""
        material = self._material
        end = int(material.ends[at])
        rows = np.arange(min(at + self._stay, end - 1), end)
        costs = self._costs(rows)
        if not np.isfinite(costs).any():
            rows = np.arange(at, end)
            costs = self._costs(rows)
        costs = costs + SHOWN_COST * (self._lately(now)[None] + self._as_before(rows, now))
        chance = np.exp(-(costs - costs.min()) / SPREAD).ravel()
        drawn = np.searchsorted(np.cumsum(chance), self._random.random() * chance.sum())
        i, j = divmod(min(int(drawn), chance.size - 1), costs.shape[1])
        return int(rows[i]), j

    def _costs(self, rows: IntArray) -> FloatArray:
        """Of leaving after these frames into each frame, with what must follow."""
        return np.asarray(self._ways.cost[rows] + self._ways.ahead[self._entered][None])

    def _lately(self, now: int) -> FloatArray:
        """How lately was shown what follows each frame when it is entered: 1 just now, (n,)."""
        recent = np.exp((self._shown - now) / self._forgotten)
        summed = np.concatenate([[0.0], np.cumsum(recent)])
        stop = np.minimum(self._entered + self._stay, self._material.ends)
        count = np.maximum(stop - self._entered, 1)
        return np.asarray((summed[stop] - summed[self._entered]) / count)

    def _as_before(self, rows: IntArray, now: int) -> FloatArray:
        """How lately a change like this one was made, (rows, n)."""
        if not self._taken:
            return np.zeros((len(rows), len(self._material)))
        left, entered, when = np.array(self._taken).T
        here = np.arange(len(self._material))
        leaving = np.exp(-0.5 * ((rows[:, None] - left[None]) / self._stay) ** 2)
        entering = np.exp(-0.5 * ((here[:, None] - entered[None]) / self._stay) ** 2)
        return np.asarray((leaving * np.exp((when - now) / self._forgotten)) @ entering.T)
