"""Open3D's window: a run frame by frame, with a time line, layers and colourings.

Only what needs a display is here; what is shown when, `psfs.mesh.player` says.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cl import InputError, UserError
from psfs.cameras.camera import CameraRig
from psfs.common.open3d import load_open3d
from psfs.mesh.drawing import COLOURINGS, Drawing, Surface, colour_scale
from psfs.mesh.keys import KEYS
from psfs.mesh.player import Player
from psfs.output.preview import BACKDROP
from psfs.voxels.grid import VoxelGrid

#: Width and height of the window, px.
_SIZE = (1280, 800)
_FIELD_OF_VIEW = 50.0  # degrees
_SHORTEST_TICK = 1 / 30  # s
_LABEL_COLOUR = (0.25, 0.3, 0.4)
#: The way that the light falls: from above and from the left of who looks from _FROM.
_SUN = np.array([-0.7, -0.2, -0.7], np.float32)
#: Where the viewer stands at first, as seen from the middle of the grid.
_FROM = np.array([1.0, -0.45, 0.35])


def has_display() -> bool:
    """Return whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    if os.environ.get("WAYLAND_DISPLAY"):
        return True
    return bool(os.environ.get("DISPLAY")) and _x_server_answers()


def _x_server_answers() -> bool:
    """Does the display that DISPLAY names open? Open3D waits for ever for one that does not."""
    try:
        library = ctypes.CDLL("libX11.so.6")
    except OSError:  # which Open3D needs, too
        return False
    library.XOpenDisplay.restype = ctypes.c_void_p
    display = library.XOpenDisplay(None)
    if display:
        library.XCloseDisplay(ctypes.c_void_p(display))
    return bool(display)


def show(title: str, rig: CameraRig, grid: VoxelGrid, player: Player) -> None:
    """Open a window with what `player` shows, looking at `grid`; return when it is closed.

    The cameras of `rig` are named where they stand. Raises InputError if no window opens, and the
    errors of the player's drawings.
    """
    gui = load_open3d().visualization.gui
    gui.Application.instance.initialize()
    try:
        window = gui.Application.instance.create_window(title, *_SIZE)
    except RuntimeError as error:
        raise InputError(
            f"Open3D opens no window ({error}); expected a display and a graphics driver with "
            "Vulkan (Debian: libvulkan1 and mesa-vulkan-drivers do without a GPU); --png FILE "
            "writes a picture instead"
        ) from None
    viewer = _Viewer(window, rig, grid, player)
    gui.Application.instance.run()
    if viewer.error is not None:
        raise viewer.error


class _Viewer:
    """The widgets of a window, kept as `player` says."""

    def __init__(self, window: Any, rig: CameraRig, grid: VoxelGrid, player: Player) -> None:
        self.window, self.grid, self.player = window, grid, player
        #: What went wrong in a callback; the window is closed then.
        self.error: UserError | None = None
        self._drawn: dict[str, Drawing] = {}
        self._ticked = self._next_tick = time.monotonic()
        visualization = load_open3d().visualization
        self.gui, self.rendering = visualization.gui, visualization.rendering
        self._scene_widget(rig)
        self._time_line()
        self._side_panel()
        window.set_on_layout(self._layout)
        window.set_on_key(self._key)
        window.set_on_tick_event(self._tick)
        self._guarded(self.refresh)
        self.look_from_start()

    # What it is made of

    def _scene_widget(self, rig: CameraRig) -> None:
        self.scene = self.gui.SceneWidget()
        self.scene.scene = self.rendering.Open3DScene(self.window.renderer)
        self.scene.scene.set_background([*(BACKDROP[::-1] / 255), 1.0])
        lighting = self.rendering.Open3DScene.LightingProfile.NO_SHADOWS
        self.scene.scene.set_lighting(lighting, _SUN)
        for camera in rig:
            label = self.scene.add_3d_label(camera.centre.astype(np.float32), camera.name)
            label.color = self.gui.Color(*_LABEL_COLOUR)
        self.window.add_child(self.scene)

    def _time_line(self) -> None:
        em = self.window.theme.font_size
        self.play = self._button("Play", "space")
        self.slider = self.gui.Slider(self.gui.Slider.INT)
        self.slider.set_limits(0, max(1, len(self.player.playback.frames) - 1))
        self.slider.set_on_value_changed(self._scrubbed)
        buttons = [self._button("<", "left"), self.play, self._button(">", "right")]
        speeds = [self._button("slower", "down"), self._button("faster", "up")]
        row = self.gui.Horiz(0.5 * em, self.gui.Margins(0.5 * em, 0, 0.5 * em, 0))
        for widget in (*buttons, self.slider, *speeds):
            row.add_child(widget)
        self.caption = self.gui.Label("")
        self.bottom = self.gui.Vert(0.3 * em, self.gui.Margins(0.5 * em))
        self.bottom.add_child(row)
        self.bottom.add_child(self.caption)
        self.window.add_child(self.bottom)

    def _side_panel(self) -> None:
        em = self.window.theme.font_size
        self.panel = self.gui.Vert(
            0.4 * em, self.gui.Margins(0.7 * em, 0.7 * em, 1.2 * em, 0.7 * em)
        )
        self.panel.add_child(self.gui.Label("colour by"))
        self.colouring = self.gui.Combobox()
        for name in COLOURINGS:
            self.colouring.add_item(name)
        self.colouring.set_on_selection_changed(self._coloured)
        self.scale = self.gui.ImageWidget()
        self.scale_text = self.gui.Label("")
        for widget in (self.colouring, self.scale, self.scale_text, self.gui.Label("show")):
            self.panel.add_child(widget)
        self.boxes = {}
        for number, layer in enumerate(self.player.layers, 1):
            box = self.gui.Checkbox(f"{layer.name} ({number})")
            box.set_on_checked(lambda _checked, key=str(number): self.press(key))
            self.boxes[layer.name] = box
            self.panel.add_child(box)
        self.panel.add_child(self.gui.Label(_help()))
        self.window.add_child(self.panel)

    def _button(self, text: str, key: str) -> Any:
        button = self.gui.Button(text)
        button.vertical_padding_em = 0.1
        button.set_on_clicked(lambda: self.press(key))
        return button

    def _layout(self, context: Any) -> None:
        area, em = self.window.content_rect, self.window.theme.font_size
        wide = round(13 * em)
        tall = self.bottom.calc_preferred_size(context, self.gui.Widget.Constraints()).height
        self.scene.frame = self.gui.Rect(area.x, area.y, area.width - wide, area.height - tall)
        self.panel.frame = self.gui.Rect(area.get_right() - wide, area.y, wide, area.height)
        self.bottom.frame = self.gui.Rect(area.x, area.get_bottom() - tall, area.width - wide, tall)

    # What happens to it

    def press(self, key: str) -> bool:
        """Do what `key` (see KEYS) stands for; return whether it stands for anything."""
        if key == "q":
            self.window.close()
        elif key == "r":
            self.look_from_start()
        elif not self.player.press(key):
            return False
        self._guarded(self.refresh)
        return True

    def look_from_start(self) -> None:
        """Look at the whole grid from where the viewer stood at first."""
        box = load_open3d().geometry.AxisAlignedBoundingBox(self.grid.low, self.grid.high)
        middle = (self.grid.low + self.grid.high) / 2
        self.scene.setup_camera(_FIELD_OF_VIEW, box, middle.astype(np.float32))
        distance = 1.1 * float(np.linalg.norm(self.grid.high - self.grid.low))
        eye = middle + distance * _FROM / np.linalg.norm(_FROM)
        self.scene.look_at(*(v.astype(np.float32) for v in (middle, eye, np.array([0.0, 0, 1]))))

    def refresh(self) -> None:
        """Show what the player shows; draw only what has become another."""
        wanted, scene = self.player.drawings(), self.scene.scene
        for name in [n for n in self._drawn if wanted.get(n) is not self._drawn[n]]:
            scene.remove_geometry(name)
            del self._drawn[name]
        for name, drawing in wanted.items():
            if name not in self._drawn:
                scene.add_geometry(name, geometry(drawing), _material(drawing))
                self._drawn[name] = drawing
        player = self.player
        self.play.text = "Pause" if player.playback.playing else "Play"
        self.slider.int_value = player.playback.position
        self.caption.text = player.caption()
        for name, box in self.boxes.items():
            box.checked = player.shown[name]
        self._show_scale()
        self.scene.force_redraw()

    def _show_scale(self) -> None:
        self.colouring.selected_text = self.player.colouring
        text, strip = colour_scale(
            self.player.colouring, float(self.grid.low[2]), float(self.grid.high[2])
        )
        self.scale_text.text = text
        self.scale.visible = bool(len(strip))
        if len(strip):
            self.scale.update_image(load_open3d().geometry.Image(strip))

    def _key(self, event: Any) -> bool:
        key = _name_of(event.key)
        return event.type == self.gui.KeyEvent.Type.DOWN and key is not None and self.press(key)

    def _tick(self) -> bool:
        """Let the time go by; return whether to draw."""
        now = time.monotonic()
        if now < self._next_tick:
            return False
        seconds, self._ticked = now - self._ticked, now
        before = self.player.playback.position
        self.player.playback.advance(seconds)
        if self.player.playback.position == before:
            return False
        self._guarded(self.refresh)
        # Open3D draws and listens to keys only while nothing happens here.
        self._next_tick = time.monotonic() + max(_SHORTEST_TICK, time.monotonic() - now)
        return True

    def _scrubbed(self, value: float) -> None:
        self.player.playback.seek(round(value))
        self._guarded(self.refresh)

    def _coloured(self, name: str, _index: int) -> None:
        self.player.colouring = name
        self._guarded(self.refresh)

    def _guarded(self, act: Callable[[], None]) -> None:
        """`act`; an error closes the window, since none may pass through Open3D's loop."""
        try:
            act()
        except UserError as error:
            self.error = error
            self.window.close()


def _help() -> str:
    keys = [f"{key}: {what}" for key, what in KEYS.items()]
    return "\n".join(
        ["keys", *keys, "", "mouse", "drag: turn", "wheel: nearer, farther", "ctrl + drag: move"]
    )


def _name_of(code: int) -> str | None:
    """The key as KEYS names it; None for keys that have no name in Open3D."""
    names = load_open3d().visualization.gui.KeyName
    digits = ("ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE")
    try:
        name = names(int(code)).name
    except ValueError:
        return None
    return str(digits.index(name) + 1) if name in digits else name.lower()


def geometry(drawing: Drawing) -> Any:
    """Return Open3D's form of a drawing."""
    open3d = load_open3d()
    vector, colours = open3d.utility.Vector3dVector, drawing.colours / 255
    if isinstance(drawing, Surface):
        faces = open3d.utility.Vector3iVector(drawing.faces.astype(np.int32))
        mesh = open3d.geometry.TriangleMesh(vector(drawing.vertices), faces)
        mesh.vertex_normals, mesh.vertex_colors = vector(drawing.normals), vector(colours)
        return mesh
    pairs = open3d.utility.Vector2iVector(drawing.pairs.astype(np.int32))
    lines = open3d.geometry.LineSet(vector(drawing.points), pairs)
    lines.colors = vector(colours)
    return lines


def _material(drawing: Drawing) -> Any:
    material = load_open3d().visualization.rendering.MaterialRecord()
    if not isinstance(drawing, Surface):
        material.shader, material.line_width = "unlitLine", drawing.width
        return material
    material.shader = "defaultLit" if drawing.opacity == 1 else "defaultLitTransparency"
    material.base_color = [1.0, 1.0, 1.0, drawing.opacity]
    material.base_roughness = 0.9
    return material
