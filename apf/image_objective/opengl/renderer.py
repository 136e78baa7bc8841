"""Many hypotheses drawn at once, as tiles of one frame buffer (Rymut 2016, 5.3)."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from apf.body.cones import FAR_OUT
from apf.body.kinematics import posed_cones
from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.opengl.context import (
    Compute,
    bind,
    egl_context,
    make_buffer,
    set_uniforms,
    source,
)
from apf.image_objective.renderer import packed_binds, whole_pictures, with_frames
from cl import InputError
from psfs.cameras.camera import CAMERA_FLOATS, CameraRig
from psfs.common.cones import CONE_FLOATS

if TYPE_CHECKING:
    import moderngl

#: vec4s of a part in place_parts.comp; invocations of a group there and in project_vertices.comp.
_PART_VECTORS, _GROUP = 5, 64
_CAMERA = {"CAMERA_FLOATS": CAMERA_FLOATS, "FAR_OUT": FAR_OUT}


class Shape:
    """Renderer of a posed body in the pictures of all cameras. body: the posed cones of this body
    are the only input of `project`. n_parts: P. n_hypotheses: N."""

    body: BodyModel
    n_parts: int

    def __init__(self, context: moderngl.Context, rig: CameraRig, n: int) -> None:
        self.context, self.n_hypotheses, self.n_views = context, n, len(rig)
        self._cameras = make_buffer(context, rig.packed())

    def reserve(self, floats: int) -> moderngl.Buffer:
        """Return a buffer of so many floats for each hypothesis and view."""
        return self.context.buffer(reserve=4 * floats * self.n_hypotheses * self.n_views)

    def project(self, cones: moderngl.Buffer) -> None:
        """Enqueue the projection of the posed cones, a buffer (N, C, 16) float32."""
        raise NotImplementedError

    def draw(
        self, frame: moderngl.Framebuffer, count: int, regions: moderngl.Buffer, **where: object
    ) -> None:
        """Enqueue the drawing of `count` tiles into `frame`; `where`: the uniforms of tiles.glsl,
        `regions`: its buffer."""
        raise NotImplementedError

    def _program(self, vertex: str, fragment: str, **defines: float) -> moderngl.Program:
        program = self.context.program(
            vertex_shader=source(vertex, **defines), fragment_shader=source(fragment)
        )
        return self.context.vertex_array(program, [])


class FlatShape(Shape):
    """Trapezoids of the cones of `body`, see `FlatRenderer`; their edges lie inside of them."""

    def __init__(self, context: moderngl.Context, body: BodyModel, rig: CameraRig, n: int) -> None:
        super().__init__(context, rig, n)
        self.body, self.n_parts = body, len(body.cones)
        edged = np.array([cone.in_images for cone in body.cones], np.int32)
        self._edged = make_buffer(context, edged)
        self._parts = self.reserve(4 * _PART_VECTORS * self.n_parts)
        defines = {"N_PARTS": self.n_parts}
        self._place = Compute(context, "place_parts.comp", **defines, **_CAMERA)
        self._drawing = self._program("parts.vert", "parts.frag", **defines)

    def project(self, cones: moderngl.Buffer) -> None:
        n = self.n_hypotheses * self.n_parts
        buffers = {0: self._cameras, 1: cones, 2: self._parts, 3: self._edged}
        self._place((-(-n // _GROUP), self.n_views), buffers, n_cones=n)

    def draw(
        self, frame: moderngl.Framebuffer, count: int, regions: moderngl.Buffer, **where: object
    ) -> None:
        set_uniforms(self._drawing.program, **where)
        bind({0: regions, 1: self._parts})
        frame.use()
        self._drawing.render(self.context.TRIANGLES, vertices=6 * self.n_parts, instances=count)


class MeshShape(Shape):
    """A mesh that moves with the bones of `body`; its contours are lines on top of all parts."""

    def __init__(
        self, context: moderngl.Context, body: BodyModel, rig: CameraRig, n: int, mesh: BodyMesh
    ) -> None:
        super().__init__(context, rig, n)
        self.body, self.n_parts = with_frames(body), mesh.n_parts
        binds, bones = packed_binds(mesh)
        self._n_corners = len(binds)
        self._binds, self._bones = make_buffer(context, binds), make_buffer(context, bones)
        self._pixels = self.reserve(2 * self._n_corners)
        sizes = {"N_CORNERS": self._n_corners, "N_VERTICES": mesh.n_vertices}
        self._project = Compute(
            context,
            "project_vertices.comp",
            N_BINDS=mesh.bones.shape[1],
            N_BONES=len(body.bones),
            **sizes,
            **_CAMERA,
        )
        triangles = np.column_stack([mesh.faces, mesh.parts]).astype(np.int32)
        lines, owners = mesh.lines()
        drawn = mesh.edged[owners]
        self._owners = make_buffer(context, owners[drawn])
        self._passes = [
            (
                self._program(f"{name}.vert", f"{name}.frag", FAR_OUT=FAR_OUT, **sizes),
                make_buffer(context, shape),
                n_corners * len(shape),
                mode,
            )
            for name, shape, n_corners, mode in (
                ("triangles", triangles, 3, context.TRIANGLES),
                ("lines", lines[drawn], 2, context.LINES),
            )
        ]

    def project(self, cones: moderngl.Buffer) -> None:
        buffers = {0: self._cameras, 1: cones, 2: self._pixels, 3: self._binds, 4: self._bones}
        groups = (-(-self._n_corners // _GROUP), self.n_hypotheses, self.n_views)
        self._project(groups, buffers, n_particles=self.n_hypotheses)

    def draw(
        self, frame: moderngl.Framebuffer, count: int, regions: moderngl.Buffer, **where: object
    ) -> None:
        for numbers, (drawing, shape, n_vertices, mode) in zip(
            (True, False), self._passes, strict=True
        ):
            # Lines leave the number of the part that they cross.
            frame.color_mask = (numbers, True, True, True)
            frame.use()
            set_uniforms(drawing.program, **where)
            bind({0: regions, 1: self._pixels, 2: shape, 3: self._owners})
            drawing.render(mode, vertices=n_vertices, instances=count)
        frame.color_mask = (True, True, True, True)


#: Largest side of the frame buffer, px: with its depths it takes 400 MB.
_LARGEST = 8192


class OpenGLRenderer:
    """Draws N poses of `body`, flat (without round ends) or as `mesh`, in the cameras of `rig`.

    A picture is a view of a hypothesis, by view, then by hypothesis; a frame buffer holds n_tiles
    of them, all of the size of the largest region of interest. Each part's depth is that of its
    middle, as in the OpenCL renderer; edges are the part's own rim (flat) or lines drawn after all
    surfaces (mesh). Calls enqueue work but for `read`; they belong between `with renderer:`, which
    makes the context current, to one thread at a time. name: what renders. Raises InputError where
    moderngl or EGL is missing, and for pictures larger than a frame buffer.
    """

    def __init__(
        self, body: BodyModel, rig: CameraRig, n: int, mesh: BodyMesh | None = None
    ) -> None:
        self.rig, self.n_hypotheses = rig, n
        self.context = egl_context()
        self._lock = threading.RLock()
        weakref.finalize(self, self.context.release)
        with self:
            self.name = str(self.context.info["GL_RENDERER"])
            self._size = self._atlas(min(_LARGEST, self.context.info["GL_MAX_TEXTURE_SIZE"]))
            self._make_buffers(body, mesh)

    def _atlas(self, largest: int) -> tuple[int, int]:
        """Return width and height of a frame buffer for all pictures, of sides up to `largest`."""
        rig = self.rig
        if max(rig.width, rig.height) > largest:
            raise InputError(
                f"pictures {rig.width} x {rig.height}; OpenGL draws up to {largest} px a side here"
            )
        n_columns = math.ceil(math.sqrt(self.n_pictures))
        n_rows = math.ceil(self.n_pictures / n_columns)
        return min(largest, n_columns * rig.width), min(largest, n_rows * rig.height)

    def _make_buffers(self, body: BodyModel, mesh: BodyMesh | None) -> None:
        n, rig = self.n_hypotheses, self.rig
        self.drawn = self.context.texture(self._size, 2)
        depth = self.context.depth_renderbuffer(self._size)
        self._frame = self.context.framebuffer([self.drawn], depth)
        self.shape = (
            FlatShape(self.context, body, rig, n)
            if mesh is None
            else MeshShape(self.context, body, rig, n, mesh)
        )
        bytes_per_pose = 4 * CONE_FLOATS * len(self.shape.body.cones)
        self._cones = self.context.buffer(reserve=n * bytes_per_pose)
        self.regions = self.context.buffer(reserve=16 * len(rig))
        self.select_regions(whole_pictures(rig))

    def __enter__(self) -> OpenGLRenderer:
        self._lock.acquire()
        self.context.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.context.__exit__(*error)
        self._lock.release()

    @property
    def n_pictures(self) -> int:
        return self.n_hypotheses * len(self.rig)

    def select_regions(self, regions: np.ndarray) -> None:
        """Draw within `regions` (V, 4) int32 from now on: first column and row, and, excluded, the
        last."""
        width, height = np.maximum((regions[:, 2:] - regions[:, :2]).max(0), 1).tolist()
        self._tile = width, height
        self._columns = self._size[0] // width
        self.n_tiles = self._columns * (self._size[1] // height)
        self.regions.write(np.ascontiguousarray(regions, np.int32).tobytes())

    def upload(self, cones: np.ndarray) -> None:
        """Upload the posed cones (N, C, 16) of `shape.body`."""
        self._cones.write(np.ascontiguousarray(cones, np.float32).tobytes())

    def project(self) -> None:
        """Project what was uploaded last into all pictures."""
        self.shape.project(self._cones)

    def batches(self) -> Iterator[tuple[int, int]]:
        """Yield the first of all pictures that fit into the frame buffer at once, and how many."""
        for first in range(0, self.n_pictures, self.n_tiles):
            yield first, min(self.n_tiles, self.n_pictures - first)

    def render(self, first: int, count: int) -> None:
        """Draw the `count` pictures from number `first` on."""
        rows = math.ceil(count / self._columns)
        used = (0, 0, min(count, self._columns) * self._tile[0], rows * self._tile[1])
        self._frame.clear(viewport=used)
        self.shape.draw(self._frame, count, self.regions, **self.tiles(first), atlas=self._size)

    def tiles(self, first: int) -> dict[str, object]:
        """Return the uniforms that say where the pictures from number `first` on are drawn."""
        return {
            "first": first,
            "n_particles": self.n_hypotheses,
            "columns": self._columns,
            "tile": self._tile,
        }

    def read(self, count: int) -> np.ndarray:
        """Return the first `count` tiles (count, h, w, 2) uint8: part from 1, 255 on edges."""
        width, height = self._tile
        rows = math.ceil(count / self._columns)
        box = (0, 0, self._columns * width, rows * height)
        data = np.frombuffer(self._frame.read(box, components=2, alignment=1), np.uint8)
        tiles = data.reshape(rows, height, self._columns, width, 2).swapaxes(1, 2)
        return tiles.reshape(-1, height, width, 2)[:count]


def draw_by_opengl(
    body: BodyModel, rig: CameraRig, poses: np.ndarray, mesh: BodyMesh | None = None
) -> np.ndarray:
    """Draw `poses` (N, D) into pictures (N, V, H, W, 2) uint8, as `draw_hypotheses` does."""
    with OpenGLRenderer(body, rig, len(poses), mesh) as renderer:
        renderer.upload(posed_cones(renderer.shape.body, poses))
        renderer.project()
        drawn = []
        for first, count in renderer.batches():
            renderer.render(first, count)
            drawn.append(renderer.read(count))
    pictures = np.concatenate(drawn).reshape(len(rig), len(poses), rig.height, rig.width, 2)
    return pictures.swapaxes(0, 1)
