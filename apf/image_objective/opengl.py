"""The same silhouettes and edges by OpenGL off-screen, for comparison (Rymut 2016, 5.3).

Needs moderngl (`pip install psfs-apf[opengl]`) and a driver with EGL, such as Mesa's llvmpipe.
Many hypotheses are drawn at once, as tiles of one frame buffer; each part's depth is that of its
middle, as in the OpenCL renderer, and contours are lines that are drawn after all surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.body.cones import FAR_OUT, outlines
from apf.body.kinematics import posed_cones
from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.shaders import FILL_FRAGMENT, FILL_VERTEX, LINE_FRAGMENT, LINE_VERTEX
from cl import InputError
from psfs.cameras.camera import CameraRig

#: Tiles of the frame buffer: columns and rows, within so many pixels in each direction.
_TILES, _LARGEST = 8, 8192
#: Lengths of the arrays in the shaders.
_MOST_VIEWS, _MOST_PARTS = 64, 256
_CLIP_DISTANCE = 0x3000  # GL_CLIP_DISTANCE0


@dataclass(frozen=True, eq=False)
class Shapes:
    """Posed parts in pictures, one row per picture of T, the views of a hypothesis together.

    pixels: (T, M, 2) float32 vertices, NaN where unseen. parts: (T, P, 4) float32 depth in [0, 1),
    radius px of a disc or 0, its middle.
    """

    pixels: np.ndarray
    parts: np.ndarray


class OpenGLRenderer:
    """Draws `body`, flat (without round ends) or as `mesh`, in the cameras of `rig` by OpenGL.

    Raises InputError where moderngl or EGL is missing.
    """

    def __init__(self, body: BodyModel, rig: CameraRig, mesh: BodyMesh | None = None) -> None:
        if len(rig) > _MOST_VIEWS:
            raise InputError(f"{len(rig)} cameras; expected at most {_MOST_VIEWS} for OpenGL")
        self.body, self.rig, self.mesh = body, rig, mesh
        self._context = egl_context()
        width, height = rig.width, rig.height
        self._columns = max(1, min(_TILES, _LARGEST // width))
        self.n_tiles = self._columns * max(1, min(_TILES, _LARGEST // height))
        self._size = (self._columns * width, self.n_tiles // self._columns * height)
        colour = self._context.texture(self._size, 2)
        depth = self._context.depth_renderbuffer(self._size)
        self._frame = self._context.framebuffer([colour], depth)
        triangles, lines, owners, edged = _flat_shape(body) if mesh is None else _mesh_shape(mesh)
        self._fill = self._program(FILL_VERTEX, FILL_FRAGMENT, 3 * len(triangles))
        self._lines = self._program(LINE_VERTEX, LINE_FRAGMENT, 2 * len(lines))
        self._fill.program["edged"].value = [*edged.astype(int), *[0] * (_MOST_PARTS - len(edged))]
        self._buffers = [self._context.buffer(a.tobytes()) for a in (triangles, lines, owners)]
        n_vertices = triangles[:, :3].max() + 1
        self._pixels = self._context.buffer(reserve=int(self.n_tiles * n_vertices * 8))
        self._parts = self._context.buffer(reserve=self.n_tiles * len(edged) * 16)
        for drawing in (self._fill, self._lines):
            self._set_sizes(drawing.program, n_vertices, len(edged))

    @property
    def name(self) -> str:
        """What renders."""
        return str(self._context.info["GL_RENDERER"])

    def draw(self, poses: np.ndarray) -> np.ndarray:
        """Draw `poses` (N, D) into pictures (N, V, H, W, 2) uint8, as `draw_hypotheses` does."""
        shapes = self.shapes(poses)
        out = []
        for first in range(0, len(shapes.pixels), self.n_tiles):
            count = self.upload(shapes, first)
            self.render(count)
            out.append(self.read(count))
        shape = (len(poses), len(self.rig), self.rig.height, self.rig.width, 2)
        return np.concatenate(out).reshape(shape)

    def shapes(self, poses: np.ndarray) -> Shapes:
        """Return the vertices in all pictures, projected on the host."""
        if self.mesh is None:
            return self._flat_shapes(posed_cones(self.body, poses))
        vertices, middles = self.mesh.posed(self.body, poses)
        pixels, parts = [], []
        for camera in self.rig:
            points, depth = camera.project(vertices)
            seen = (depth > 0) & (np.abs(points) < FAR_OUT).all(-1)
            pixels.append(np.where(seen[..., None], points, np.nan))
            away = np.linalg.norm(middles - camera.centre, axis=-1)
            parts.append(np.stack([away / (1 + away), *[np.zeros_like(away)] * 3], -1))
        return _by_picture(pixels, parts)

    def _flat_shapes(self, cones: np.ndarray) -> Shapes:
        pixels, parts = [], []
        for camera in self.rig:
            corners = outlines(camera, cones)
            ends = np.stack([corners[..., :2, :].mean(-2), corners[..., 2:, :].mean(-2)], -2)
            widths = np.linalg.norm(corners[..., [0, 2], :] - corners[..., [1, 3], :], axis=-1)
            radius = 0.5 * widths.max(-1)
            middle = ends.mean(-2)
            disc = np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1) < radius
            square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * radius[..., None, None]
            corners = np.where(disc[..., None, None], middle[..., None, :] + 1.1 * square, corners)
            pixels.append(corners.reshape(len(cones), -1, 2))
            middles = (cones[..., 0:3] + cones[..., 4:7]) / 2
            away = np.linalg.norm(middles - camera.centre, axis=-1)
            columns = [away / (1 + away), np.where(disc, radius, 0.0), *np.moveaxis(middle, -1, 0)]
            parts.append(np.stack(columns, -1))
        return _by_picture(pixels, parts)

    def upload(self, shapes: Shapes, first: int) -> int:
        """Upload the pictures from `first` on, as many as there are tiles; return their number."""
        pixels = shapes.pixels[first : first + self.n_tiles]
        self._pixels.write(pixels.tobytes())
        self._parts.write(shapes.parts[first : first + self.n_tiles].tobytes())
        for drawing in (self._fill, self._lines):
            drawing.program["first"].value = first % len(self.rig)
        return len(pixels)

    def render(self, count: int) -> None:
        """Draw the `count` pictures that were uploaded last; without waiting."""
        self._write_to(True)
        self._frame.clear()
        self._pixels.bind_to_storage_buffer(0)
        self._parts.bind_to_storage_buffer(1)
        triangles, lines, owners = self._buffers
        owners.bind_to_storage_buffer(3)
        for drawing, shape in ((self._fill, triangles), (self._lines, lines)):
            shape.bind_to_storage_buffer(2)
            drawing.array.render(drawing.mode, vertices=drawing.n_vertices, instances=count)
            self._write_to(False)  # lines leave the number of the part that they cross

    def _write_to(self, numbers: bool) -> None:
        self._frame.color_mask = (numbers, True, True, True)
        self._frame.use()

    def finish(self) -> None:
        """Wait until all is drawn."""
        self._context.finish()

    def read(self, count: int) -> np.ndarray:
        """Read the first `count` pictures (count, H, W, 2) uint8 of the frame buffer."""
        rows, height, width = self._size[1] // self.rig.height, self.rig.height, self.rig.width
        data = np.frombuffer(self._frame.read(components=2, alignment=1), np.uint8)
        tiles = data.reshape(rows, height, self._columns, width, 2).swapaxes(1, 2)
        return tiles.reshape(-1, height, width, 2)[:count]

    def _program(self, vertex: str, fragment: str, n_vertices: int) -> _Drawing:
        program = self._context.program(vertex_shader=vertex, fragment_shader=fragment)
        mode = self._context.TRIANGLES if fragment is FILL_FRAGMENT else self._context.LINES
        return _Drawing(program, self._context.vertex_array(program, []), mode, n_vertices)

    def _set_sizes(self, program: Any, n_vertices: int, n_parts: int) -> None:
        sizes = [(float(w), float(h)) for w, h in (camera.size for camera in self.rig)]
        values = {
            "n_vertices": n_vertices,
            "n_parts": n_parts,
            "columns": self._columns,
            "tile": (float(self.rig.width), float(self.rig.height)),
            "atlas": tuple(map(float, self._size)),
            "n_views": len(self.rig),
            "sizes": sizes + [(0.0, 0.0)] * (_MOST_VIEWS - len(sizes)),
        }
        for name, value in values.items():
            if name in program:
                program[name].value = value


@dataclass(frozen=True, eq=False)
class _Drawing:
    """One pass: its program, its empty vertex array, what it draws and how many vertices."""

    program: Any
    array: Any
    mode: int
    n_vertices: int


def egl_context() -> Any:
    """Make an off-screen OpenGL 4.3 context. Raises InputError that says what is missing."""
    try:
        import moderngl
    except ImportError:
        raise InputError(
            "OpenGL needs moderngl, which is not installed; expected: pip install psfs-apf[opengl]"
        ) from None
    try:
        options: dict[str, Any] = {"standalone": True, "backend": "egl", "require": 430}
        context = moderngl.create_context(**options)
    except Exception as error:  # moderngl raises bare Exceptions
        raise InputError(f"no OpenGL 4.3 by EGL here ({error}); expected a driver") from None
    context.enable(moderngl.DEPTH_TEST)
    context.depth_func = "<="
    for plane in range(4):
        context.enable_direct(_CLIP_DISTANCE + plane)
    return context


def _by_picture(pixels: list[np.ndarray], parts: list[np.ndarray]) -> Shapes:
    """Return the shapes of what was made by view, (N, ...) each."""
    arrays = [np.stack(by_view, 1).astype(np.float32) for by_view in (pixels, parts)]
    return Shapes(*(array.reshape(-1, *array.shape[2:]) for array in arrays))


Shape = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _flat_shape(body: BodyModel) -> Shape:
    """Return triangles (T, 4) of vertices and part, lines (L, 4) of ends and no more, their parts
    (L,), and which parts have edges (P,)."""
    triangles, lines, owners = [], [], []
    edged = np.array([cone.in_images for cone in body.cones])
    for c in range(len(edged)):
        at = 4 * c
        triangles += [(at, at + 1, at + 2, c), (at, at + 2, at + 3, c)]
        if edged[c]:
            lines += [(at + 1, at + 2, -1, -1), (at + 3, at, -1, -1)]
            owners += [c, c]
    return (*(np.array(a, np.int32) for a in (triangles, lines, owners)), edged)  # type: ignore[return-value]


def _mesh_shape(mesh: BodyMesh) -> Shape:
    """Return what `_flat_shape` does, of a mesh; a line's third and fourth vertex are those of the
    faces it is between."""
    lines, owners = mesh.lines()
    drawn = mesh.edged[owners]
    triangles = np.column_stack([mesh.faces, mesh.parts]).astype(np.int32)
    return triangles, lines[drawn], owners[drawn], mesh.edged
