"""What must be true of a database's content, whether it is about to be written or was just read.

The checks raise `ValueError` naming the field and the fault; the writer and the reader know the
file and turn it into a `DatabaseError`.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.mask import Camera, Mask
from database.phonemes import CLOSURES, N_PHONEMES, SILENCE, VISEME_OF
from database.schema import (
    RIGID_COARSE,
    RIGID_REGIONS,
    CostModel,
    Field,
    GuideModel,
    PhoneMarks,
    Phones,
    RigidTexture,
    Sequences,
    TextureModel,
    UnitLips,
    Units,
)
from database.track import SMALL_GAP

Array = npt.NDArray[Any]


def match_shape(field: Field, shape: tuple[int, ...], sizes: dict[str, int]) -> None:
    """Compare a shape with the field's; sizes met for the first time are noted.

    Parameters
    ----------
    field : Field
        What the shape should be.
    shape : tuple of int
        What it is.
    sizes : dict
        Sizes known so far by name (``N``, ``K``, ...); extended here.

    Raises
    ------
    ValueError
        If the numbers of axes differ, or a size differs from the one fixed or known.
    """
    wanted = " x ".join(str(size) for size in field.shape)
    found = " x ".join(map(str, shape)) or "a single value"
    if len(shape) != len(field.shape):
        raise ValueError(f"{field.path} is {found}, not {wanted}")
    for size, want in zip(shape, field.shape, strict=True):
        if size < 1:
            raise ValueError(f"{field.path} is empty ({found}; it must be {wanted})")
        known = sizes.setdefault(want, size) if isinstance(want, str) else want
        if size != known:
            told = f" with {want} = {known}" if isinstance(want, str) else ""
            raise ValueError(f"{field.path} is {found}, not {wanted}{told}")


def check_finite(path: str, values: Array) -> None:
    """Raise if a value is not finite."""
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        at = np.argwhere(~np.isfinite(values))[0].tolist()
        raise ValueError(f"{path} holds a value that is not finite, at {at}")


def check_fps(fps: float) -> None:
    """Raise if the frame rate is not a positive number."""
    if not (math.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be positive, is {fps!r}")


def _check_below(path: str, values: Array, end: int) -> None:
    bad = (values < 0) | (values >= end)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(f"{path}[{i}] is {values[i]}, outside 0..{end - 1}")


def _check_finite_fields(group: str, part: Any) -> None:
    for f in fields(part):
        value = np.asarray(getattr(part, f.name))
        check_finite(f"{group}/{f.name}", value)


def check_sequences(sequences: Sequences, n_units: int) -> None:
    """Check that the sequences' units follow one another and are all there."""
    _check_finite_fields("sequences", sequences)
    if (sequences.fps <= 0).any():
        raise ValueError("sequences/fps holds a rate that is not positive")
    if (sequences.units < 0).any():
        raise ValueError("sequences/units holds a negative count")
    ends = np.cumsum(sequences.units, dtype=np.int64)
    starts = ends - sequences.units
    wrong = sequences.first_unit != starts
    if wrong.any():
        s = int(np.argmax(wrong))
        raise ValueError(
            f"sequences/first_unit[{s}] is {sequences.first_unit[s]}, but {starts[s]} units "
            "come before it"
        )
    if ends[-1] != n_units:
        raise ValueError(f"sequences/units adds up to {ends[-1]}, not to {n_units} units")
    if (sequences.units > sequences.frames).any():
        s = int(np.argmax(sequences.units > sequences.frames))
        raise ValueError(
            f"sequences/units[{s}] is {sequences.units[s]}, more than its "
            f"{sequences.frames[s]} frames"
        )


def check_units(units: Units, sequences: Sequences) -> None:
    """Check the units' numbers against one another and against their sequences."""
    _check_finite_fields("units", units)
    _check_below("units/sequence", units.sequence, len(sequences))
    _check_below("units/phoneme", units.phoneme, N_PHONEMES)
    expected = np.repeat(np.arange(len(sequences)), sequences.units)
    wrong = units.sequence != expected
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"units/sequence[{i}] is {units.sequence[i]}, but by sequences/first_unit the unit "
            f"is of sequence {expected[i]}"
        )
    wrong = units.viseme != VISEME_OF[units.phoneme]
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(f"units/viseme[{i}] is {units.viseme[i]}, not that of its phoneme")
    inside = (units.frame >= 0) & (units.frame < sequences.frames[units.sequence])
    if not inside.all():
        i = int(np.argmin(inside))
        raise ValueError(f"units/frame[{i}] is {units.frame[i]}, outside its sequence")
    backwards = (np.diff(units.frame) <= 0) & (np.diff(units.sequence) == 0)
    if backwards.any():
        i = int(np.argmax(backwards)) + 1
        raise ValueError(f"units/frame[{i}] is {units.frame[i]}, not after the frame before it")
    for name in ("teeth", "tongue"):
        values = getattr(units, name)
        if values.min() < 0 or values.max() > 1:
            raise ValueError(f"units/{name} must lie in 0..1")


def check_phones(phones: Phones, n_sequences: int) -> None:
    """Check that every sequence has phones, in order, each where the one before it ends."""
    _check_finite_fields("phones", phones)
    _check_below("phones/sequence", phones.sequence, n_sequences)
    _check_below("phones/phoneme", phones.phoneme, N_PHONEMES)
    step = np.diff(phones.sequence)
    missing = np.setdiff1d(np.arange(n_sequences), phones.sequence)
    if (step < 0).any() or len(missing):
        where = f"none for sequence {missing[0]}" if len(missing) else "sequences out of order"
        raise ValueError(f"phones/sequence: {where}")
    if (phones.start < 0).any() or (phones.end <= phones.start).any():
        i = int(np.argmax((phones.start < 0) | (phones.end <= phones.start)))
        raise ValueError(f"phones/end[{i}] is {phones.end[i]:g} s after {phones.start[i]:g} s")
    gaps = (np.abs(phones.start[1:] - phones.end[:-1]) > SMALL_GAP) & (step == 0)
    if gaps.any():
        i = int(np.argmax(gaps)) + 1
        raise ValueError(
            f"phones/start[{i}] is {phones.start[i]:g} s, but the phone before it ends at "
            f"{phones.end[i - 1]:g} s"
        )


def check_marks(marks: PhoneMarks, phones: Phones) -> None:
    """Check that marks are of p, b, m and silences, one a phone, in order, none backwards."""
    _check_finite_fields("marks", marks)
    _check_below("marks/phone", marks.phone, len(phones.phoneme))
    if (np.diff(marks.phone) <= 0).any():
        raise ValueError("marks/phone must ascend")
    if not np.isin(phones.phoneme[marks.phone], [SILENCE, *CLOSURES]).all():
        raise ValueError("marks/phone names a phone that is neither p, b, m nor silence")
    if (marks.start < 0).any() or (marks.end <= marks.start).any():
        raise ValueError("marks/end must be after marks/start, and that not below 0")
    for name in ("sound", "lips"):
        _check_below(f"marks/{name}", getattr(marks, name), 2)
    if not (marks.sound | marks.lips).all():
        raise ValueError("marks/sound and marks/lips: a mark that neither shows")


def check_mask(mask: Mask, camera: Camera) -> None:
    """Check the mask, its patch and the camera."""
    check_finite("mask/vertices", mask.vertices)
    check_finite("mask/grid", mask.patch.grid)
    if min(mask.patch.grid.shape[:2]) < 2:
        raise ValueError("mask/grid must have two rows and two columns at least")
    if min(mask.patch.crop_width, mask.patch.crop_height) < 1:
        raise ValueError("mask/crop_size must be positive")
    numbers = (camera.focal, camera.cx, camera.cy)
    if not all(map(math.isfinite, numbers)) or camera.focal <= 0:
        raise ValueError("camera must be finite, with a positive focal length")
    if min(camera.width, camera.height) < 1:
        raise ValueError("camera must have a positive width and height")


def check_texture(texture: TextureModel) -> None:
    """Check the texture model."""
    _check_finite_fields("texture", texture)
    if (texture.eigenvalues < 0).any():
        raise ValueError("texture/eigenvalues holds a negative variance")


def check_costs(costs: CostModel) -> None:
    """Check the cost model: distances that are none below zero, scales to divide by."""
    _check_finite_fields("costs", costs)
    if (costs.phoneme_distance < 0).any():
        raise ValueError("costs/phoneme_distance holds a negative distance")
    if (costs.feature_scales < 0).any():
        raise ValueError("costs/feature_scales holds a negative scale")
    if costs.target_scale <= 0 or costs.visual_scale <= 0:
        raise ValueError("costs/target_scale and costs/visual_scale must be positive")


def check_rigid(rigid: RigidTexture) -> None:
    """Check the rigid surface's look: regions that exist, a half size that fits the full one."""
    _check_finite_fields("rigid", rigid)
    if (rigid.region >= RIGID_REGIONS).any():
        raise ValueError(f"rigid/region names one beyond the {RIGID_REGIONS} regions")
    if rigid.coarse_values.shape[1] != -(-len(rigid.points) // RIGID_COARSE):
        raise ValueError(f"rigid/coarse_values must hold every {RIGID_COARSE}th point")
    if not len(rigid.direction):
        raise ValueError("rigid/direction must hold a view")
    if (rigid.certainty < 0).any() or (rigid.coarse_certainty < 0).any():
        raise ValueError("rigid/certainty and rigid/coarse_certainty must not be negative")


def check_guide(kind: str, guide: GuideModel) -> None:
    """Check a guide: finite numbers, inputs in order, scales that keep a trajectory's sign."""
    _check_finite_fields(f"guide_{kind}", guide)
    if (guide.columns < 0).any() or (np.diff(guide.columns) <= 0).any():
        raise ValueError(f"guide_{kind}/columns must ascend from 0 on")
    if (guide.scale < 0).any() or (guide.gain < 0).any():
        raise ValueError(f"guide_{kind}/scale and guide_{kind}/gain must not be negative")


def check_sound(steps: npt.NDArray[np.int32], n_steps: int) -> None:
    """Check that the sequences' sounds are all of the sound there is."""
    if (steps < 0).any() or int(steps.sum(dtype=np.int64)) != n_steps:
        raise ValueError(f"sound/steps do not add up to the {n_steps} of sound/features")


def check_starts(starts: npt.NDArray[np.float64]) -> None:
    """Check that clips start inside their media files."""
    check_finite("pieces/start", starts)
    if (starts < 0).any():
        raise ValueError("pieces/start holds a time before 0")


def check_lips(lips: UnitLips) -> None:
    """Check the lip model: numbers to divide by, and no variance below zero."""
    model = lips.model
    for name, values in {"points": lips.points, **model.as_arrays()}.items():
        check_finite(f"lips/{name}", values)
    if min(model.scale, model.energy) <= 0 or model.blur < 0:
        raise ValueError("lips/numbers must be positive")
    if (model.shape_variances < 0).any():
        raise ValueError("lips/shape_variances holds a negative variance")
    _check_below("lips/found", lips.found, 2)
    for i, level in enumerate(model.levels):
        if not (level.region == 1).any() or (level.region > 1).any():
            raise ValueError(f"lips/level{i}/region must be 0 or 1, and not all 0")
        if (level.variances <= 0).any() or (level.noise <= 0).any():
            raise ValueError(f"lips/level{i}: variances and noise must be positive")


LONGEST_CONSENT: Final = 100_000
"""Characters of a consent note: a letter, not a scan of one."""


def check_consent(note: str) -> None:
    """Raise ValueError if a consent note holds nothing that can be read, or too much."""
    if not note.strip():
        raise ValueError("the consent note is empty")
    if len(note) > LONGEST_CONSENT:
        raise ValueError(f"the consent note has {len(note)} characters, over {LONGEST_CONSENT}")
    if any(not c.isprintable() and c not in "\n\t" for c in note):
        raise ValueError("the consent note holds characters that cannot be printed")
