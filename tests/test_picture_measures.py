"""Each measure of the stitching near 1 on a sound picture, and off on one spoiled on purpose."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from database.errors import RenderError
from database.media import probe, read_video
from database.planes import Colour, Planes, rgb_to_planes
from database.reader import open_database
from render.background import Background
from render.blend import SOLID, blend_alpha
from render.picture_measures import (
    band_mismatch,
    changed_outside,
    flicker,
    picture_scores,
    seam_gradient,
    sharpness,
    still_region,
)
from render.scene import Scene
from unitsel.synthesizer import Synthesizer


def ellipse(height: int, width: int, fade: float = 14.0) -> np.ndarray:
    x = np.abs(np.arange(width) - (width - 1) / 2)[None, :] / (width / 2 - 3)
    y = np.abs(np.arange(height) - (height - 1) / 2)[:, None] / (height / 2 - 3)
    t = np.clip((1 - np.hypot(x, y)) * min(height, width) / 2 / fade, 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


@pytest.fixture
def face(portrait: np.ndarray) -> np.ndarray:
    """Luma of a real mouth and the skin around it, about 100 x 100."""
    grey = cv2.cvtColor(portrait, cv2.COLOR_RGB2GRAY)[225:345, 205:331]
    return cv2.resize(grey, (106, 100), interpolation=cv2.INTER_AREA).astype(np.float32)


def noisy(luma: np.ndarray, levels: float, seed: int) -> np.ndarray:
    return luma + np.random.default_rng(seed).normal(0, levels, luma.shape).astype(np.float32)


def test_a_pasted_box_and_an_edge_without_fade_raise_the_seam(face: np.ndarray) -> None:
    alpha = ellipse(*face.shape)
    real = seam_gradient(face, alpha)
    assert seam_gradient(noisy(face, 1.0, 0), alpha) / real == pytest.approx(1, abs=0.1)
    lighter = face + 30
    box = np.zeros_like(alpha)
    box[8:-8, 8:-8] = 1
    pasted = face * (1 - box) + lighter * box
    assert seam_gradient(pasted, box) / seam_gradient(face, box) > 1.2
    cut = (alpha > 0.5).astype(np.float32)
    assert seam_gradient(face * (1 - cut) + lighter * cut, alpha) / real > 1.1
    # The same difference faded, or taken out, hardly shows.
    faded = seam_gradient(face * (1 - alpha) + (face + 4) * alpha, alpha)
    assert faded / real < 1.1
    with pytest.raises(RenderError, match="fade nowhere"):
        seam_gradient(face, np.ones_like(alpha))
    with pytest.raises(RenderError, match="does not fit"):
        seam_gradient(face[1:], alpha)


def test_blur_lowers_sharpness_and_noise_raises_it(face: np.ndarray) -> None:
    region = ellipse(*face.shape) >= SOLID
    real = sharpness(noisy(face, 1.0, 0), region)
    assert sharpness(noisy(face, 1.0, 1), region) / real == pytest.approx(1, abs=0.1)
    assert sharpness(cv2.GaussianBlur(noisy(face, 1.0, 1), (0, 0), 0.7), region) / real < 0.8
    assert sharpness(noisy(face, 4.0, 2), region) / real > 1.2
    with pytest.raises(RenderError, match="empty"):
        sharpness(face, np.zeros_like(region))


def test_light_that_jumps_flickers_and_noise_does_not(face: np.ndarray) -> None:
    region = np.zeros(face.shape, bool)
    region[:30] = True
    sway = [face + 2 * np.sin(i / 4) for i in range(30)]
    real = flicker([noisy(luma, 1.5, i) for i, luma in enumerate(sway)], region, 1.0)
    again = flicker([noisy(luma, 1.5, 99 + i) for i, luma in enumerate(sway)], region, 1.0)
    assert again / real == pytest.approx(1, abs=0.1)
    gains = np.random.default_rng(5).normal(0, 1.5, 30)
    jumping = [noisy(luma + g, 1.5, i) for i, (luma, g) in enumerate(zip(sway, gains, strict=True))]
    assert flicker(jumping, region, 1.0) / real > 2
    with pytest.raises(RenderError, match="at least 3"):
        flicker(sway[:2], region, 1.0)
    with pytest.raises(RenderError, match="empty"):
        flicker(sway, np.zeros_like(region), 1.0)


def test_light_left_in_the_band_is_its_mismatch(face: np.ndarray) -> None:
    alpha = ellipse(*face.shape)
    rgb = np.repeat(face[..., None], 3, axis=2)
    assert band_mismatch(rgb, rgb, alpha) == 0
    assert band_mismatch(rgb + 6, rgb, alpha) == pytest.approx(6, abs=1e-3)
    # What differs inside, where nothing of the other is seen, is no matter.
    other = rgb.copy()
    other[alpha >= SOLID] += 90
    inner = cv2.erode((alpha >= SOLID).astype(np.uint8), np.ones((7, 7))) > 0
    other = np.where(inner[..., None], other, rgb)
    assert band_mismatch(other, rgb, alpha) < 3


def test_every_sample_that_changed_outside_is_counted() -> None:
    rng = np.random.default_rng(2)
    planes = rgb_to_planes(rng.integers(0, 256, (40, 60, 3), dtype=np.uint8), Colour())
    alpha = np.ones((10, 12), np.float32)
    y, u, v = planes.y.copy(), planes.u.copy(), planes.v.copy()
    y[4:14, 6:18] += 9
    u[2:7, 3:9] += 9
    assert changed_outside(Planes(y, u, v), planes, alpha, 6, 4) == 0
    y[3, 6] += 1
    y[30, 50] += 1
    u[7, 3] += 1
    v[0, 0] += 1
    assert changed_outside(Planes(y, u, v), planes, alpha, 6, 4) == 4
    # Chroma under a block of which one pixel is drawn belongs to the region.
    v[:] = planes.v
    thin = alpha.copy()
    thin[:, 0] = 0
    assert changed_outside(Planes(y, u, v), planes, thin, 6, 4) == 3 + 10


def test_drawn_mouths_are_as_sharp_and_as_seamless_as_real_ones(
    puppet: ModuleType, puppet_db: Path
) -> None:
    """The whole way, on the puppet; a spoiled video fails."""
    with open_database(puppet_db) as db:
        synthesizer = Synthesizer(db)
        track = puppet.even_track(puppet.SENTENCES["hopper2"], 0.3, 1.4)[0]
        selection = synthesizer.select(track, exclude_sequences=["hopper2"])
        where = [db.sequences.name.index(name) for name in ("hopper2", "hopper3")]
        real, under = (synthesizer.background(db.sequences.media[i]) for i in where)
        info = probe(under.path)
        camera = db.camera.scaled_to(info.width, info.height)
        alpha = blend_alpha(db.mask)
        region = still_region(db.mask, alpha)
        assert 0.02 < region.mean() < 0.4
        corners = db.mask.patch.to_crop(db.mask.vertices[[61, 291]])
        assert not region[int(corners[:, 1].max()) + 1 :].any()

        def measured(pictures, background: Background):
            posed = [(p, background.poses.matrix(i)) for i, p in enumerate(pictures)]
            return picture_scores(posed, db.mask, camera, alpha, info.colour)

        frames = [f.planes for f in read_video(real.path, real.fps) if f.index >= real.first]
        reference = measured(frames[: len(real)], real)
        made = list(synthesizer.render(selection, background=under))[: len(under)]
        good = measured(made, under).over(reference)
        assert good.seam < 1.1
        assert 0.85 < good.sharpness < 1.15
        assert good.flicker < 1.5
        soft = [Planes(cv2.GaussianBlur(p.y, (0, 0), 0.8), p.u, p.v) for p in made]
        assert measured(soft, under).over(reference).sharpness < 0.8
        # A patch with an edge, too light, and not by the same in each frame.
        patch, boxes = db.mask.patch, []
        grey = np.zeros((patch.crop_height, patch.crop_width, 3), np.uint8)
        with Scene(info.width, info.height, patch, camera, alpha) as scene:
            for i, p in enumerate(made):
                layer = scene.draw(grey, under.poses.matrix(i))
                whole = np.zeros_like(p.y)
                h, w = layer.alpha.shape
                whole[layer.y0 : layer.y0 + h, layer.x0 : layer.x0 + w] = layer.alpha > 0.5
                boxes.append(Planes(cv2.add(p.y, (50 if i % 2 else 40) * whole), p.u, p.v))
        spoiled = measured(boxes, under).over(reference)
        assert spoiled.seam > 1.1
        assert spoiled.flicker > 2
        with pytest.raises(RenderError, match="at least 3"):
            measured(made[:2], under)
