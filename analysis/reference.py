"""A person's rigid surface as a database keeps it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.surface_texture import KeyView, Texture
from database.schema import RIGID_COARSE, RigidTexture


@dataclass(frozen=True)
class Reference:
    """A person's rigid surface as key views show it: where the mask sits on the face.

    Parameters
    ----------
    views : tuple of KeyView
        At least one; all of the same points.
    """

    views: tuple[KeyView, ...]


def to_stored(reference: Reference | None) -> RigidTexture | None:
    """A reference in the database's form."""
    if reference is None:
        return None
    fine = reference.views[0].levels[0]

    def joined(name: str, level: int) -> npt.NDArray[np.float32]:
        return np.stack([getattr(view.levels[level], name) for view in reference.views])

    return RigidTexture(
        fine.points,
        fine.region.astype(np.uint8),
        fine.place,
        np.stack([view.direction for view in reference.views]),
        joined("values", 0),
        joined("curvature", 0),
        joined("gradient", 0),
        joined("certainty", 0),
        joined("values", 1),
        joined("curvature", 1),
        joined("gradient", 1),
        joined("certainty", 1),
    )


def from_stored(rigid: RigidTexture | None) -> Reference | None:
    """The reference that a database keeps."""
    if rigid is None:
        return None
    region = rigid.region.astype(np.int64)
    views = []
    for k, direction in enumerate(rigid.direction):
        fine = Texture(
            rigid.points,
            region,
            rigid.place,
            rigid.values[k],
            rigid.curvature[k],
            rigid.gradient[k],
            rigid.certainty[k],
        )
        coarse = Texture(
            np.ascontiguousarray(rigid.points[::RIGID_COARSE]),
            np.ascontiguousarray(region[::RIGID_COARSE]),
            np.ascontiguousarray(rigid.place[::RIGID_COARSE]),
            rigid.coarse_values[k],
            rigid.coarse_curvature[k],
            rigid.coarse_gradient[k],
            rigid.coarse_certainty[k],
        )
        views.append(KeyView(direction, (fine, coarse)))
    return Reference(tuple(views))
