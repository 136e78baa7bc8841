"""Write takes of two and three people in scenes as they are filmed: they cross, meet, sit down,
come and go, before an empty room or without a film of it, with wrong calibrations, in changing
light.

    python scripts/people_scenes.py DATA OUT [NAME ...]

DATA holds the sequences of `people_actors.py` and `hard_duo_6cam`. Without names it writes all
takes, which are in `people_scenes_list.py`. No setting was chosen with them.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from people_actors import Actor, write_named
from people_scenes_list import FPS, SCENES, Act, Scene, Sitter
from people_takes import MoverGait, Person, render_take

from apf.synthetic import render as rendering
from apf.synthetic.body import Primitive, make_person
from apf.synthetic.config import SceneConfig
from apf.synthetic.render import SceneRenderer, Sensor, SyntheticScene
from apf.synthetic.scene import Furniture
from apf.synthetic.skeleton import rotation
from cl import Device, NumpyDevice
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig

#: The step, m, by which a person is moved outwards until nobody before is touched, and how often.
_STEP, _N_STEPS = 0.03, 60
#: Bones whose flesh a girth widens in full, and in part.
_TRUNK, _LIMBS = ("pelvis", "spine", "thorax"), ("thigh", "shin", "upper_arm", "forearm")
#: Sitting down: how far the pelvis sinks and goes back, m, of a person of 1.75 m.
_SINK, _BACK = 0.41, 0.27
#: The seat is so far under the pelvis, m, its half side, and how far it is behind it.
_SEAT, _HALF, _BEHIND = 0.13, 0.2, 0.06
#: Share of a turned camera's shift of the room's middle that is left, as after a bundle adjustment.
_SHIFT = 0.4
#: Share of the take after which the light falls, and how many frames an automatic exposure takes.
_FALL, _LAG = 0.37, 14


class _SitterGait(MoverGait):
    """The motion of a `Sitter`."""

    def __init__(self, sitter: Sitter, seed: int) -> None:
        super().__init__(sitter, seed)
        self._sitter = sitter
        if sitter.stands(np.zeros(1))[0] > 0.99:  # with both feet on the floor
            self.walk = replace(self.walk, start_phase=0.05)

    def _trunk(
        self, times: np.ndarray, phase: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        root, local = super()._trunk(times, phase)
        if len(self._times) == len(times):
            share, height = self._sitter.sit(self._times), self._sitter.stature / 1.75
            heading = np.radians(self._sitter.heading)
            ahead = np.array([np.cos(heading), np.sin(heading)])
            root[:, 2] -= _SINK * height * share
            root[:, :2] -= _BACK * height * share[:, None] * ahead
            lean = np.radians(128 * share * (1 - share) + 6 * share)
            local["pelvis"] = local["pelvis"] @ rotation("y", np.radians(-8) * share)
            local["spine"] = local["spine"] @ rotation("y", lean)
        return root, local

    def _swing_arm(self, local: dict[str, np.ndarray], side: str, phase: np.ndarray) -> None:
        super()._swing_arm(local, side, phase)
        if len(self._times) == len(phase):
            share = self._sitter.sit(self._times)
            for bone, degrees in ((f"{side}_upper_arm", -22), (f"{side}_forearm", -40)):
                local[bone] = rotation("y", np.radians(degrees) * share) @ local[bone]


def _make_actor(act: Act, data: Path, frames: int) -> Actor:
    """Return the person of an act."""
    primitives = [_widen(of, act.girth) for of in make_person()]
    return Actor(_load_joints(act, data, frames), act.at, act.stature, primitives)


def _widen(part: Primitive, girth: float) -> Primitive:
    bone = part.bone.removeprefix("l_").removeprefix("r_")
    more = {**dict.fromkeys(_TRUNK, 1.0), **dict.fromkeys(_LIMBS, 0.6)}.get(bone, 0.0)
    wider = 1 + more * (girth - 1)
    return replace(part, ra=part.ra * wider, rb=part.rb * wider)


def _load_joints(act: Act, data: Path, frames: int) -> dict[str, np.ndarray]:
    """Return the joints (F, 3) m of an act by name, its path about the origin."""
    name, _, person = act.motion.partition(":")
    truth = np.load(data / name / "truth.npz")
    joints = truth["joints"].astype(float)
    joints = joints[:, int(person)] if person else joints
    last = len(joints) - 1
    laps, index = np.divmod(act.begin + act.every * np.arange(frames), last)
    joints = joints[np.where(laps % 2, last - index, index)]
    names = [str(of) for of in truth["joint_names"]]
    middle = joints[:, names.index("pelvis")] * [1, 1, 0]
    angle = np.radians(act.turn + act.bend * (np.arange(frames) / frames - 0.5))
    turned = rotation("z", angle)
    steps = np.einsum("fab,fb->fa", turned[:-1], np.diff(middle, axis=0))
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    moved = np.einsum("fab,fjb->fja", turned, joints - middle[:, None])
    moved += (path - path.mean(0))[:, None]
    return {of: moved[:, k] for k, of in enumerate(names)}


def make_people(scene: Scene, data: Path) -> list[Person]:
    """Return the people of a take, each moved outwards until nobody before is touched."""
    people: list[Person] = []
    for number, act in enumerate(scene.acts):
        person: Person
        if isinstance(act, Act):
            person, out = _make_actor(act, data, scene.frames), np.array([*act.at, 0.0])
        else:
            gait = _SitterGait(act, scene.seed + number)
            person = Person(gait.skeleton, gait.motion(scene.times))
            out = np.append(person.joints[:, 0, :2].mean(0), 0.0)
        for _ in range(_N_STEPS):
            both = [scene.show(act) & scene.show(other) for other in scene.acts[:number]]
            gaps = [
                np.linalg.norm(person.joints[of][:, :, None] - other.joints[of][:, None], axis=-1)
                for of, other in zip(both, people, strict=True)
            ]
            if all(gap.min(initial=np.inf) > scene.apart for gap in gaps):
                break
            person.move(_STEP * out / max(float(np.linalg.norm(out)), 1e-9))
        people.append(person)
    return people


class _ChangingLight(Sensor):
    """A sensor in a room whose light changes after the empty room was filmed: slowly by 14 %, in
    colour by 8 to 10 %, and at once by 15 %, which cameras make up for in part."""

    def expose(self, picture: np.ndarray, stream: int, index: int) -> np.ndarray:
        """See `Sensor.expose`."""
        if stream == 0:
            frames, views = self.config.frames, len(picture)
            now, fall = index / frames, _FALL * frames
            strength = np.random.default_rng([self.config.seed, 9]).uniform(0.15, 0.85, views)
            gains = np.ones((views, 3)) * (1 + 0.14 * np.sin(1.8 * np.pi * now))
            gains *= 1 + np.array([-0.10, 0, 0.08]) * now
            if index > fall:
                made_up = strength * (1 - np.exp((fall - index) / _LAG))
                gains *= (1 - 0.15 * (1 - made_up))[:, None]
            picture = picture * gains[:, None, None].astype(np.float32)
        return super().expose(picture, stream, index)


class _Rendered(SyntheticScene):
    """The scene of a take."""

    def __init__(
        self,
        scene: Scene,
        people: list[Person],
        config: SceneConfig,
        device: Device | NumpyDevice,
    ) -> None:
        super().__init__(config, device)
        assert isinstance(device, Device)  # or it was refused
        self._walkers = list(people)  # type: ignore[arg-type]
        self._there = np.stack([scene.show(act) for act in scene.acts])
        joints = np.stack([person.joints for person in people])
        self.people_joints = np.where(self._there[:, :, None, None], joints, np.nan)
        self.joints = joints[0]
        looks = range(0, config.frames, 12)
        self._n_balls = max(len(of.posed(k)[1]) for of in people for k in looks)
        if scene.light:
            self._sensor = _ChangingLight(config)
        furniture = rendering.make_furniture(config.seed)
        blocks = [
            _make_block(person, act, scene.times)
            for person, act in zip(people, scene.acts, strict=True)
            if isinstance(act, Sitter) and act.sit(scene.times).any()
        ]
        boxes = np.concatenate([furniture.boxes, *map(np.atleast_2d, blocks)])
        furniture = Furniture(boxes.astype(np.float32), furniture.posters, furniture.palette)
        self.renderer = SceneRenderer(
            device, self.rig, furniture, config.seed, len(people[0].posed(0)[0]), self._n_balls,
            shadow=config.shadow,
        )  # fmt: skip
        self._empty = self.renderer.room.get()


def _make_block(person: Person, act: Sitter, times: np.ndarray) -> list[float]:
    """Return a box of the furniture under somebody who sits."""
    pelvis = person.joints[int(np.argmax(act.sit(times))), 0]
    heading, top = np.radians(act.heading), pelvis[2] - _SEAT
    x, y = pelvis[:2] - _BEHIND * np.array([np.cos(heading), np.sin(heading)])
    low = max(0.05, top - 0.08)
    return [x - _HALF, y - _HALF, low, x + _HALF, y + _HALF, top, 0, 0.4]


def _spoil(rig: CameraRig, degrees: float, seed: int) -> CameraRig:
    """Return the rig with each camera turned about a random axis, moved so that less of the turn is
    seen, and with a focal length that is wrong by up to 0.6 %."""
    rng, middle = np.random.default_rng([seed, 77]), np.array([0.0, 0.0, 1.0])
    spoilt = []
    for camera in rig:
        axis = rng.standard_normal(3)
        axis *= np.radians(degrees) / np.linalg.norm(axis)
        R = cv2.Rodrigues(axis)[0] @ camera.R
        t = camera.R @ middle + camera.t + _SHIFT * (R - camera.R) @ middle - R @ middle
        K = camera.K.copy()
        K[[0, 1], [0, 1]] *= 1 + rng.uniform(-0.006, 0.006)
        spoilt.append(replace(camera, R=R, t=t, K=K))
    return CameraRig(tuple(spoilt))


def write_scene(folder: Path, scene: Scene, data: Path, device: Device | NumpyDevice) -> None:
    """Write a take as `apf synth` does."""
    config = SceneConfig(
        people=len(scene.acts), cameras=scene.cameras, seed=scene.seed, frames=scene.frames, fps=FPS
    )
    render_take(folder, config, device, partial(_Rendered, scene, make_people(scene, data)))
    if not scene.empty:
        shutil.rmtree(folder / "background")
    if scene.off:
        rig = _spoil(rendering.make_rig(config), scene.off, scene.seed)
        write_toml_tables(folder / "calibration.toml", rig)


if __name__ == "__main__":
    write_named(__doc__, SCENES, write_scene)
