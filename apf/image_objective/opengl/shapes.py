"""Shapes of a posed body for OpenGL: its cones as trapezoids, or a mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from apf.body.cones import FAR_OUT
from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.opengl.context import Compute, bind, make_buffer, set_uniforms, source
from apf.image_objective.renderer import packed_binds, with_frames
from psfs.cameras.camera import CAMERA_FLOATS, CameraRig

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
