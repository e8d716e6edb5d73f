"""The mouth drawn where the head is (OpenGL, no window).

The patch of the mask is drawn as a triangle mesh with the unit's crop for a texture. The
projection is that of `database.mask.project`: a crop pixel's centre (i, j) is at texture
coordinate ((i + 0.5) / width, (j + 0.5) / height), a picture pixel's centre (x, y) is at
(x + 0.5, y + 0.5) of the framebuffer, whose row 0 is the picture's top row. Only the box that the
patch covers is drawn and read back.

Colour and alpha of the texture are sampled apart, as the crop has colour everywhere; what is
written is colour times alpha. Where crop and picture are of like scale, colour is sampled by
bicubic convolution, since bilinear would soften the mouth by an amount that changes with the
head's place between pixels; where the crop is much finer, through mipmaps.
"""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final, Self

import moderngl
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mask import Camera, MouthPatch, project

FloatArray = npt.NDArray[np.float32]

NEAREST_MM: Final = 50.0
"""Millimetres: no part of the face is nearer to the camera."""

FARTHEST_MM: Final = 50_000.0

MIPMAP_FROM: Final = 1.5
"""Crop pixels to a picture pixel from which the texture is minified through mipmaps."""

VERTEX_SHADER: Final = """
#version 330
uniform mat4 projection;
in vec3 position;
in vec2 place;
out vec2 texture_place;
void main() {
    gl_Position = projection * vec4(position, 1.0);
    texture_place = place;
}
"""

FRAGMENT_SHADER: Final = """
#version 330
uniform sampler2D crop;
uniform sampler2D mask_alpha;
uniform bool bicubic;
in vec2 texture_place;
out vec4 colour;

vec4 weights(float f) {
    // Cubic convolution, a = -1/2 (Catmull and Rom).
    float g = 1.0 - f;
    return vec4(-0.5 * f * g * g,
                1.0 + f * f * (1.5 * f - 2.5),
                1.0 + g * g * (1.5 * g - 2.5),
                -0.5 * g * f * f);
}

vec3 cubic(vec2 place) {
    ivec2 last = textureSize(crop, 0) - 1;
    vec2 pixel = place * vec2(textureSize(crop, 0)) - 0.5;
    ivec2 corner = ivec2(floor(pixel));
    vec4 wx = weights(pixel.x - float(corner.x));
    vec4 wy = weights(pixel.y - float(corner.y));
    vec3 sum = vec3(0.0);
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
            sum += wx[i] * wy[j]
                * texelFetch(crop, clamp(corner + ivec2(i - 1, j - 1), ivec2(0), last), 0).rgb;
    return clamp(sum, 0.0, 1.0);
}

void main() {
    // Mipmaps half a level finer than the rule: sharper, and hardly any aliasing in faces.
    float alpha = texture(mask_alpha, texture_place, -0.5).r;
    vec3 rgb = bicubic ? cubic(texture_place) : texture(crop, texture_place, -0.5).rgb;
    colour = vec4(255.0 * alpha * rgb, alpha);
}
"""


@dataclass(frozen=True)
class MouthLayer:
    """The drawn mouth, to be laid over a picture.

    Parameters
    ----------
    x0, y0 : int
        Picture pixel of the layer's first column and row: even, as the layer's sizes are.
    premultiplied : (h, w, 3) float32
        Colour levels (0 to 255) times alpha.
    alpha : (h, w) float32
        0 where the picture stays as it is, 1 where the mouth covers it.
    """

    x0: int
    y0: int
    premultiplied: FloatArray
    alpha: FloatArray

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Colour, (h, w, 3) uint8; black where alpha is zero."""
        colour = self.premultiplied / np.maximum(self.alpha, 1e-6)[..., None]
        return np.clip(np.rint(colour), 0, 255).astype(np.uint8)


class Scene:
    """The mouth patch before a camera; a context manager. Any thread may draw.

    Parameters
    ----------
    width, height : int
        Size of the picture in pixels, even.
    patch : MouthPatch
    camera : Camera
        Of this picture's size.
    alpha : (crop_height, crop_width) float32
        Blend weight of each crop pixel.

    Raises
    ------
    RenderError
        If OpenGL cannot be started, or the sizes do not fit one another.
    """

    def __init__(
        self, width: int, height: int, patch: MouthPatch, camera: Camera, alpha: FloatArray
    ) -> None:
        if alpha.shape != (patch.crop_height, patch.crop_width):
            raise RenderError(
                f"blend weights are {alpha.shape[1]} x {alpha.shape[0]}, "
                f"the crop {patch.crop_width} x {patch.crop_height}"
            )
        if (camera.width, camera.height) != (width, height):
            raise RenderError(
                f"the camera is for {camera.width} x {camera.height}, "
                f"the picture {width} x {height}; use Camera.scaled_to"
            )
        self.width = width
        self.height = height
        self.patch = patch
        self.camera = camera
        vertices, indices = _mesh(patch, alpha)
        self._corners = vertices[np.unique(indices), :3]
        self._lock = threading.Lock()
        self._context = start_opengl()
        self._framebuffer: Any = None
        with self._context as context:
            self._program = context.program(
                vertex_shader=VERTEX_SHADER, fragment_shader=FRAGMENT_SHADER
            )
            self._program["crop"] = 0
            self._program["mask_alpha"] = 1
            self._vertex_buffer = context.buffer(vertices.tobytes())
            self._index_buffer = context.buffer(indices.tobytes())
            self._vertex_array = context.vertex_array(
                self._program,
                [(self._vertex_buffer, "3f 2f", "position", "place")],
                index_buffer=self._index_buffer,
            )
            size = (patch.crop_width, patch.crop_height)
            self._crop = context.texture(size, 3, alignment=1)
            alphas = np.ascontiguousarray(alpha, dtype=np.float32)
            self._alpha = context.texture(size, 1, alphas.tobytes(), dtype="f4")
            self._alpha.build_mipmaps()
            for texture in (self._crop, self._alpha):
                texture.repeat_x = texture.repeat_y = False
            context.enable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give back everything that OpenGL holds; a second call does nothing."""
        with self._lock:
            self._release()

    def _release(self) -> None:
        if self._context is None:
            return
        with self._context:
            self._release_framebuffer()
            for item in (
                *(self._vertex_array, self._vertex_buffer, self._index_buffer),
                *(self._program, self._crop, self._alpha),
            ):
                item.release()
        self._context.release()
        self._context = None

    def draw(self, crop: npt.NDArray[np.uint8], pose: npt.NDArray[np.float64]) -> MouthLayer:
        """Draw a crop with the head at a pose.

        Parameters
        ----------
        crop : (crop_height, crop_width, 3) uint8
            The mouth's texture.
        pose : (3, 4) float64
            ``[R | t]``.

        Returns
        -------
        MouthLayer
            Of size 0 x 0 where the patch lies outside the picture.

        Raises
        ------
        RenderError
            If the crop has another size than the patch's, or the pose is not finite or puts
            the mouth behind the camera.
        """
        if self._context is None:
            raise RenderError("the scene was released; make another to draw more")
        if crop.shape != (self.patch.crop_height, self.patch.crop_width, 3):
            raise RenderError(
                f"the mouth's picture has shape {crop.shape}, the database's crops have "
                f"{(self.patch.crop_height, self.patch.crop_width, 3)}"
            )
        x0, y0, width, height = self._box(pose)
        if width <= 0 or height <= 0:
            return MouthLayer(0, 0, np.zeros((0, 0, 3), np.float32), np.zeros((0, 0), np.float32))
        mipmaps = self.minifies(pose)
        with self._lock, self._context:
            framebuffer = self._framebuffer_for(width, height)
            framebuffer.use()
            framebuffer.viewport = (0, 0, width, height)
            framebuffer.clear(0.0, 0.0, 0.0, 0.0)
            self._crop.write(np.ascontiguousarray(crop).tobytes(), alignment=1)
            if mipmaps:
                self._crop.build_mipmaps()
            smooth = moderngl.LINEAR_MIPMAP_LINEAR if mipmaps else moderngl.LINEAR
            self._crop.filter = self._alpha.filter = (smooth, moderngl.LINEAR)
            self._crop.use(0)
            self._alpha.use(1)
            self._program["bicubic"] = not mipmaps
            matrix = _projection(pose, self.camera, x0, y0, width, height)
            self._program["projection"].write(matrix.T.astype(np.float32).tobytes())
            self._vertex_array.render(moderngl.TRIANGLES)
            data = framebuffer.read((0, 0, width, height), components=4, dtype="f4")
        drawn = np.frombuffer(data, dtype=np.float32).reshape(height, width, 4)
        return MouthLayer(x0, y0, drawn[..., :3], drawn[..., 3])

    def minifies(self, pose: npt.NDArray[np.float64]) -> bool:
        """Whether the crop is so much finer than the picture that mipmaps are used."""
        return self._scale(pose) >= MIPMAP_FROM

    def _box(self, pose: npt.NDArray[np.float64]) -> tuple[int, int, int, int]:
        """Box of the visible patch in the picture: x, y, width, height, all even."""
        depth = self._corners @ pose[2, :3] + pose[2, 3]
        if not np.isfinite(pose).all() or depth.min() < NEAREST_MM or depth.max() > FARTHEST_MM:
            raise RenderError("the head's pose puts the mouth out of the camera's reach")
        points = project(self._corners, pose, self.camera)
        low = np.floor((points.min(axis=0) - 0.5) / 2).astype(int) * 2
        high = np.ceil((points.max(axis=0) + 1.5) / 2).astype(int) * 2
        x0, y0 = np.maximum(low, 0)
        x1, y1 = np.minimum(high, (self.width, self.height))
        return int(x0), int(y0), int(x1 - x0), int(y1 - y0)

    def _scale(self, pose: npt.NDArray[np.float64]) -> float:
        """Crop pixels to a picture pixel, about, in the direction that is shrunk least."""
        grid = self.patch.grid
        points = project(np.stack([grid[0], grid[-1]]), pose, self.camera)
        across = np.linalg.norm(points[0, -1] - points[0, 0]) / self.patch.crop_width
        down = np.linalg.norm(points[1] - points[0], axis=1).mean() / self.patch.crop_height
        return float(1 / max(across, down, 1e-6))

    def _framebuffer_for(self, width: int, height: int) -> Any:
        """A framebuffer at least so large; it only ever grows."""
        if self._framebuffer is not None:
            held_width, held_height = self._framebuffer.size
            if held_width >= width and held_height >= height:
                return self._framebuffer
            width, height = max(width, held_width), max(height, held_height)
            self._release_framebuffer()
        size = (-(-width // 64) * 64, -(-height // 64) * 64)
        self._framebuffer = self._context.framebuffer(
            [self._context.renderbuffer(size, 4, dtype="f4")],
            self._context.depth_renderbuffer(size),
        )
        return self._framebuffer

    def _release_framebuffer(self) -> None:
        if self._framebuffer is not None:
            for attachment in self._framebuffer.color_attachments:
                attachment.release()
            self._framebuffer.depth_attachment.release()
            self._framebuffer.release()
            self._framebuffer = None


def start_opengl() -> Any:
    """A context without a window: through EGL on Linux, else the platform's own.

    Raises
    ------
    RenderError
        If OpenGL 3.3 cannot be started.
    """
    settings: dict[str, Any] = {"standalone": True, "require": 330}
    how, remedy = "", "a driver with OpenGL 3.3 is needed"
    if sys.platform not in ("darwin", "win32"):
        # The default backend wants an X display.
        settings["backend"] = "egl"
        how = "through EGL "
        remedy = "on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
    try:
        return moderngl.create_context(**settings)
    except Exception as error:  # moderngl raises bare Exception, loaders OSError or ImportError.
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RenderError(f"OpenGL cannot be started {how}({why}); {remedy}") from error


def _mesh(patch: MouthPatch, alpha: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int32]]:
    """Vertices with texture places, (n, 5) float32, and triangles where alpha is not zero.

    Triangles run so that their front is towards the camera in a framebuffer whose first row is
    the top one.
    """
    rows, columns = patch.grid.shape[:2]
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    vertices = np.concatenate([patch.grid.reshape(-1, 3), np.stack([u, v], -1).reshape(-1, 2)], 1)
    height, width = alpha.shape
    cells = []
    for row in range(rows - 1):
        # One pixel more on each side, which filtering reaches.
        top = max(int(row / (rows - 1) * height) - 1, 0)
        bottom = int(np.ceil((row + 1) / (rows - 1) * height)) + 1
        for column in range(columns - 1):
            left = max(int(column / (columns - 1) * width) - 1, 0)
            right = int(np.ceil((column + 1) / (columns - 1) * width)) + 1
            if alpha[top:bottom, left:right].any():
                first = row * columns + column
                below = first + columns
                cells.append([first, first + 1, below, first + 1, below + 1, below])
    if not cells:
        raise RenderError("the blend weights are zero everywhere; nothing would be drawn")
    return vertices.astype(np.float32), np.array(cells, dtype=np.int32)


def _projection(
    pose: npt.NDArray[np.float64], camera: Camera, x0: int, y0: int, width: int, height: int
) -> npt.NDArray[np.float64]:
    """(4, 4) from the mask's millimetres to clip space of the box of the picture."""
    to_camera = np.vstack([pose, [0, 0, 0, 1]])
    near, far = NEAREST_MM, FARTHEST_MM
    to_clip = np.zeros((4, 4))
    to_clip[0, 0] = 2 * camera.focal / width
    to_clip[0, 2] = 2 * (camera.cx + 0.5 - x0) / width - 1
    to_clip[1, 1] = 2 * camera.focal / height
    to_clip[1, 2] = 2 * (camera.cy + 0.5 - y0) / height - 1
    to_clip[2, 2] = (far + near) / (far - near)
    to_clip[2, 3] = -2 * far * near / (far - near)
    to_clip[3, 2] = 1
    return np.asarray(to_clip @ to_camera, dtype=np.float64)
