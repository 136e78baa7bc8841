"""Silhouette likelihood maps (Song et al. eq. 1-2) on an OpenCL device."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cl import Array, Device, Launch
from cl.signature import Argument
from cl.workgroups import pixel_pack, row_group, size_defines
from psfs.background.chroma_key import ChromaKey, key_launch
from psfs.background.config import BackgroundConfig
from psfs.background.light import light_launch, sampled_scene, steady_light
from psfs.cameras.camera import BLOCK, CameraRig
from psfs.cameras.rig_geometry import CELL, cells, floor_points
from psfs.common.progress import map_in_threads
from psfs.common.ranges import check_stack
from psfs.silhouettes.appearance import BINS, Foreground, ForegroundPrior
from psfs.silhouettes.config import PIXEL, SPAN, SilhouetteConfig
from psfs.silhouettes.hidden import hide_launch

if TYPE_CHECKING:
    from psfs.background.gaussian import Background


class Silhouette:
    """Computation of evidence maps (V, H, W) int8, in counts of `config.evidence.step` nats, from
    pictures or masks.

    A pixel's evidence is log(SLM / 0.5) for P(O) = 0.5, see `EvidenceConfig.log_odds`. The maps
    have one byte per pixel, because the occupancy kernel gathers from them: on PoCL, int8 maps took
    59 ms for 8 cameras and 2.3 M voxels, float32 maps 71 ms. Pixels outside a smaller camera's
    picture hold 0; the rig's hidden pixels hold `UNKNOWN`, unless they show foreground. If
    `background` is None, the maps come from ready masks; if it is a `ChromaKey`, from the
    chromaticity.

    The foreground is uniform (Song et al.: for the first frame) until `foreground` was fitted to a
    reconstruction. `foreground` is None for masks, for a screen of one colour, and if
    `AppearanceConfig.learn` is off.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        background: Background | None,
        config: SilhouetteConfig | None = None,
    ) -> None:
        check_stack(len(rig), rig.picture)
        self.device, self._config = device, config or SilhouetteConfig()
        self.rig, self.background = rig, background
        self.foreground: Foreground | None = None
        shape = (len(rig), rig.height, rig.width)
        self.evidence = device.empty(shape, np.int8, "the silhouette maps")
        self._sizes = device.to_device(np.array([c.size for c in rig], np.int32), "picture sizes")
        if background is None:
            self.input = device.empty(shape, np.uint8, "the masks")
            table = device.to_device(
                self._config.evidence.mask_counts(np.arange(256)), "the evidence table"
            )
            mapped = {"masks": self.input, "table": table, "evidence": self.evidence}
            size = (rig.width, rig.height)
            self._launches = [
                self._launch("silhouette", "mask_silhouette", size, sizes=self._sizes, **mapped)
            ]
        else:
            self.input = device.empty((*shape, 3), np.uint8, "the pictures")
            self._launches = self._from_pictures(background)
        hidden = rig.hidden
        if hidden is not None:
            self._launches.append(hide_launch(device, hidden, self.evidence))

    def __call__(self, pictures: np.ndarray) -> Array:
        """Enqueue the upload and the evidence maps of pictures (V, H, W, 3) uint8 BGR, or masks (V,
        H, W) uint8."""
        self.input.set(pictures)
        return self.compute()

    def compute(self) -> Array:
        """Enqueue the evidence maps of the pictures or masks in `input`."""
        for launch in self._launches:
            launch()
        return self.evidence

    def restart(self) -> None:
        """Forget all earlier frames: the person's colours and location."""
        if self.foreground is not None:
            self.foreground.restart()

    def _from_pictures(self, background: Background) -> list[Launch]:
        device, rig, config = self.device, self.rig, self._config
        bordered = (len(rig), rig.height + 2, rig.width + 2)
        ratios = device.zeros(bordered, np.int8, "the likelihood ratios")
        scene: dict[str, Array] = {}
        if isinstance(background, ChromaKey):
            before = [key_launch(device, background, config.evidence, self.input, ratios)]
        else:
            before, scene = self._before_scene(background, ratios)
        table = device.to_device(config.evidence.ratio_counts(), "the evidence table")
        mapped = {"ratios": ratios, "sizes": self._sizes, "table": table}
        mapped["evidence"] = self.evidence
        plain = not scene or not (config.rim.on or config.smoothing.reach)
        # Which spans of pixels show foreground; the border is and stays 0.
        spans = (len(rig), cells(rig)[0] + 2, -(-rig.width // SPAN) + 2)
        shown = None if plain else device.zeros(spans, np.uint8, "the foreground's spans")
        launches = [
            *before,
            self._launch("silhouette", "silhouette", self._packs(), **mapped, shown=shown),
        ]
        return launches if shown is None else [*launches, *self._rims(scene, mapped, shown)]

    def _before_scene(
        self, background: Background, ratios: Array
    ) -> tuple[list[Launch], dict[str, Array]]:
        """Return the launches from pictures to log ratios of scene over foreground, and the arrays
        that the ratios of mixed pixels need: the scene, the person's colours and the location
        prior."""
        device, rig, config = self.device, self.rig, self._config
        rows, columns = cells(rig)
        scene = device.empty((len(rig), 8, rig.height, rig.width), np.float32, "the background")
        size = scene.nbytes // len(rig)
        fill = partial(background_planes, background, config.background)
        # Two at a time, and one that is uploaded: those of all views of 4K would take a gigabyte.
        for view, planes in enumerate(map_in_threads(fill, range(len(rig)), 2)):
            scene.region(view * size, planes.shape, np.float32).set(planes)
        prior = ForegroundPrior(
            device.zeros(BINS**3, np.int8, "the foreground's colours"),
            device.zeros((len(rig), rows, columns), np.int8, "the location prior"),
        )
        shade = device.empty((len(rig), rows + 2, columns + 2), np.uint8, "the floor's light")
        light = device.to_device(steady_light(len(rig)), "the light")
        cameras = device.to_device(rig.packed(), "the cameras")
        points = floor_points(rig, config.floor.seen_height).astype(np.float32)
        floor = device.to_device(points, "the floor")
        if config.appearance.learn:
            self.foreground = Foreground(device, rig, config, self.input, self.evidence, prior)
        luma = device.empty((len(rig), rig.height, rig.width), np.uint8, "the pictures' luma")
        seen = {"images": self.input, "background": scene, "light": light}
        known = prior._asdict()
        launches = []
        if config.light.follow:
            samples = sampled_scene(rig, background, config.background)
            launches.append(light_launch(device, rig, samples, self.input, light))
        launches += [
            self._launch(
                "floor_light",
                "floor_light",
                (columns + 2, rows + 2),
                floor=config.floor.height,
                cameras=cameras,
                points=floor,
                floor_light=shade,
                **seen,
            ),
            self._launch(
                "silhouette",
                "log_ratio",
                self._packs(),
                **seen,
                **known,
                floor_light=shade,
                sizes=self._sizes,
                ratios=ratios,
                luma=luma,
            ),
        ]
        return launches, {"luma": luma, **seen, **known}

    def _rims(
        self, scene: dict[str, Array], mapped: dict[str, Array], shown: Array
    ) -> list[Launch]:
        """Return the launches that recompute the log ratios of the rim's pixels and smooth the
        evidence near foreground."""
        rows, _ = cells(self.rig)
        columns = -(-self.rig.width // max(CELL, pixel_pack(self.device, self.rig.width)))
        luma = scene.pop("luma")
        rim = {**scene, "shown": shown, "evidence": self.evidence, "ratios": mapped["ratios"]}
        return [
            self._launch("silhouette", "rim", (columns, rows), **rim),
            self._launch(
                "silhouette",
                "smoothed_evidence",
                self._packs(),
                **mapped,
                luma=luma,
                shown=shown,
            ),
        ]

    def _packs(self) -> tuple[int, int]:
        """Return the number of packs of pixels along a row, and the number of rows."""
        return -(-self.rig.width // pixel_pack(self.device, self.rig.width)), self.rig.height

    def _defines(self, stage: str) -> dict[str, int | float]:
        config = self._config
        evidence, light = config.evidence, config.background
        sizes = size_defines(self.device, self.rig.picture)
        if stage == "floor_light":
            return {
                **sizes,
                **self.rig.defines,
                "SHADOW_HIGH": float(light.shadow_high),
                "FLOOR_LIT": PIXEL.floor_lit,
                "FLOOR_ENOUGH": PIXEL.floor_enough,
                "FLOOR_LEFT": PIXEL.floor_nearest,
                "CELL": CELL,
            }
        return {
            **sizes,
            "PACK": pixel_pack(self.device, self.rig.width),
            "SHADOW_LOW": float(light.shadow_low),
            "SHADOW_HIGH": float(light.shadow_high),
            "FLOOR_LOW": PIXEL.floor_low,
            "FLOOR_VARIANCE": PIXEL.floor_std**2,
            "FLOOR_DEPTH": PIXEL.floor_depth**-2,
            "LIT_VARIANCE": PIXEL.floor_lit_std**2,
            "FULLY_LIT": PIXEL.floor_fully_lit,
            "RIM": int(config.rim.on),
            "RIM_SHARE": PIXEL.rim_share,
            "RIM_CHROMA": PIXEL.rim_chroma_noise**-2,
            "RIM_COST": PIXEL.rim_cost,
            **{"SMOOTH_REACH": config.smoothing.reach, "SPAN": SPAN},
            "SUM_REACH": config.smoothing.sum_reach,
            "CONTRAST": PIXEL.contrast**-2,
            "STEPS": float(evidence.ratio_steps),
            "LOWEST": evidence.ratio_range[0],
            "HIGHEST": evidence.ratio_range[1],
            "BINS": BINS,
            "CELL": CELL,
        }

    def _launch(
        self, stage: str, name: str, size: tuple[int, int], /, **arguments: Argument
    ) -> Launch:
        kernel = self.device.kernel(f"reconstruction/{stage}", name, **self._defines(stage))
        shape, group = (*size, len(self.rig)), row_group(self.device)
        return self.device.launch(kernel, shape, group, picture=self.rig.picture, **arguments)


def background_planes(background: Background, config: BackgroundConfig, view: int) -> np.ndarray:
    """Return (8, H, W) float32 of a view: mean (3), 1 / sigma^2 (3), log of the background's peak
    density over the uniform foreground's, 1 / shadow_width^2."""
    # Work plane by plane: sums over a pixel's three channels take several times as long.
    mean, std = (np.moveaxis(array[view], -1, 0) for array in (background.mean, background.std))
    planes = np.empty((8, *mean.shape[1:]), np.float32)
    parts = -(-planes[0].size // BLOCK)  # those of all of 4K would take a gigabyte
    for rows in np.array_split(np.arange(planes.shape[1]), min(parts, planes.shape[1])):
        band = np.s_[:, rows[0] : rows[-1] + 1]
        here, sigma = planes[band], np.maximum(std[band], np.float32(config.sigma_floor), order="C")
        here[:3], here[3:6] = mean[band], sigma**-2
        here[6] = np.log(256 / (np.sqrt(2 * np.pi) * sigma)).sum(0)
        here[7] = config.shadow_width(np.moveaxis(here[:3], 0, -1)) ** -2
    return planes
