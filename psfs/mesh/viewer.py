"""Open3D's window: a run frame by frame, with a time line, layers and colourings.

Only what needs a display is here; `psfs.mesh.player` decides what is shown.
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
from psfs.mesh.drawing import COLOURINGS, Drawing, SurfaceDrawing, colour_scale
from psfs.mesh.keys import KEYS
from psfs.mesh.player import Player
from psfs.output.preview import BACKDROP
from psfs.voxels.grid import VoxelGrid

#: Width and height of the window, px.
_SIZE = (1280, 800)
_FIELD_OF_VIEW = 50.0  # degrees
_SHORTEST_TICK = 1 / 30  # s
_LABEL_COLOUR = (0.25, 0.3, 0.4)
#: Direction of the light: from above and from the left of a viewer at _FROM.
_SUN = np.array([-0.7, -0.2, -0.7], np.float32)
#: Initial position of the viewer, relative to the grid's centre.
_VIEWER_POSITION = np.array([1.0, -0.45, 0.35])


def has_display() -> bool:
    """Return whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    if os.environ.get("WAYLAND_DISPLAY"):
        return True
    return bool(os.environ.get("DISPLAY")) and _x_server_answers()


def _x_server_answers() -> bool:
    """Return whether the display named by DISPLAY opens; Open3D waits for ever for one that does
    not."""
    try:
        library = ctypes.CDLL("libX11.so.6")
    except OSError:  # Open3D needs it, too
        return False
    library.XOpenDisplay.restype = ctypes.c_void_p
    display = library.XOpenDisplay(None)
    if display:
        library.XCloseDisplay(ctypes.c_void_p(display))
    return bool(display)


def show_window(title: str, rig: CameraRig, grid: VoxelGrid, player: Player) -> None:
    """Show what `player` shows in a window, looking at `grid`; return when it is closed.

    The cameras of `rig` are labelled at their positions. Raises InputError if no window opens, and
    the errors of the player's drawings.
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
    """The widgets of a window, kept up to date with `player`."""

    def __init__(self, window: Any, rig: CameraRig, grid: VoxelGrid, player: Player) -> None:
        self.window, self.grid, self.player = window, grid, player
        #: The error of a callback, after which the window closes.
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
        self._call_guarded(self.refresh)
        self.look_from_start()

    # Widgets.

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
        self.slider.set_on_value_changed(self._seek)
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
        self.colouring.set_on_selection_changed(self._set_colouring)
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

    # Events.

    def press(self, key: str) -> bool:
        """Perform the action of `key` (see KEYS); return whether it has one."""
        if key == "q":
            self.window.close()
        elif key == "r":
            self.look_from_start()
        elif not self.player.press(key):
            return False
        self._call_guarded(self.refresh)
        return True

    def look_from_start(self) -> None:
        """Look at the whole grid from the initial position."""
        box = load_open3d().geometry.AxisAlignedBoundingBox(self.grid.low, self.grid.high)
        middle = (self.grid.low + self.grid.high) / 2
        self.scene.setup_camera(_FIELD_OF_VIEW, box, middle.astype(np.float32))
        distance = 1.1 * float(np.linalg.norm(self.grid.high - self.grid.low))
        eye = middle + distance * _VIEWER_POSITION / np.linalg.norm(_VIEWER_POSITION)
        self.scene.look_at(*(v.astype(np.float32) for v in (middle, eye, np.array([0.0, 0, 1]))))

    def refresh(self) -> None:
        """Update the window; redraw only what has changed."""
        wanted, scene = self.player.drawings(), self.scene.scene
        for name in [n for n in self._drawn if wanted.get(n) is not self._drawn[n]]:
            scene.remove_geometry(name)
            del self._drawn[name]
        for name, drawing in wanted.items():
            if name not in self._drawn:
                scene.add_geometry(name, convert_to_open3d(drawing), _material(drawing))
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
        key = _key_name(event.key)
        return event.type == self.gui.KeyEvent.Type.DOWN and key is not None and self.press(key)

    def _tick(self) -> bool:
        """Advance the clock; return whether to redraw."""
        now = time.monotonic()
        if now < self._next_tick:
            return False
        seconds, self._ticked = now - self._ticked, now
        before = self.player.playback.position
        self.player.playback.advance(seconds)
        if self.player.playback.position == before:
            return False
        self._call_guarded(self.refresh)
        # Open3D draws and handles keys only while no callback runs.
        self._next_tick = time.monotonic() + max(_SHORTEST_TICK, time.monotonic() - now)
        return True

    def _seek(self, value: float) -> None:
        self.player.playback.seek(round(value))
        self._call_guarded(self.refresh)

    def _set_colouring(self, name: str, _index: int) -> None:
        self.player.colouring = name
        self._call_guarded(self.refresh)

    def _call_guarded(self, act: Callable[[], None]) -> None:
        """Call `act`; close the window on an error, since no exception may pass through Open3D's
        loop."""
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


def _key_name(code: int) -> str | None:
    """Return the key's name in KEYS; None for keys without a name in Open3D."""
    names = load_open3d().visualization.gui.KeyName
    digits = ("ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE")
    try:
        name = names(int(code)).name
    except ValueError:
        return None
    return str(digits.index(name) + 1) if name in digits else name.lower()


def convert_to_open3d(drawing: Drawing) -> Any:
    """Convert a drawing to Open3D's geometry."""
    open3d = load_open3d()
    vector, colours = open3d.utility.Vector3dVector, drawing.colours / 255
    if isinstance(drawing, SurfaceDrawing):
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
    if not isinstance(drawing, SurfaceDrawing):
        material.shader, material.line_width = "unlitLine", drawing.width
        return material
    material.shader = "defaultLit" if drawing.opacity == 1 else "defaultLitTransparency"
    material.base_color = [1.0, 1.0, 1.0, drawing.opacity]
    material.base_roughness = 0.9
    return material
