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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from render.background import IntArray, Material
from render.similar_frames import Likeness, blend_weights

FloatArray = npt.NDArray[np.float64]

LIMITS: Final = (1.25, 1.5)
"""Greatest cost of a change (`Likeness.cost`): the first of these that leaves `PLENTY` of ways,
else the last."""

PLENTY: Final = 150
"""Different changes (`WAY_SIZE` apart) among which a walk is varied."""

JOIN_LIMIT: Final = 2.0
"""The same between two backgrounds, which were joined in any case."""

SHORTEST_STAY: Final = 0.8
"""Seconds that are played between two changes at least."""

LONGEST_STAY: Final = 12.0
"""Seconds ahead that the next change is looked for, where there is one so soon."""

NEAREST: Final = 0.6
"""Seconds that a change leads away at least, in its own background: less would be a stutter."""

FEWEST_WAYS: Final = 8
"""Different changes that a walk needs, lest it be a loop."""

WAY_SIZE: Final = 0.2
"""Seconds: changes that leave and enter within so much of each other are one way."""

DISCOUNT: Final = 0.9
"""How much of a change's cost counts a second earlier, when it is asked where a way leads."""

SPREAD: Final = 0.5
"""Spread of the draw: a change that costs so much more is 2.7 times as rare."""

MOST_ROUNDS: Final = 1000
"""Rounds in which the costs of what must follow settle; some tens do."""

SHOWN_COST: Final = 1.5
"""Cost of going where everything was shown just now."""

TAKEN_COST: Final = 3.0
"""Cost of the way that was taken just now: twice the same change shows more than frames do."""

REMEMBERED: Final = 60.0
"""Seconds after which that has fallen to a third."""

HOME_COST: Final = 2.5
"""Cost of staying in a background that has been on for long where there are others."""

FORGOTTEN: Final = 12.0
"""Seconds after which that has fallen to a third."""

SKIPPED_COST: Final = 1.0
"""Cost of a second of a background that its first showing leaves out."""

SEEN_COST: Final = 5.0
"""Cost of what a change between two backgrounds costs beyond the last of `LIMITS`."""

FIRST_PART: Final = 0.6
"""Share of a background that is shown at least, alone or in the blend, before it is left for the
first time."""


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
    blends : tuple of int
        Frames of a change, for each of k lengths.
    entered : (k n,) int64
        Frame that is shown after a change into frame j by the length of number b, at b n + j.
    cost : (n, k n) float32
        Of each change, infinite where it is not to be used; columns as in `entered`.
    ahead : (k n,) float64
        Cost of what must follow after each; infinite where nothing leads on.
    last : bool
        Whether there is one in the last background.
    different : int
        How many there are that leave or enter `WAY_SIZE` apart.
    """

    blends: tuple[int, ...]
    entered: IntArray
    cost: npt.NDArray[np.float32]
    ahead: FloatArray
    last: bool
    different: int

    @property
    def enough(self) -> bool:
        """Whether there are so many that a walk over them is no loop."""
        return self.last and self.different >= FEWEST_WAYS


def find_ways(material: Material, likeness: Sequence[Likeness]) -> Ways:
    """Choose the changes that are good enough, far enough and lead on.

    Parameters
    ----------
    material : Material
    likeness : sequence of Likeness
        One for each length of a blend.
    """
    for limit in LIMITS:
        ways = _ways_within(material, likeness, limit)
        if ways.last and ways.different >= PLENTY:
            break
    return ways


def _ways_within(material: Material, likeness: Sequence[Likeness], most: float) -> Ways:
    """Changes that cost no more than so much."""
    n = len(material)
    here = np.arange(n)
    away = np.abs(here[:, None] + 1 - here[None])
    same = material.part[:, None] == material.part[None]
    unfit = same & (away < NEAREST * material.fps)
    limit = np.where(same, most, JOIN_LIMIT)
    cost = np.concatenate(
        [np.where(unfit | (one.cost > limit), np.float32(np.inf), one.cost) for one in likeness],
        axis=1,
    )
    entered = np.concatenate([np.minimum(here + one.blend, material.ends - 1) for one in likeness])
    # No frame may be entered from which, after a while, the next change cannot be reached.
    stayed = entered + stay_frames(material)
    cost[:, stayed >= material.ends[entered]] = np.inf
    stayed = np.minimum(stayed, material.ends[entered] - 1)
    step = DISCOUNT ** (1 / material.fps)
    ahead = np.zeros(n)
    for _ in range(MOST_ROUNDS):
        after = (step * ahead[stayed][None]).astype(np.float32)
        found = _soonest((cost + after).min(axis=1).astype(np.float64), material, step)
        known = np.isfinite(found)
        same_ones = np.array_equal(known, np.isfinite(ahead))
        settled = same_ones and np.allclose(found[known], ahead[known], atol=1e-3)
        ahead = found
        if settled:
            break
    cost[:, ~np.isfinite(ahead[stayed])] = np.inf
    last = bool(np.isfinite(cost[material.part == material.part[-1]]).any())
    leave, column = np.nonzero(np.isfinite(cost))
    size = max(1.0, WAY_SIZE * material.fps)
    cells = np.zeros((int(n / size) + 1, int(n / size) + 1), dtype=bool)
    cells[(leave / size).astype(int), (column % n / size).astype(int)] = True
    blends = tuple(one.blend for one in likeness)
    return Ways(blends, entered, cost, ahead[stayed], last, int(cells.sum()))


def stay_frames(material: Material) -> int:
    """Frames that are played between two changes at least."""
    return max(1, round(SHORTEST_STAY * material.fps))


def _soonest(leaving: FloatArray, material: Material, step: float) -> FloatArray:
    """Cheapest change at each frame or a later one of its background, later ones discounted."""
    out = np.empty_like(leaving)
    for k in range(len(material.parts)):
        mine = np.flatnonzero(material.part == k)
        powers = step ** np.arange(len(mine), dtype=np.float64)
        out[mine] = np.minimum.accumulate((powers * leaving[mine])[::-1])[::-1] / powers
    return out


def walk(material: Material, likeness: Sequence[Likeness], ways: Ways, seed: int) -> Iterator[Step]:
    """Walk over backgrounds without end; the same for the same seed.

    Parameters
    ----------
    material : Material
    likeness : sequence of Likeness
    ways : Ways
        Where there are not `enough`, the last background is played forth and back.
    seed : int

    Yields
    ------
    Step
    """
    chooser = _Chooser(material, likeness, ways, np.random.default_rng(seed))
    at = now = 0
    for visit in itertools.count(1):
        if visit < len(material.parts):
            change = chooser.join(at, visit)
        else:
            found = (
                chooser.next_change(at, now, late=visit == len(material.parts))
                if ways.enough
                else None
            )
            if found is None:
                first = int(np.flatnonzero(material.part == material.part[at])[0])
                yield from forth_and_back(first, int(material.ends[at]), at)
                return
            change = found
        for frame in range(at, change.leave + 1):
            yield Step(frame, frame)
        chooser.saw(at, change, now)
        for k, weight in enumerate(blend_weights(change.blend)):
            yield Step(change.leave + 1 + k, change.enter + k, float(weight))
        now += change.leave + 1 - at + change.blend
        at = change.enter + change.blend


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


@dataclass(frozen=True)
class _Change:
    """After frame `leave`, into frame `enter`, over so many frames."""

    leave: int
    enter: int
    blend: int


class _Chooser:
    """Draws where to leave and where to go on, remembering what was shown."""

    def __init__(
        self,
        material: Material,
        likeness: Sequence[Likeness],
        ways: Ways,
        random: np.random.Generator,
    ) -> None:
        self._material, self._ways, self._random = material, ways, random
        self._likeness = np.concatenate([one.cost for one in likeness], axis=1)
        self._shown = np.full(len(material), -np.inf)  # Step at which each frame was shown last.
        self._taken: list[tuple[int, int, int]] = []  # Frames left and entered of late, and when.
        self._home = 0  # Step at which the background that is on was entered.
        self._stay = stay_frames(material)
        self._way = max(1.0, WAY_SIZE * material.fps)
        self._longest_stay = max(self._stay, round(LONGEST_STAY * material.fps))
        self._forgotten = FORGOTTEN * material.fps
        self._remembered = REMEMBERED * material.fps

    def saw(self, at: int, change: _Change, now: int) -> None:
        """Note what is shown from a step on: frames up to a change, then that."""
        self._shown[at : change.leave + 1] = now + np.arange(change.leave + 1 - at)
        then = now + change.leave + 1 - at
        shown = then + np.arange(change.blend)
        self._shown[change.enter : change.enter + change.blend] = shown
        self._taken = [old for old in self._taken if then - old[2] < 3 * self._remembered]
        self._taken.append((change.leave, change.enter, then))
        if self._material.part[change.leave] != self._material.part[change.enter]:
            self._home = then

    def join(self, at: int, part: int) -> _Change:
        """From a background shown for the first time on to the next.

        As late as possible, as early there as possible, and as alike as possible, whether or not
        there is a way that is good enough.
        """
        material, n = self._material, len(self._material)
        rows = self._late(at)
        goal = np.flatnonzero(material.part == part)
        columns = np.flatnonzero(np.isin(np.arange(self._likeness.shape[1]) % n, goal))
        costs = self._likeness[np.ix_(rows, columns)].astype(np.float64)
        costs = costs + SEEN_COST * np.maximum(0, costs - LIMITS[-1])
        costs = costs + SKIPPED_COST * (columns % n - goal[0])[None] / material.fps
        costs = costs + self._skipped(rows, columns)
        if not np.isfinite(costs).any():
            raise RenderError(
                f"{material.parts[part].path}: too short to be joined to another background; it "
                f"or {material.parts[part - 1].path} has fewer than {self._ways.blends[0] + 2} "
                "frames with a face"
            )
        i, j = np.unravel_index(int(np.argmin(costs)), costs.shape)
        return self._change(int(rows[i]), int(columns[j]))

    def next_change(self, at: int, now: int, *, late: bool = False) -> _Change | None:
        """Draw the next change after frame `at`, which is shown at step `now`; None if none is.

        Late, if a background is shown for the first time.
        """
        end = int(self._material.ends[at])
        possible = self._late(at) if late else np.arange(min(at + self._stay, end - 1), end)
        for first in range(0, len(possible), self._longest_stay):
            rows = possible[first : first + self._longest_stay]
            costs = np.asarray(self._ways.cost[rows] + self._ways.ahead[None], dtype=np.float64)
            if np.isfinite(costs).any():
                break
        else:
            return None
        if late:
            costs = costs + self._skipped(rows, np.arange(costs.shape[1])) / SPREAD
        costs = costs + SHOWN_COST * self._lately(now)[None]
        costs = costs + TAKEN_COST * self._as_before(rows, now)
        costs = costs + self._at_home(at, now)[None]
        chance = np.exp(-(costs - costs.min()) / SPREAD).ravel()
        drawn = np.searchsorted(np.cumsum(chance), self._random.random() * chance.sum())
        i, j = divmod(min(int(drawn), chance.size - 1), costs.shape[1])
        return self._change(int(rows[i]), j)

    def _late(self, at: int) -> IntArray:
        """Frames after which a background is left that is shown for the first time."""
        end = int(self._material.ends[at])
        seen = int(FIRST_PART * (end - at)) - self._ways.blends[-1]
        return np.arange(at + max(0, seen), end)

    def _skipped(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Cost of what a background's first showing leaves out at its end, (rows, columns)."""
        blends = np.array(self._ways.blends)[columns // len(self._material)]
        left_out = self._material.ends[rows][:, None] - 1 - rows[:, None] - blends[None]
        return np.asarray(SKIPPED_COST * left_out / self._material.fps, dtype=np.float64)

    def _change(self, leave: int, column: int) -> _Change:
        kind, enter = divmod(column, len(self._material))
        return _Change(leave, enter, self._ways.blends[kind])

    def _lately(self, now: int) -> FloatArray:
        """How lately was shown what follows each way to enter: 1 just now, (k n,)."""
        recent = np.exp((self._shown - now) / self._forgotten)
        summed = np.concatenate([[0.0], np.cumsum(recent)])
        entered = self._ways.entered
        stop = np.minimum(entered + self._stay, self._material.ends[entered])
        return np.asarray((summed[stop] - summed[entered]) / np.maximum(stop - entered, 1))

    def _at_home(self, at: int, now: int) -> FloatArray:
        """Cost of staying in the background that is on, for each way to enter, (k n,)."""
        material = self._material
        stays = material.part[self._ways.entered] == material.part[at]
        length = np.count_nonzero(material.part == material.part[at])
        tired = 1 - np.exp((self._home - now) / (2.0 * length))
        return np.asarray(HOME_COST * tired * stays, dtype=np.float64)

    def _as_before(self, rows: IntArray, now: int) -> FloatArray:
        """How lately a change like this one was made, (rows, k n)."""
        if not self._taken:
            return np.zeros((len(rows), len(self._ways.entered)))
        left, entered, when = np.array(self._taken).T
        here = np.arange(len(self._material))
        leaving = np.exp(-0.5 * ((rows[:, None] - left[None]) / self._way) ** 2)
        entering = np.exp(-0.5 * ((here[:, None] - entered[None]) / self._way) ** 2)
        near = (leaving * np.exp((when - now) / self._remembered)) @ entering.T
        return np.tile(near, len(self._ways.blends))
