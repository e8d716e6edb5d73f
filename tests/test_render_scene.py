"""The drawn mouth against the mask's own geometry."""

import cv2
import moderngl
import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from database.errors import RenderError
from database.mask import Camera, MouthPatch, crop_map, cut_crop, project
from render.scene import Scene

CAMERA = Camera.assumed(360, 288)


def curved_patch(width=120, height=128, rows=27, columns=25):
    """60 x 64 mm, bulging towards the camera in its middle."""
    x, y = np.meshgrid(np.linspace(-30, 30, columns), np.linspace(-20, 44, rows))
    z = -20 + 0.012 * x**2 + 0.004 * (y - 12) ** 2
    return MouthPatch(np.stack([x, y, z], axis=-1).astype(np.float32), width, height)


def pose(rx=0.0, ry=0.0, rz=0.0, t=(0.0, 20.0, 900.0)):
    rotation, _ = cv2.Rodrigues(np.array([rx, ry, rz], dtype=float))
    return np.hstack([rotation, np.array(t)[:, None]])


POSES = [
    pose(),
    pose(0.1, -0.2, 0.05, (12.3, 5.6, 850.0)),
    pose(-0.15, 0.3, -0.1, (-20.0, 30.0, 700.0)),
]


def smooth_picture():
    x, y = np.meshgrid(np.arange(360), np.arange(288))
    waves = [128 + 80 * np.sin(x / (9 + 2 * c)) * np.cos(y / (11 - c)) for c in range(3)]
    return np.stack(waves, axis=-1).astype(np.uint8)


def soft_alpha(patch):
    x = np.abs(np.linspace(-1, 1, patch.crop_width))[None, :]
    y = np.abs(np.linspace(-1, 1, patch.crop_height))[:, None]
    t = np.clip((0.95 - np.maximum(x, y)) / 0.25, 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


def over(picture, layer):
    """The layer laid over a picture in RGB, float."""
    out = picture.astype(np.float64)
    h, w = layer.alpha.shape
    part = out[layer.y0 : layer.y0 + h, layer.x0 : layer.x0 + w]
    part *= 1 - layer.alpha[..., None]
    part += layer.premultiplied
    return out


@pytest.mark.parametrize("where", POSES)
@pytest.mark.parametrize(("scale", "worst"), [(1, 1.6), (2.5, 2.6)])
def test_a_cut_crop_drawn_back_gives_the_picture(where, scale, worst):
    patch, picture = curved_patch(round(56 * scale), round(60 * scale)), smooth_picture()
    crop = cut_crop(picture, patch, where, CAMERA)
    with Scene(360, 288, patch, CAMERA, soft_alpha(patch)) as scene:
        layer = scene.draw(crop, where)
    error = np.abs(over(picture, layer) - picture)
    assert layer.alpha.max() == 1
    assert error.max() < worst
    solid = layer.alpha == 1
    box = picture[layer.y0 :, layer.x0 :][: solid.shape[0], : solid.shape[1]]
    assert np.abs(layer.rgb[solid].astype(int) - box[solid]).mean() < 0.5


@pytest.mark.parametrize("where", POSES)
def test_alpha_is_that_of_the_crop_seen_in_the_picture(where):
    """Against the inverse of crop_map, found by interpolating scattered points."""
    patch = curved_patch(56, 60)
    alpha = soft_alpha(patch)
    with Scene(360, 288, patch, CAMERA, alpha) as scene:
        layer = scene.draw(np.zeros((60, 56, 3), np.uint8), where)
    places = crop_map(patch, where, CAMERA).reshape(-1, 2)
    x, y = np.meshgrid(
        layer.x0 + np.arange(layer.alpha.shape[1]), layer.y0 + np.arange(layer.alpha.shape[0])
    )
    expected = LinearNDInterpolator(places, alpha.ravel(), fill_value=0.0)(x, y)
    # The scattered points are interpolated over triangles: that much freedom in steep places.
    assert np.abs(expected - layer.alpha).max() < 0.03
    assert abs((expected - layer.alpha).mean()) < 1e-3


@pytest.mark.parametrize("where", POSES)
@pytest.mark.parametrize("scale", [1, 4])
def test_points_land_where_project_says(where, scale):
    patch = curved_patch(60 * scale, 64 * scale)
    x, y = np.meshgrid(np.arange(patch.crop_width), np.arange(patch.crop_height))
    with Scene(360, 288, patch, CAMERA, np.ones(x.shape, np.float32)) as scene:
        for point in patch.grid[6:22:7, 5:20:7].reshape(-1, 3):
            i, j = patch.to_crop(point)
            dot = 250 * np.exp(-((x - i) ** 2 + (y - j) ** 2) / (2 * (1.6 * scale) ** 2))
            crop = np.repeat(np.rint(dot).astype(np.uint8)[..., None], 3, axis=2)
            layer = scene.draw(crop, where)
            light = layer.premultiplied[..., 1].astype(np.float64)
            light[light < 5] = 0
            gx, gy = np.meshgrid(np.arange(light.shape[1]), np.arange(light.shape[0]))
            centre = np.array([(light * gx).sum(), (light * gy).sum()]) / light.sum()
            expected = project(point, where, CAMERA) - [layer.x0, layer.y0]
            assert np.abs(centre - expected).max() < 0.1


def test_boxes_are_even_and_inside_the_picture():
    patch = curved_patch()
    crop = np.full((128, 120, 3), 90, np.uint8)
    with Scene(360, 288, patch, CAMERA, np.ones((128, 120), np.float32)) as scene:
        for t in [(0, 20, 900), (200, 100, 800), (-215, -130, 900), (3, 1, 333)]:
            layer = scene.draw(crop, pose(0, 0, 0, t))
            h, w = layer.alpha.shape
            assert layer.x0 % 2 == layer.y0 % 2 == h % 2 == w % 2 == 0
            assert layer.x0 >= 0
            assert layer.y0 >= 0
            assert layer.x0 + w <= 360
            assert layer.y0 + h <= 288
            assert h * w > 0
        # Outside the picture there is nothing to draw.
        assert scene.draw(crop, pose(0, 0, 0, (900.0, 0, 900))).alpha.size == 0


def test_nothing_of_an_earlier_frame_remains():
    patch = curved_patch()
    alpha = soft_alpha(patch)
    first = np.full((128, 120, 3), 250, np.uint8)
    second = np.full((128, 120, 3), 10, np.uint8)
    with Scene(360, 288, patch, CAMERA, alpha) as scene:
        scene.draw(first, pose(t=(0, 0, 400)))
        reused = scene.draw(second, POSES[1])
    with Scene(360, 288, patch, CAMERA, alpha) as scene:
        fresh = scene.draw(second, POSES[1])
    assert np.array_equal(reused.premultiplied, fresh.premultiplied)
    assert np.array_equal(reused.alpha, fresh.alpha)
    assert (reused.rgb[reused.alpha > 0.1] == 10).all()


def test_two_scenes_do_not_disturb_each_other():
    patch = curved_patch()
    ones = np.ones((128, 120), np.float32)
    grey = np.full((128, 120, 3), 100, np.uint8)
    small = Camera.assumed(180, 144)
    with Scene(360, 288, patch, CAMERA, ones) as one, Scene(180, 144, patch, small, ones) as two:
        alone = one.draw(grey, POSES[0])
        two.draw(grey // 2, POSES[0])
        again = one.draw(grey, POSES[0])
    assert np.array_equal(alone.premultiplied, again.premultiplied)


def test_what_is_turned_away_is_not_drawn():
    patch = curved_patch()
    grey = np.full((128, 120, 3), 100, np.uint8)
    with Scene(360, 288, patch, CAMERA, np.ones((128, 120), np.float32)) as scene:
        layer = scene.draw(grey, pose(0, np.pi, 0))
    assert layer.alpha.max() == 0


def test_misuse_is_named():
    patch = curved_patch()
    ones = np.ones((128, 120), np.float32)
    with pytest.raises(RenderError, match="zero everywhere"):
        Scene(360, 288, patch, CAMERA, 0 * ones)
    with pytest.raises(RenderError, match="blend weights are 120 x 64"):
        Scene(360, 288, patch, CAMERA, ones[:64])
    with pytest.raises(RenderError, match="scaled_to"):
        Scene(180, 144, patch, CAMERA, ones)
    scene = Scene(360, 288, patch, CAMERA, ones)
    grey = np.full((128, 120, 3), 100, np.uint8)
    with pytest.raises(RenderError, match="shape"):
        scene.draw(grey[:10], POSES[0])
    for bad in (pose(t=(0, 0, -900)), pose(t=(0, 0, np.nan))):
        with pytest.raises(RenderError, match="out of the camera's reach"):
            scene.draw(grey, bad)
    scene.release()
    scene.release()
    with pytest.raises(RenderError, match="released"):
        scene.draw(grey, POSES[0])


def test_without_opengl_the_packages_are_named(monkeypatch):
    # A machine without EGL cannot be had here: its loader's failure is put in its place.
    def fail(**settings):
        raise ImportError("libEGL.so.1 not found")

    monkeypatch.setattr(moderngl, "create_context", fail)
    patch = curved_patch()
    with pytest.raises(RenderError, match="apt-get install libegl1 libgl1-mesa-dri"):
        Scene(360, 288, patch, CAMERA, np.ones((128, 120), np.float32))
