"""Render the synthetic scene on an OpenCL device, and simulate the camera's sensor."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from apf.body.toml import load_body
from apf.synthetic.body import PRIMITIVE_FLOATS, PersonSurface
from apf.synthetic.config import SceneConfig
from apf.synthetic.courses import Roamer, make_walks, presence
from apf.synthetic.gait import GaitModel
from apf.synthetic.scene import ROOM, Furniture, make_furniture, make_palettes, make_rig
from apf.synthetic.skeleton import Motion
from apf.synthetic.walk import Walk
from cl import Device, InputError, NumpyDevice
from cl.signature import Argument
from cl.workgroups import row_group
from psfs.cameras.camera import CameraRig

#: Texels of the floor's shadow map and their size, m.
SHADOW_SIZE, SHADOW_STEP = 128, 0.04
#: Side of the square tiles that primitives are sorted into, px.
TILE = 16
#: Sphere tracing: a ray has hit a surface nearer than HIT, m, and takes at most MARCH_STEPS; FAR,
#: m, is larger than any distance.
HIT, MARCH_STEPS, FAR = 5e-4, 64, 1e6
#: Margin of the stored noise field, px, within which each frame's offset is drawn.
_NOISE_MARGIN = 64

_STAGE = "synthetic/scene"


class SceneRenderer:
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
        views, height, width = len(rig), rig.height, rig.width
        defines: dict[str, int | float] = {
            **{"PRIMITIVES": primitives, "BALLS": balls, "PRIMITIVE_FLOATS": PRIMITIVE_FLOATS},
            **{"HIT": HIT, "MARCH_STEPS": MARCH_STEPS, "FAR": FAR, **rig.defines},
            **{"POSTERS": len(furniture.posters), "BOXES": len(furniture.boxes)},
            **{"ROOM_X": ROOM[0], "ROOM_Y": ROOM[1], "ROOM_Z": ROOM[2]},
            **{"SHADOW_SIZE": SHADOW_SIZE, "SHADOW_STEP": SHADOW_STEP},
            "TILE": TILE,
        }
        shape = (views, height, width)
        cameras = device.to_device(rig.packed())
        self._palette = device.to_device(furniture.palette)
        self.room = device.empty((*shape, 3), np.float32, "the empty room's pictures")
        self._distance = device.empty(shape, np.float32, "the room's distances")
        self._floor = device.empty((*shape, 2), np.float32, "the floor's points")
        on_floor = device.empty((SHADOW_SIZE, SHADOW_SIZE), np.float32)
        self.picture = device.empty((*shape, 3), np.float32, "the pictures")
        self.mask = device.empty(shape, np.uint8, "the masks")
        self.depth = device.empty(shape, np.float32, "the depths")
        self._primitives = device.empty((primitives, PRIMITIVE_FLOATS), np.float32)
        self._balls = device.empty((balls, 4), np.float32)
        tile_grid = (-(-width // TILE), -(-height // TILE), views)
        tiles = device.empty((*tile_grid[::-1], primitives + 1), np.uint8, "the tiles")
        grid = (width, height, views)
        room: dict[str, Argument] = {"picture": rig.picture, "cameras": cameras}
        room |= {"distance": self._distance, "floor_point": self._floor}
        device.launch(
            device.kernel(_STAGE, "empty_room", **defines),
            grid,
            row_group(device),
            **room,
            posters=device.to_device(furniture.posters),
            boxes=device.to_device(furniture.boxes),
            seed=seed,
            colours=self.room,
        )()
        self._shadow = device.launch(
            device.kernel(_STAGE, "floor_shadow", **defines),
            (SHADOW_SIZE, SHADOW_SIZE),
            (16, 4),
            balls=self._balls,
            centre=(0.0, 0.0),
            strength=shadow,
            shadow=on_floor,
        )
        body = {"primitives": self._primitives, "tiles": tiles}
        self._bin = device.launch(
            device.kernel(_STAGE, "bin_primitives", **defines),
            tile_grid,
            (4, 4, 1),
            picture=rig.picture,
            cameras=cameras,
            **body,
        )
        drawn = {"room": self.room, "shadow": on_floor, "colours": self.picture, "mask": self.mask}
        drawn["palette"] = self._palette
        self._render, self._smooth = (
            device.launch(
                device.kernel(_STAGE, name, **defines),
                grid,
                row_group(device),
                **room,
                **body,
                **drawn,
                **more,
                centre=(0.0, 0.0),
            )
            for name, more in (("render", {"depth": self.depth}), ("smooth_edges", {}))
        )

    def draw(
        self, bodies: list[tuple[np.ndarray, np.ndarray, np.ndarray]], palettes: list[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return pictures (V, H, W, 3) float32 of several bodies, each with its colours (9, 3), and
        the number (V, H, W) uint8, from 1 on, of the body that is seen in each pixel, 0 for none.

        Each body is drawn into the room with all before it. bodies: as of `__call__`.
        """
        picture, distance, floor = self._empty_room
        numbers = np.zeros(distance.shape, np.uint8)
        for number, (body, palette) in enumerate(zip(bodies, palettes, strict=True), start=1):
            self._palette.set(palette)
            self(*body)
            picture, seen = self.picture.get(), self.mask.get() > 0
            numbers[seen] = number
            if number < len(bodies):
                away = self.depth.get() * self._length_per_depth
                distance = np.where(seen, away, distance)
                floor = np.where(seen[..., None], np.float32(FAR), floor)
                self._set_room(picture, distance, floor)
        if len(bodies) > 1:
            self._set_room(*self._empty_room)
        return picture, numbers

    @cached_property
    def _empty_room(self) -> list[np.ndarray]:
        """The empty room's pictures, distances and floor's points."""
        return [array.get() for array in (self.room, self._distance, self._floor)]

    def _set_room(self, *values: np.ndarray) -> None:
        for array, of in zip((self.room, self._distance, self._floor), values, strict=True):
            array.set(of)

    @cached_property
    def _length_per_depth(self) -> np.ndarray:
        """Distance (V, H, W) from the camera for each depth of 1 m."""
        height, width = self.rig.height, self.rig.width
        pixels = np.indices((height, width))[::-1].reshape(2, -1).T.astype(np.float64)
        depths = [camera.rays(pixels) @ camera.R[2] for camera in self.rig]
        return (1 / np.array(depths)).reshape(-1, height, width).astype(np.float32)

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
        blurred *= np.float32(config.noise / blurred.std())
        fields = (blurred[:, :, :3], blurred[:, :, 3:])
        self._fields = [np.float32(np.sqrt(0.5)) * np.ascontiguousarray(of) for of in fields]

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
            for field in self._fields:
                y, x = rng.integers(0, _NOISE_MARGIN, 2)
                noisy += field[y : y + height, x : x + width]
            noisy += np.float32(0.5)
            np.clip(noisy, 0, 255, out=noisy)
            out[view] = noisy
        return out


class SyntheticScene:
    """People walking in a room, rendered frame by frame; deterministic for a given seed.

    rig: the cameras. joint_names: of the truth. people_joints: (P, F, J, 3) m, NaN where somebody
    is absent; joints: (F, J, 3) of the first person. Raises InputError for the NumPy device.
    """

    def __init__(self, config: SceneConfig, device: Device | NumpyDevice) -> None:
        if isinstance(device, NumpyDevice):
            raise InputError(
                "the synthetic scene is rendered with OpenCL only; "
                f"expected an OpenCL device, found {device.name}"
            )
        self.config = config
        self.rig = make_rig(config)
        times = np.arange(config.frames) / config.fps
        self._walkers: list[_Walker] | list[Roamer]
        if config.body is None:
            self._walkers = [_Walker(walk, config) for walk in make_walks(config)]
        else:
            self._walkers = [Roamer(load_body(config.body), config.walk, times, config.seed)]
        self._there = presence(config)
        joints = np.stack([walker.joints for walker in self._walkers])
        self.people_joints = np.where(self._there[:, :, None, None], joints, np.nan)
        self.joints = joints[0]
        self.joint_names = self._walkers[0].joint_names
        self._sensor = Sensor(config)
        shapes = [walker.posed(0) for walker in self._walkers]
        self._n_balls = max(len(balls) for _, balls, _ in shapes)
        self.renderer = SceneRenderer(
            device, self.rig, make_furniture(config.seed), config.seed, len(shapes[0][0]),
            self._n_balls, shadow=config.shadow,
        )  # fmt: skip
        self._palettes = make_palettes(config.seed, config.people)
        self._empty = self.renderer.room.get()

    @property
    def roamer(self) -> Roamer | None:
        """The body that goes about in place of a person."""
        first = self._walkers[0]
        return first if isinstance(first, Roamer) else None

    def posed(self, index: int, person: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the renderer's arguments for a frame: primitives, balls, centre of the shadow
        map."""
        primitives, balls, centre = self._walkers[person].posed(index)
        spare = np.tile(np.array([0, 0, -1, 0], np.float32), (self._n_balls - len(balls), 1))
        return primitives, np.concatenate([balls, spare]), centre  # under the floor: no shadow

    def frame(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return images (V, H, W, 3) uint8 BGR, and the number (V, H, W) uint8, from 1 on, of the
        person that is seen in each pixel, 0 for none."""
        there = np.flatnonzero(self._there[:, index])
        bodies = [self.posed(index, int(person)) for person in there]
        palettes = [self._palettes[person] for person in there]
        picture, order = self.renderer.draw(bodies, palettes)
        numbers = np.append(0, there + 1).astype(np.uint8)[order]
        return self._sensor.expose(picture, 0, index), numbers

    def background_frame(self, index: int) -> np.ndarray:
        """Return pictures (V, H, W, 3) uint8 BGR of the empty room with noise."""
        return self._sensor.expose(self._empty, 1, index)


class _Walker:
    """One person: the surface and the motion. joints: (F, J, 3) m."""

    def __init__(self, walk: Walk, config: SceneConfig) -> None:
        gait = GaitModel(walk)
        motion = gait.motion(np.arange(config.frames) / config.fps)
        if config.people == 1:  # the walked part of the path is centred on the origin
            trail = motion.positions[:, 0, :2]
            shift = np.append(-0.5 * (trail.min(0) + trail.max(0)), 0.0)
            motion = Motion(motion.rotations, motion.positions + shift)
        self._motion = motion
        self.joints = gait.skeleton.joints(self._motion)
        self.joint_names = gait.skeleton.joint_names
        self._flesh = PersonSurface(gait.skeleton)

    def posed(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return primitives, balls, and the centre (2,) m of the shadow map."""
        primitives = self._flesh.packed(self._motion, index)
        return primitives, self._flesh.balls(primitives), self.joints[index, 0, :2]
