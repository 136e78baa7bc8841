"""Render the synthetic scene on an OpenCL device, and simulate the camera's sensor."""

from __future__ import annotations

import cv2
import numpy as np

from apf.synthetic.body import PRIMITIVE_FLOATS, PersonSurface
from apf.synthetic.config import SceneConfig
from apf.synthetic.gait import Gait
from apf.synthetic.scene import ROOM, Furniture, make_furniture, make_rig
from apf.synthetic.skeleton import Motion
from cl import Array, Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig

#: Texels of the floor's shadow map and their size, m.
SHADOW_SIZE, SHADOW_STEP = 128, 0.04
#: Side of the square tiles that primitives are sorted into, px.
TILE = 16
#: Sphere tracing: a ray has hit a surface nearer than HIT, m, and takes at most MARCH_STEPS; FAR,
#: m, is larger than any distance.
#: anything.
HIT, MARCH_STEPS, FAR = 5e-4, 64, 1e6
#: Margin of the stored noise field, px, within which each frame's offset is drawn.
_NOISE_MARGIN = 64

_STAGE = "synthetic/scene"
#: Work group size over the pixels.
_GROUP = (16, 4, 1)


class Renderer:
    """Renders a posed body in a room for every camera of a rig (all of one picture size).

    shadow: strength of its shadow on the floor, 0 to 1.

    Calls only enqueue; `picture` (V, H, W, 3) float32 grey levels BGR, `mask` (V, H, W) uint8 and
    `depth` (V, H, W) float32 m are on the device.
    """

    def __init__(
        self, device: Device, rig: CameraRig, furniture: Furniture, seed: int, primitives: int,
        balls: int, *, shadow: float = 1.0,
    ) -> None:  # fmt: skip
        self.rig = rig
        self._device = device
        views, height, width = len(rig), rig.height, rig.width
        defines = _defines(rig, furniture, primitives, balls)
        shape = (views, height, width)
        cameras = device.to_device(rig.packed())
        palette = device.to_device(furniture.palette)
        self.room = device.empty((*shape, 3), np.float32, "the empty room's pictures")
        distance = device.empty(shape, np.float32, "the room's distances")
        floor = device.empty((*shape, 2), np.float32, "the floor's points")
        on_floor = device.empty((SHADOW_SIZE, SHADOW_SIZE), np.float32)
        self.picture = device.empty((*shape, 3), np.float32, "the pictures")
        self.mask = device.empty(shape, np.uint8, "the masks")
        self.depth = device.empty(shape, np.float32, "the depths")
        self._primitives = device.empty((primitives, PRIMITIVE_FLOATS), np.float32)
        self._balls = device.empty((balls, 4), np.float32)
        tile_grid = (-(-width // TILE), -(-height // TILE), views)
        tiles = device.empty((*tile_grid[::-1], primitives + 1), np.uint8, "the tiles")
        centre = (0.0, 0.0)
        grid = (width, height, views)
        room = {"cameras": cameras, "distance": distance, "floor_point": floor}
        self._draw_room(furniture, seed, room, defines)
        self._shadow = device.launch(
            device.kernel(_STAGE, "floor_shadow", **defines),
            (SHADOW_SIZE, SHADOW_SIZE),
            (16, 4),
            balls=self._balls,
            centre=centre,
            strength=shadow,
            shadow=on_floor,
        )
        body = {"primitives": self._primitives, "tiles": tiles}
        self._bin = device.launch(
            device.kernel(_STAGE, "bin_primitives", **defines),
            tile_grid,
            (4, 4, 1),
            cameras=cameras,
            **body,
        )
        drawn = {"room": self.room, "shadow": on_floor, "picture": self.picture, "mask": self.mask}
        drawn["palette"] = palette
        self._render, self._smooth = (
            device.launch(
                device.kernel(_STAGE, name, **defines),
                grid,
                _GROUP,
                **room,
                **body,
                **drawn,
                **more,
                centre=centre,
            )
            for name, more in (("render", {"depth": self.depth}), ("smooth_edges", {}))
        )

    def _draw_room(
        self,
        furniture: Furniture,
        seed: int,
        arrays: dict[str, Array],
        defines: dict[str, int | float],
    ) -> None:
        """Enqueue the pictures of the empty room, its distances and the floor's points."""
        device, rig = self._device, self.rig
        device.launch(
            device.kernel(_STAGE, "empty_room", **defines),
            (rig.width, rig.height, len(rig)),
            _GROUP,
            **arrays,
            posters=device.to_device(furniture.posters),
            boxes=device.to_device(furniture.boxes),
            seed=seed,
            picture=self.room,
        )()

    def __call__(self, primitives: np.ndarray, balls: np.ndarray, centre: np.ndarray) -> None:
        """Enqueue the pictures of a posed body.

        primitives (P, PRIMITIVE_FLOATS) and balls (S, 4): float32 as packed by `PersonSurface`.
        centre: (2,) m of the floor's shadow map.
        """
        self._primitives.set(primitives)
        self._balls.set(balls)
        self._bin()
        for launch in (self._shadow, self._render, self._smooth):
            launch.set(centre=centre)
            launch()


def _defines(
    rig: CameraRig, furniture: Furniture, primitives: int, balls: int
) -> dict[str, int | float]:
    """Return the compile-time definitions of scene.cl."""
    width, height = rig.width, rig.height
    return {
        **{"PRIMITIVES": primitives, "BALLS": balls, "PRIMITIVE_FLOATS": PRIMITIVE_FLOATS},
        **{"HIT": HIT, "MARCH_STEPS": MARCH_STEPS, "FAR": FAR, **rig.defines},
        **{"POSTERS": len(furniture.posters), "BOXES": len(furniture.boxes)},
        **{"ROOM_X": ROOM[0], "ROOM_Y": ROOM[1], "ROOM_Z": ROOM[2]},
        **{"SHADOW_SIZE": SHADOW_SIZE, "SHADOW_STEP": SHADOW_STEP},
        **{"WIDTH": width, "HEIGHT": height, "VIEWS": len(rig)},
        **{"TILE": TILE, "TILES_X": -(-width // TILE), "TILES_Y": -(-height // TILE)},
    }


def _centre_motion(motion: Motion) -> Motion:
    """Shift the motion so that the walked part of the path is centred on the origin."""
    trail = motion.positions[:, 0, :2]
    shift = np.append(-0.5 * (trail.min(0) + trail.max(0)), 0.0)
    return Motion(motion.rotations, motion.positions + shift)


class Sensor:
    """Noise of the camera's sensor.

    Gaussian, correlated over about a pixel, with a gain that flickers from frame to frame. Frames
    can be drawn in any order.
    """

    def __init__(self, config: SceneConfig) -> None:
        self.config = config
        width, height = config.size
        rng = np.random.default_rng([config.seed, 4])
        field = rng.standard_normal(
            (height + _NOISE_MARGIN, width + _NOISE_MARGIN, 6), dtype=np.float32
        )
        blurred: np.ndarray = cv2.GaussianBlur(field, (3, 3), 0.55)
        self._field = blurred * np.float32(config.noise / blurred.std())

    def expose(self, picture: np.ndarray, stream: int, index: int) -> np.ndarray:
        """Add noise to a picture (V, H, W, 3) float32; return uint8. stream: number of the
        recording."""
        rng = np.random.default_rng([self.config.seed, 5, stream, index])
        out = np.empty(picture.shape, np.uint8)
        height, width = picture.shape[1:3]
        for view, image in enumerate(picture):
            gain = np.float32(1 + self.config.flicker * rng.standard_normal())
            noisy = gain * image
            # The sum of two shifted fields is new noise for the price of an addition.
            for layer in (0, 1):
                y, x = rng.integers(0, _NOISE_MARGIN, 2)
                field = self._field[y : y + height, x : x + width, 3 * layer : 3 * layer + 3]
                noisy += np.float32(np.sqrt(0.5)) * field
            np.clip(noisy + 0.5, 0, 255, out=noisy)
            out[view] = noisy
        return out


class SyntheticScene:
    """A person walking in a room, rendered frame by frame; deterministic for a given seed.

    rig: the cameras. joint_names: of the truth. joints: (F, J, 3) m. background_images: (V, H, W,
    3) uint8 BGR without noise; `background_frame(i)` adds it. Raises InputError for the NumPy
    device.
    """

    def __init__(self, config: SceneConfig, device: Device | NumpyDevice) -> None:
        if isinstance(device, NumpyDevice):
            raise InputError(
                "the synthetic scene is rendered with OpenCL only; "
                f"expected an OpenCL device, found {device.name}"
            )
        self.config = config
        self.rig = make_rig(config)
        gait = Gait(config.walk)
        motion = gait.motion(np.arange(config.frames) / config.fps)
        self._motion = _centre_motion(motion)
        self.joints = gait.skeleton.joints(self._motion)
        self.joint_names = gait.skeleton.joint_names
        self._flesh = PersonSurface(gait.skeleton)
        self._sensor = Sensor(config)
        primitives, balls, _ = self.posed(0)
        self.renderer = Renderer(
            device, self.rig, make_furniture(config.seed), config.seed, len(primitives), len(balls),
            shadow=config.shadow,
        )  # fmt: skip
        self._empty = self.renderer.room.get()
        self.background_images = np.clip(self._empty + 0.5, 0, 255).astype(np.uint8)

    def __len__(self) -> int:
        return self.config.frames

    def posed(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the renderer's arguments for a frame: primitives, balls, centre of the shadow
        map."""
        primitives = self._flesh.packed(self._motion, index)
        return primitives, self._flesh.balls(primitives), self.joints[index, 0, :2]

    def frame(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return images (V, H, W, 3) uint8 BGR, masks (V, H, W) uint8 0/255, joints (J, 3) m."""
        self.renderer(*self.posed(index))
        images = self._sensor.expose(self.renderer.picture.get(), 0, index)
        return images, self.renderer.mask.get(), self.joints[index]

    def background_frame(self, index: int) -> np.ndarray:
        """Return pictures (V, H, W, 3) uint8 BGR of the empty room with noise."""
        return self._sensor.expose(self._empty, 1, index)
