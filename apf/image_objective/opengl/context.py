"""OpenGL without a window: the context, its programs and buffers."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from cl import InputError
from cl.errors import pip_command

if TYPE_CHECKING:
    import moderngl

#: Libraries of OpenGL; the first one needs no X. Names without version numbers belong to the
#: packages for compilers.
_LIBRARIES = ("libOpenGL.so.0", "libGL.so.1")
_CLIP_DISTANCE = 0x3000  # GL_CLIP_DISTANCE0


def egl_context() -> moderngl.Context:
    """Make an off-screen OpenGL 4.3 context, current to no thread.

    Raises InputError that says what is missing.
    """
    try:
        import moderngl
    except ImportError:
        raise InputError(
            f"OpenGL needs moderngl, which is not installed; expected: {pip_command('opengl')}"
        ) from None
    options: dict[str, object] = {"standalone": True, "backend": "egl", "require": 430}
    options["libegl"] = "libEGL.so.1"
    for library in _LIBRARIES:
        try:
            context = moderngl.create_context(**{**options, "libgl": library})
            break
        except Exception as error:  # moderngl raises bare Exceptions
            reason = error
    else:
        raise InputError(f"no OpenGL 4.3 by EGL here ({reason}); expected a driver") from None
    with context:
        context.enable(moderngl.DEPTH_TEST)
        # Of parts at one depth the first is seen, as in the OpenCL renderer.
        context.depth_func = "<"
        for plane in range(4):
            context.enable_direct(_CLIP_DISTANCE + plane)
    return context


@cache
def _text(name: str) -> str:
    file = resources.files("apf") / "image_objective" / "opengl" / "shaders" / name
    return re.sub(r'#include "([^"]+)"', lambda found: _text(found[1]), file.read_text())


def source(name: str, **defines: float) -> str:
    """Return the text of a shader, its headers inlined, with `defines`."""
    lines = [f"#define {key} {value}" for key, value in defines.items()]
    return "\n".join(["#version 430", *lines, _text(name)])


class Compute:
    """A compute shader, the buffers bound to it by their binding, and its uniforms."""

    def __init__(self, context: moderngl.Context, name: str, **defines: float) -> None:
        self._context = context
        self._shader = context.compute_shader(source(name, **defines))

    def __call__(
        self, groups: tuple[int, ...], buffers: dict[int, moderngl.Buffer], **uniforms: object
    ) -> None:
        """Enqueue so many work-groups; what follows sees what they wrote."""
        set_uniforms(self._shader, **uniforms)
        bind(buffers)
        self._shader.run(*groups)
        self._context.memory_barrier()


def set_uniforms(program: moderngl.Program | moderngl.ComputeShader, **uniforms: object) -> None:
    """Set those of `uniforms` that the program has: compilers drop unused ones."""
    for name, value in uniforms.items():
        if name in program:
            program[name].value = value


def bind(buffers: dict[int, moderngl.Buffer]) -> None:
    """Bind storage buffers by their binding."""
    for binding, buffer in buffers.items():
        buffer.bind_to_storage_buffer(binding)


def make_buffer(context: moderngl.Context, values: np.ndarray) -> moderngl.Buffer:
    """Return a buffer that holds `values`."""
    return context.buffer(np.ascontiguousarray(values).tobytes())
