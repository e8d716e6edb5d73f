"""Head motion from image gradients over the mask (paper, section 4.1).

A frame's pose is the one at which the mask's rigid surface, textured by other frames of the same
footage, looks like the frame: feature points jitter, thousands of pixels together do not. The
texture first comes from a key frame, then from all frames that were aligned with it, so that
neither one frame's noise nor drift remains; a head that turns away gets a key view of its own at
every `key_angle`, and comes back to the old ones. Feature points say where to start and whether
the result can be true. Nothing is smoothed over time.

Gradients know motion only. Where the mask sits on the face is told once a clip, alike for all its
frames: by poses that are known, else by a reference (the person's texture, the same for all
clips, so that the mouths of two clips fall on the same place), else by the feature points' mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.gradient_kernels import fit_pose
from analysis.motion import GradientSettings
from analysis.photometric import Surface, rigid_surface
from analysis.reference import Reference
from analysis.rigid import Matrix, angle, direction, joined, most_usual, usual_step
from analysis.surface_texture import (
    KeyView,
    Levels,
    Single,
    picture_levels,
    plain_light,
    texture_seen,
    view_of_frame,
    view_of_many,
)
from database.mask import OUTER_EYE_CORNERS, Mask

FacePicture = tuple[npt.NDArray[np.uint8], Matrix]
"""A grey picture of the face and its camera, from `analysis.surface_texture.face_picture`."""

LEAST_NOISE: Final = 0.5
"""Least standard deviation of residuals, in standard deviations of the texture."""

LANDMARKS: Final = (*OUTER_EYE_CORNERS, 1, 9, 133, 362, 2)
"""Mesh points at which two poses are compared."""

ANCHOR_FRAMES: Final = 16
"""Frames of a clip that are compared with the reference."""


@dataclass(frozen=True)
class Followed:
    """Head motion of n frames.

    Parameters
    ----------
    poses : (n, 3, 4) float64
    lost : (n,) bool
        Where gradients did not find the face: the pose is the feature points', moved on the face
        as those of the other frames are.
    likeness : (n,) float32
        Correlation of the frame with the texture at its pose.
    """

    poses: Matrix
    lost: npt.NDArray[np.bool_]
    likeness: Single


@dataclass(frozen=True)
class _Fit:
    """One frame's alignment."""

    pose: Matrix
    light: Matrix
    found: bool
    likeness: float


class GradientTracker:
    """Follows the head through the frames of one clip, block by block.

    Parameters
    ----------
    mask : Mask
    settings : GradientSettings, optional
    reference : Reference, optional
        Of the person.
    surface : Surface, optional
        Points to use instead of the whole rigid surface.
    """

    def __init__(
        self,
        mask: Mask,
        settings: GradientSettings | None = None,
        reference: Reference | None = None,
        surface: Surface | None = None,
    ) -> None:
        self.settings = settings or GradientSettings()
        self._model = mask.vertices[list(LANDMARKS)].astype(np.float64)
        self._mask = mask
        self._reference = reference
        self._surface = surface
        self._views: list[KeyView] = []

    @property
    def reference(self) -> Reference:
        """What was learnt from the frames followed so far."""
        return Reference(tuple(self._views))

    def follow(
        self,
        pictures: Sequence[FacePicture],
        starts: Matrix,
        trusted: npt.NDArray[np.bool_],
        known: Mapping[int, Matrix] | None = None,
    ) -> Followed:
        """Head motion of an unbroken run of frames.

        Parameters
        ----------
        pictures : sequence of n FacePicture
        starts : (n, 3, 4) float64
            Poses by feature points.
        trusted : (n,) bool
            Where these fit the face: somewhere, in the first run.
        known : mapping of int to (3, 4) float64, optional
            Poses that are known, by place in the run.
        """
        given = dict(known or {})
        shown = [picture_levels(*picture, self.settings.blur) for picture in pictures]
        surface = self._sampled(pictures, starts[trusted])
        anchored = len(self._views)
        first = 0
        if not anchored:
            usable = np.flatnonzero(trusted)
            first = next(iter(given), int(usable[most_usual(starts[trusted])]))
            pose = given.get(first, starts[first])
            self._views.append(view_of_frame(surface, shown[first], pose, plain_light()))
        fits: dict[int, _Fit] = {}
        for i in [*range(first, len(pictures)), *range(first - 1, -1, -1)]:
            near = fits.get(i - 1 if i > first else i + 1)
            fits[i] = self._aligned(shown[i], starts[i], bool(trusted[i]), near, coarse=True)
            self._turn_to(fits[i], surface, shown[i])
        done = [fits[i] for i in range(len(pictures))]
        if not anchored:
            done = self._anchored(done, shown, starts, trusted, given)
        if len(self._views) > anchored:
            for _ in range(self.settings.passes):
                self._learn(surface, shown, done, anchored)
                done = [
                    self._aligned(levels, starts[i], bool(trusted[i]), done[i], coarse=False)
                    for i, levels in enumerate(shown)
                ]
        if given and not anchored:
            # The key frame alone was noisier than the mean texture is.
            done = self._anchored(done, shown, starts, trusted, given)
        lost = np.array([not fit.found for fit in done])
        poses = np.where(lost[:, None, None], starts, np.stack([fit.pose for fit in done]))
        both = trusted & ~lost
        if both.any():
            # Feature points put the mask elsewhere on the face; frames beside would jump.
            step = usual_step(starts[both], poses[both])
            for i in np.flatnonzero(lost & trusted):
                poses[i] = joined(starts[i], step)
        return Followed(poses, lost, np.array([fit.likeness for fit in done], np.float32))

    def _sampled(self, pictures: Sequence[FacePicture], poses: Matrix) -> Surface:
        """The surface at a spacing that suits the pictures: the same for all blocks of a clip."""
        if self._surface is None:
            focal = np.median([camera[0] for _, camera in pictures])
            pixels_per_mm = float(focal / np.median(poses[:, 2, 3]))
            spacing = max(self.settings.spacing / pixels_per_mm, self.settings.least_spacing)
            self._surface = rigid_surface(self._mask, spacing)
        return self._surface

    def _turn_to(self, fit: _Fit, surface: Surface, shown: Levels) -> None:
        """Make a frame that is far from all key views one of them."""
        if not fit.found:
            return
        apart = min(angle(view.direction, direction(fit.pose)) for view in self._views)
        if apart > np.radians(self.settings.key_angle):
            self._views.append(view_of_frame(surface, shown, fit.pose, fit.light))

    def _aligned(
        self, levels: Levels, start: Matrix, trusted: bool, near: _Fit | None, coarse: bool
    ) -> _Fit:
        """Align one frame, from the feature points, from the frame beside, or once more.

        Parameters
        ----------
        levels : Levels
        start : (3, 4) float64
            The feature points' pose.
        trusted : bool
            Whether that one fits.
        near : _Fit, optional
            Of the frame beside, or of this one.
        coarse : bool
            Whether to begin at half size; else `near` is tried first, at full size only.
        """
        places = [start] if trusted else []
        if near is not None and near.found:
            places.insert(len(places) if coarse else 0, near.pose)
        light = plain_light() if near is None else near.light
        best = _Fit(start, light, False, 0.0)
        for k, place in enumerate(places):
            fit = self._fitted(self._views, levels, place, light, coarse or k > 0)
            if fit.found and (not trusted or self._agrees(fit.pose, start)):
                return fit
            if fit.likeness > best.likeness:
                best = _Fit(fit.pose, light, False, fit.likeness)
        return best

    def _fitted(
        self, views: Sequence[KeyView], levels: Levels, place: Matrix, light: Matrix, coarse: bool
    ) -> _Fit:
        chosen = self.settings
        pose, lit, report = np.array(place, order="C"), light.copy(), np.zeros(3)
        for level in (1, 0) if coarse else (0,):
            reach = 1.5 * np.radians(chosen.key_angle)
            texture = texture_seen(views, pose, level, reach)
            if coarse and level == 0:
                texture = texture.thinned
            grey, camera = levels[level]
            steps = fit_pose(
                grey,
                camera,
                pose,
                texture.points,
                texture.region,
                texture.place,
                texture.values,
                texture.curvature,
                texture.gradient,
                texture.certainty,
                lit,
                LEAST_NOISE,
                chosen.steps,
                chosen.enough * (10 if level else 4 if coarse else 1),
                report,
            )
            if steps < 0 or not np.isfinite(pose).all() or pose[2, 3] <= 0:
                return _Fit(place, light, False, 0.0)
        _, kept, likeness = report.tolist()
        found = likeness >= chosen.least_likeness and kept >= chosen.least_kept
        return _Fit(pose, lit if found else light, found, likeness)

    def _agrees(self, a: Matrix, b: Matrix) -> bool:
        """Whether two poses put the face on the same place, roughly."""
        one, two = (self._model @ p[:, :3].T + p[:, 3] for p in (a, b))
        if min(one[:, 2].min(), two[:, 2].min()) <= 0:
            return False
        apart = one[:, :2] / one[:, 2:] - two[:, :2] / two[:, 2:]
        eyes = two[0, :2] / two[0, 2] - two[1, :2] / two[1, 2]
        dissent = np.median(np.hypot(apart[:, 0], apart[:, 1])) / max(np.hypot(*eyes), 1e-6)
        return bool(dissent <= self.settings.largest_dissent)

    def _anchored(
        self,
        fits: list[_Fit],
        shown: Sequence[Levels],
        starts: Matrix,
        trusted: npt.NDArray[np.bool_],
        known: Mapping[int, Matrix],
    ) -> list[_Fit]:
        """Move the mask on the face, alike in all frames, to where it belongs."""
        found = [i for i, fit in enumerate(fits) if fit.found]
        wanted = {i: known[i] for i in found if i in known}
        if not wanted:
            wanted = {i: starts[i] for i in found if trusted[i]}
            wanted = self._by_reference(fits, shown, wanted) or wanted
        if not wanted:
            return fits
        offset = usual_step(np.stack([fits[i].pose for i in wanted]), np.stack([*wanted.values()]))
        self._views = [KeyView(v.direction @ offset[:, :3], v.levels) for v in self._views]
        return [
            _Fit(joined(f.pose, offset), f.light, True, f.likeness) if f.found else f for f in fits
        ]

    def _by_reference(
        self, fits: list[_Fit], shown: Sequence[Levels], by_points: Mapping[int, Matrix]
    ) -> dict[int, Matrix]:
        """Poses of some frames at which they look like the reference; none if they do not."""
        if self._reference is None or not by_points:
            return {}
        frames = list(by_points)
        offset = usual_step(
            np.stack([fits[i].pose for i in frames]), np.stack([by_points[i] for i in frames])
        )
        places = {i: joined(fits[i].pose, offset) for i in frames}
        views = np.stack([view.direction for view in self._reference.views])
        # Frames seen as the reference was: elsewhere the mask's faults count more.
        frames.sort(key=lambda i: -float((views @ direction(places[i])).max()))
        chosen = frames[:ANCHOR_FRAMES]
        out = {}
        for i in chosen:
            start = places[i]
            fit = self._fitted(self._reference.views, shown[i], start, plain_light(), True)
            fit = self._fitted(self._reference.views, shown[i], fit.pose, fit.light, False)
            if fit.found and self._agrees(fit.pose, by_points[i]):
                out[i] = fit.pose
        return out if 2 * len(out) > len(chosen) else {}

    def _learn(
        self, surface: Surface, shown: Sequence[Levels], fits: list[_Fit], since: int
    ) -> None:
        """Textures of the views from `since` on anew, each from the frames that are near it."""
        found = [i for i, fit in enumerate(fits) if fit.found]
        if not found:
            return
        seen = np.stack([direction(fits[i].pose) for i in found])
        nearest = np.argmax(seen @ np.stack([v.direction for v in self._views]).T, axis=1)
        for k in range(since, len(self._views)):
            mine = [i for i, at in zip(found, nearest, strict=True) if at == k]
            if len(mine) < 3:
                continue
            spread = np.linspace(0, len(mine) - 1, min(len(mine), self.settings.learnt_from))
            mine = [mine[j] for j in spread.astype(int)]
            self._views[k] = view_of_many(
                surface,
                self._views[k].direction,
                [shown[i] for i in mine],
                [fits[i].pose for i in mine],
                [fits[i].light for i in mine],
            )
