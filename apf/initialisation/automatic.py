"""Estimate the person's body size and poses from the stored voxels of the first frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from apf.backend import make_filter
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.limbs import limb_masks, root_mask
from apf.body.model import BodyModel
from apf.body.stature import HIP_SHARE, has_feet, has_head, is_whole, lowest_point, stature
from apf.filters.base import DeviceTracker, Estimate, Tracker
from apf.filters.config import FilterConfig
from apf.initialisation.body_fit import Cloud, Fitted, SurfaceEvidence, fit_body
from apf.initialisation.kept_voxels import LEAST_VOXELS, cut_by_height, select_person_points
from apf.initialisation.shape_model import ShapeModel
from apf.initialisation.start import Start, StartConfig, StartError, check_startable
from apf.likelihood.observations import AnyVoxels
from apf.scene import Scene
from psfs.common.progress import map_in_threads, one_blas_thread
from psfs.voxels.grid import VoxelCloud

#: Share of the height beyond the hips up to which voxels are used for a body without head or feet:
#: the belly ends there.
_PART_MARGIN = 0.1
#: Standard deviations of the search over headings: of the root's place, m, and tilt, rad, and of
#: other axes as a share of what their limits span.
_PLACE, _TILT, _BEND = 0.08, 0.15, 0.2
#: Share by which the cost grows if the person moves backwards, which people seldom do, and the
#: speed, m/s, from which on that counts: slower, they shift their weight.
_BACKWARDS, _LEAST_SPEED = 0.5, 0.25
#: Least angle, rad, between headings that face away from each other.
_AWAY = 2 * np.pi / 3
#: Power of the misfit in the cost of single frames: a limb in the air costs little in the pictures;
#: the voxels show better where it is.
_MISFIT_POWER = 0.3
#: Misfit, see `apf.likelihood.base`, above which no body was found.
_HOPELESS = 0.9
#: Steps of a body's fit: seven more lower the cost by 2 %.
_FIT_STEPS = 8


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Scales (S,) of a body and its poses (M, D) in some frames, the mean misfit of these, the
    cost by which hypotheses are compared, lower is better, and the number of the pose that fits
    best."""

    shape: np.ndarray
    poses: np.ndarray
    misfit: float
    cost: float
    best: int

    @property
    def pose(self) -> np.ndarray:
        """The pose (D,) that fits best."""
        return self.poses[self.best]


def find_start(
    scene: Scene,
    voxels: Sequence[AnyVoxels],
    noise: float,
    *,
    frames: Sequence[int] | None = None,
    height: float | None = None,
    keep_shape: bool = False,
    with_rival: bool = True,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
    config: StartConfig | None = None,
) -> Start:
    """Fit the template, the scene's body, to the person in the `voxels` (see `store_voxels`) of the
    first frames.

    In the first, the last and some middle frames, search over all headings. From the frame with the
    best fit, follow the best headings to both ends, and fit the body's shape to all frames.

    noise: of a tracker from one of `voxels` to the next, see `SearchConfig`. frames: the numbers of
    the frames, by default from 0 on. height: known stature, m. keep_shape: the template is the
    person's own body. with_rival: whether to follow a rival that faces away. progress: called
    every now and then.

    A body without head or feet is fitted to the part of the voxels that it models. Frames after the
    person has left are ignored. Raises StartError if the first frame shows nobody or the body has
    no automatic start.
    """
    config = config or StartConfig()
    check_startable(scene.body)
    shown, clouds = _select_observations(scene, voxels)
    search = _Search(scene, shown, clouds, height, keep_shape)
    search.config = config.filter.with_changes(noise=noise, seed=seed)
    search.progress = progress or (lambda: None)
    anchor, likely = search.try_headings(config)
    fits = search.follow(likely if with_rival else likely[:1], anchor)
    best, *rivals = select_distinct(scene.body, fits, np.pi / config.n_headings)
    if best.misfit > _HOPELESS:
        raise StartError(
            "no standing or walking person was found in the first frames (misfit "
            f"{best.misfit:.2f}; expected less than {_HOPELESS})"
        )
    visible_height = _visible_height(clouds)
    numbers = (range(len(clouds)) if frames is None else frames)[: len(clouds)]

    def make_start(fit: Hypothesis, rival: float, others: Sequence[Start] = ()) -> Start:
        return Start(
            scene.body, fit.shape, fit.poses, numbers, fit.best, rival, visible_height,
            tuple(others),
        )  # fmt: skip

    factors = [each.cost / best.cost for each in rivals]
    others = [make_start(*each) for each in zip(rivals, factors, strict=True)]
    return make_start(best, min(factors, default=np.inf), others)


def refit_start(
    template: BodyModel,
    start: Start,
    poses: np.ndarray,
    frames: Sequence[int],
    voxels: Sequence[VoxelCloud],
    errors: np.ndarray,
    height: float | None = None,
) -> Start:
    """Return a start whose body is fitted to the surface voxels of M frames all over the take.

    template: that of the start, perhaps with a load, see `add_load`. poses: (M, D) of the start's
    body in the frames with these numbers, and their errors (M,). height: known stature, m.
    """
    model = ShapeModel(template)
    shape = np.zeros(len(model.deviation))
    shape[: len(start.shape)] = start.shape
    points = [select_person_points(cloud.grid, cloud.indices) for cloud in voxels]
    rows = [row for row, each in enumerate(points) if len(each) >= LEAST_VOXELS]
    if not rows:
        return start
    clouds = [Cloud(points[row], _modelled_part(template)) for row in rows]
    fitted = fit_body(
        model, SurfaceEvidence(clouds), Fitted(shape, poses[rows]),
        free=np.ones(len(shape), bool), height=height, steps=_FIT_STEPS,
    )  # fmt: skip
    numbers, best = [frames[row] for row in rows], int(np.argmin(errors[rows]))
    return Start(
        template, fitted.shape, fitted.poses, numbers, best, start.rival, _visible_height(clouds)
    )


def _visible_height(clouds: Sequence[Cloud]) -> float:
    """Return the usual height, m, of the visible part of the person."""
    return float(np.median([np.ptp(cloud.heights) for cloud in clouds]))


def _modelled_part(body: BodyModel) -> tuple[float, float]:
    """Return the range of heights, as shares of a person's, that the body models."""
    return (
        -np.inf if has_feet(body) else HIP_SHARE - _PART_MARGIN,
        np.inf if has_head(body) else HIP_SHARE + _PART_MARGIN,
    )


def _select_observations(
    scene: Scene, voxels: Sequence[AnyVoxels]
) -> tuple[Sequence[AnyVoxels], list[Cloud]]:
    """Return the voxels up to the frame in which the person leaves, and the person's points in
    them; both restricted to the part of the person that the scene's body models."""
    people = [select_person_points(of.grid, of.cloud().indices) for of in voxels]
    shown = [len(points) >= LEAST_VOXELS for points in people]
    if not shown[0]:
        later = "; a person appears later" if any(shown) else ""
        raise StartError(
            f"no person is in the first frame: {len(people[0])} surface voxels of "
            f"{voxels[0].grid.voxel_size:g} m; expected at least {LEAST_VOXELS} of a person{later}"
        )
    voxels = voxels[: [*shown, False].index(False)]
    part = _modelled_part(scene.body)
    clouds = [Cloud(points, part) for points in people[: len(voxels)]]
    if is_whole(scene.body):
        return voxels, clouds
    low, high = np.median([cloud.heights for cloud in clouds], 0)
    ends = [low + share * (high - low) for share in part]
    return [cut_by_height(scene.device, frame, *ends) for frame in voxels], clouds


class _Search:
    """Searches of the frames of a start for a person of unknown size and pose."""

    config: FilterConfig
    progress: Callable[[], object]

    def __init__(
        self,
        scene: Scene,
        voxels: Sequence[AnyVoxels],
        clouds: Sequence[Cloud],
        height: float | None,
        keep_shape: bool,
    ) -> None:
        self.model, self._voxels, self._clouds = ShapeModel(scene.body), voxels, clouds
        self._height = None if keep_shape else height
        self._free = np.full(len(self.model.deviation), not keep_shape)
        # In m/s, for a start lasts a second.
        self._velocity = (np.median(clouds[-1].points, 0) - np.median(clouds[0].points, 0))[:2]
        self._trackers = Trackers(scene)

    def try_headings(self, config: StartConfig) -> tuple[int, list[Hypothesis]]:
        """Return the frame in which the search over all headings fits best, and its best hypothesis
        and the best one that faces away from that one, of one pose each."""
        headings = np.arange(config.n_headings) * 2 * np.pi / config.n_headings
        wide = self.config.with_changes(noise=1.0, trunk_layers=0)
        tried = {round(k) for k in np.linspace(0, len(self._clouds) - 1, config.n_searched)}
        best: dict[int, list[Hypothesis]] = {}
        for frame in sorted(tried):
            cloud, shape = self._clouds[frame], np.zeros(len(self._free))
            if self._free.any():
                shape[0] = np.log((self._height or np.ptp(cloud.heights)) / stature(self.body))
            body = self.model.body(shape)
            tracker = self._trackers(loosen(body, np.pi / config.n_headings), wide)
            found = []
            for heading in headings:
                tracker.start(standing_pose(body, cloud, heading))
                found.append(self._judge(shape, [tracker.step(self._voxels[frame])]))
                self.progress()
            best[frame] = select_distinct(self.body, found, _AWAY)[:2]
        anchor = min(best, key=lambda frame: best[frame][0].cost)
        return anchor, best[anchor]

    def search_limbs(self, found: Hypothesis, frame: int) -> Hypothesis:
        """Return the hypothesis with one pose, in `frame`, after a search for one limb after the
        other, from where it is and from rest."""
        body, wide = self.model.body(found.shape), self.config.with_changes(noise=1.0)
        (pose,), loose = found.poses, loosen(body, 0.0)
        best: Hypothesis | None = None
        for limb in limb_masks(body):
            tracker = self._trackers(replace(body, sigma=np.where(limb, loose.sigma, 0.0)), wide)
            for start in (pose, np.where(limb, body.rest_pose, pose)):
                tracker.start(start)
                tried = self._judge(found.shape, [tracker.step(self._voxels[frame])])
                best = min(best or tried, tried, key=lambda each: each.cost)
                self.progress()
            pose = best.poses[0] if best else pose
        return best or found

    def follow(self, hypotheses: Sequence[Hypothesis], anchor: int) -> list[Hypothesis]:
        """Track the bodies of hypotheses from frame `anchor` to both ends, and fit the shape of
        each to some of the frames: all fits together take as long as one to every frame."""
        some = slice(anchor % len(hypotheses), None, len(hypotheses))
        tracked = list[tuple[np.ndarray, np.ndarray]]()
        for each in hypotheses:
            estimates = self._track_both_ways(self.search_limbs(each, anchor), anchor)
            tracked.append((each.shape, np.stack([estimate.pose for estimate in estimates])))
        evidence = SurfaceEvidence(self._clouds[some])

        def fit(followed: tuple[np.ndarray, np.ndarray]) -> Fitted:
            shape, poses = followed
            return fit_body(
                self.model, evidence, Fitted(shape, poses[some]),
                free=self._free, height=self._height, steps=_FIT_STEPS,
            )  # fmt: skip

        with one_blas_thread():  # which all threads share
            fits = list(map_in_threads(fit, tracked))
        refitted = list[Hypothesis]()
        for fitted, (_, poses) in zip(fits, tracked, strict=True):
            tracker = self._trackers(self.model.body(fitted.shape), self.config)
            poses[some] = fitted.poses
            again = list[Estimate]()
            for pose, voxels in zip(poses, self._voxels, strict=True):
                tracker.start(pose)
                again.append(tracker.step(voxels))
                self.progress()
            refitted.append(self._judge(fitted.shape, again))
        return refitted

    def _track_both_ways(self, found: Hypothesis, anchor: int) -> list[Estimate]:
        """Return the estimates of all frames."""
        (pose,) = found.poses
        tracker = self._trackers(self.model.body(found.shape), self.config)
        estimates: dict[int, Estimate] = {}
        for order in (range(anchor, len(self._voxels)), range(anchor, -1, -1)):
            tracker.start(pose)
            for frame in order:
                estimates[frame] = tracker.step(self._voxels[frame])
                self.progress()
        return [estimates[frame] for frame in sorted(estimates)]

    def _judge(self, shape: np.ndarray, estimates: Sequence[Estimate]) -> Hypothesis:
        """Return the hypothesis of these estimates."""
        poses = np.stack([estimate.pose for estimate in estimates])
        errors = [estimate.least_error[-1] for estimate in estimates]
        misfit = float(np.mean([estimate.misfit for estimate in estimates]))
        cost = float(np.mean(errors)) * misfit**_MISFIT_POWER
        cost *= walking_factor(self.body, poses, self._velocity)
        return Hypothesis(shape, poses, misfit, cost, int(np.argmin(errors)))

    @property
    def body(self) -> BodyModel:
        """The template."""
        return self.model.template


def standing_pose(body: BodyModel, cloud: Cloud, heading: float) -> np.ndarray:
    """Return the rest pose (D,) in the middle of the cloud, the feet at its lowest point; for a
    body without feet the highest points coincide."""
    low, high = cloud.heights
    middle = np.median(cloud.points, 0)
    pose = body.rest_pose.copy()
    cones = posed_cones(body, pose[None])[0]
    rise = low - lowest_point(cones) if has_feet(body) else high - highest_point(cones)
    root = {axis.kind: axis for axis in body.bones[0].axes}
    for kind, value in (("tx", middle[0]), ("ty", middle[1]), ("rz", heading)):
        pose[root[kind].dof] = root[kind].sign * value
    pose[root["tz"].dof] += root["tz"].sign * rise
    return pose


def highest_point(cones: np.ndarray) -> float:
    """Return the z, m, of the highest point of posed cones (C, 16)."""
    return float(max((cones[:, 2] + cones[:, 3]).max(), (cones[:, 6] + cones[:, 7]).max()))


def loosen(body: BodyModel, heading: float) -> BodyModel:
    """Return `body` with the standard deviations of a search without a known pose; heading: that of
    the root about z, rad."""
    sigma = np.where(root_mask(body), _PLACE, _BEND * (body.upper - body.lower))
    for axis in body.bones[0].axes:
        if axis.kind[0] == "r":
            sigma[axis.dof] = heading if axis.kind == "rz" else _TILT
    return replace(body, sigma=np.where(np.isfinite(sigma), sigma, np.pi))


def select_distinct(
    template: BodyModel, hypotheses: Sequence[Hypothesis], separation: float
) -> list[Hypothesis]:
    """Return the hypotheses, best first, whose headings differ by about `separation`, rad, or more
    from those of better ones in the frames that these fit best."""
    kept: list[Hypothesis] = []
    for hypothesis in sorted(hypotheses, key=lambda h: h.cost):
        cosines = [
            np.dot(*forward(template, np.stack([hypothesis.poses[better.best], better.pose])))
            for better in kept
        ]
        if all(cosine < np.cos(separation) for cosine in cosines):
            kept.append(hypothesis)
    return kept


def forward(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return the horizontal directions (M, 2), of length 1, in which the root's x axis points in
    poses (M, D)."""
    directions = bone_matrices(body, poses)[0][:, 0, :2, 0]
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def walking_factor(body: BodyModel, poses: np.ndarray, velocities: np.ndarray) -> float:
    """Return the cost factor of poses (M, D) of a person with these velocities (M, 2) or (2,), m/s:
    1 if they face the direction of motion or hardly move, higher if they move sideways or
    backwards."""
    velocities = np.broadcast_to(velocities, (len(poses), 2))
    speeds = np.linalg.norm(velocities, axis=1)
    if not (moving := speeds >= _LEAST_SPEED).any():
        return 1.0
    ahead = (forward(body, poses) * velocities).sum(1)[moving].sum() / speeds[moving].sum()
    return 1 + _BACKWARDS * (1 - float(ahead)) / 2


class Trackers:
    """`trackers(body, config)`: returns a tracker with these settings for a body of the template's
    structure.

    A start tries several bodies, and making a tracker takes as long as several of its steps. So
    there is one tracker for each set of settings, and it is given the next body. A tracker is valid
    until the next call with the same settings; call its `start` first.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._kept: dict[FilterConfig, DeviceTracker] = {}

    def __call__(self, body: BodyModel, config: FilterConfig) -> Tracker:
        """Return the tracker of `body` with the settings `config`."""
        kept = self._kept.get(config)
        if kept is not None:
            if kept.body is not body:
                kept.change_body(body)
            return kept
        tracker = make_filter(replace(self._scene, body=body), config)
        if isinstance(tracker, DeviceTracker):  # making a NumPy twin takes no time
            self._kept[config] = tracker
        return tracker
