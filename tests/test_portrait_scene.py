"""What is drawn of a portrait: itself at rest, teeth where teeth belong, eyes that shut."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from database.errors import RenderError
from database.heads import open_portrait
from database.portrait_file import PortraitHead
from database.portrait_mesh import (
    CHIN,
    INNER_LIPS,
    LEFT_EYE,
    LOWER_INNER,
    LOWER_OUTER,
    N_MASK,
    RIGHT_EYE,
    UPPER_INNER,
)
from render.portrait_scene import PortraitScene
from unitsel.portrait.keyframes import JAWS, MOUTH_FRAMES, NAMES


@pytest.fixture(scope="module")
def head(portrait_head: Path) -> Iterator[PortraitHead]:
    with open_portrait(portrait_head) as opened:
        yield opened


@pytest.fixture(scope="module")
def scene(head: PortraitHead) -> Iterator[PortraitScene]:
    with PortraitScene(head.photo, head.mask, head.mouth) as made:
        yield made


def inside(head: PortraitHead, vertices: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Pixels inside an outline, (n, 3)."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.rint(vertices).astype(np.int32)], 1)
    return picture[cv2.erode(mask, np.ones((3, 3), np.uint8)) > 0].astype(float)


def moved(head: PortraitHead, displacements: np.ndarray) -> np.ndarray:
    return head.mask.vertices + head.mask.to_pixels(displacements)


def test_at_rest_it_is_the_photo_to_the_bit(scene: PortraitScene, head: PortraitHead) -> None:
    np.testing.assert_array_equal(scene.picture(np.zeros((N_MASK, 2))), head.photo)


def test_a_head_that_is_shifted_is_as_sharp_as_before(
    scene: PortraitScene, head: PortraitHead
) -> None:
    face = np.s_[150:330, 190:340]
    sharp = np.abs(np.diff(head.photo[face].astype(float), axis=1)).mean()
    for part in (0.25, 0.5):
        shift = np.tile([part / head.mask.unit, 0.0], (N_MASK, 1))
        drawn = scene.picture(shift)[face].astype(float)
        assert np.abs(np.diff(drawn, axis=1)).mean() > 0.85 * sharp


def test_what_does_not_move_stays(scene: PortraitScene, head: PortraitHead) -> None:
    shape = MOUTH_FRAMES[NAMES.index("wide open")] if "wide open" in NAMES else MOUTH_FRAMES[2]
    drawn = scene.picture(shape, 0.15)
    top = int(head.mask.vertices[LEFT_EYE, 1].max()) + 4
    np.testing.assert_array_equal(drawn[:top], head.photo[:top])
    x0, y0, width, height = scene.box
    outside = np.ones(head.photo.shape[:2], bool)
    outside[y0 : y0 + height, x0 : x0 + width] = False
    np.testing.assert_array_equal(drawn[outside], head.photo[outside])


def test_teeth_and_dark_appear_between_parted_lips(
    scene: PortraitScene, head: PortraitHead
) -> None:
    opened = np.zeros((N_MASK, 2))
    opened[LOWER_INNER, 1] = 0.14 * np.sin(np.linspace(0.3, np.pi - 0.3, len(LOWER_INNER)))
    opened[LOWER_OUTER, 1] = 0.12
    opened[CHIN, 1] = 0.12
    opened[UPPER_INNER, 1] = -0.02
    drawn = scene.picture(opened, 0.13)
    mouth = inside(head, moved(head, opened)[INNER_LIPS], drawn)
    brightness = mouth.mean(axis=1)
    teeth = head.mouth.teeth.mean()
    assert np.percentile(brightness, 10) < 0.4 * teeth, "there is no dark"
    assert np.percentile(brightness, 97) > 0.7 * teeth, "there are no teeth"
    # The upper ones hang from the skull: bright above, dark below.
    middle = moved(head, opened)
    x = round(float(middle[UPPER_INNER[3], 0])) + 4
    top, bottom = middle[UPPER_INNER[3], 1], middle[LOWER_INNER[3], 1]
    column = drawn[round(top) + 2 : round(bottom) - 1, x].mean(axis=1)
    assert column[:3].max() > 1.5 * column[len(column) // 2]


def test_the_lower_teeth_go_down_with_the_jaw(scene: PortraitScene, head: PortraitHead) -> None:
    opened = np.zeros((N_MASK, 2))
    opened[LOWER_INNER, 1], opened[LOWER_OUTER, 1] = 0.16, 0.16
    high, low = (scene.picture(opened, jaw).astype(float).mean(axis=2) for jaw in (0.04, 0.3))
    outline = moved(head, opened)[INNER_LIPS]
    x = round(float(outline[:, 0].mean())) + 4
    bottom = round(float(outline[:, 1].max())) - 3
    assert high[bottom - 3 : bottom, x].mean() > 1.3 * low[bottom - 3 : bottom, x].mean()


def test_shut_eyes_show_no_eye(head: PortraitHead) -> None:
    """Eyes painted green are not seen when they are shut, and half when half shut."""
    painted = head.photo.copy()
    for eye in (LEFT_EYE, RIGHT_EYE):
        outline = np.rint(head.mask.vertices[eye]).astype(np.int32)
        cv2.fillPoly(painted, [outline], (0, 255, 0))
    shut = head.mask.shut_eyes()

    def green(picture: np.ndarray) -> int:
        red, other, blue = (picture[..., k].astype(int) for k in range(3))
        return int(((other > 150) & (other > 2 * red) & (other > 2 * blue)).sum())

    with PortraitScene(painted, head.mask, head.mouth) as scene:
        seen = [green(scene.picture(part * shut)) for part in (0.0, 0.5, 1.0)]
    # The lids' own edges are painted too.
    assert seen[0] > 200
    assert 0.3 * seen[0] < seen[1] < 0.8 * seen[0]
    assert seen[2] < 0.2 * seen[0]


@pytest.mark.parametrize("shape", range(len(MOUTH_FRAMES)))
def test_no_key_frame_tears_the_skin(head: PortraitHead, shape: int) -> None:
    there = head.mask.vertices + head.mask.to_pixels(MOUTH_FRAMES[shape])
    assert replace(head.mask, vertices=there).folded() == 0
    assert float(JAWS[shape]) >= 0


def test_what_cannot_be_drawn_is_told(scene: PortraitScene, head: PortraitHead) -> None:
    with pytest.raises(RenderError, match="displacements"):
        scene.draw(np.zeros((3, 2)))
    with pytest.raises(RenderError, match="finite"):
        scene.draw(np.full((N_MASK, 2), np.nan))
    with pytest.raises(RenderError, match="the same"):
        PortraitScene(head.photo[:100], head.mask, head.mouth)
    other = PortraitScene(head.photo, head.mask, head.mouth)
    other.release()
    other.release()
    with pytest.raises(RenderError, match="released"):
        other.draw(np.zeros((N_MASK, 2)))
