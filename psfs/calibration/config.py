"""How cameras are calibrated, with units and where the values come from."""

from __future__ import annotations

from dataclasses import dataclass

from psfs.common.ranges import check_range


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings of a calibration.

    noise: px, errors of detected points beyond which the robust loss grows slower than the square;
    detectors reach 0.1 to 0.5. outlier: px, errors beyond which a sighting is left out before the
    last bundle adjustment. shared_boards, shared_wands: frames that two cameras must share so that
    one can be placed by the other; a board's pose is known from each picture, a wand's points only
    from many. most_frames: of the footage, evenly spread. few_frames: sightings of a camera below
    which it is said to see too little. coverage: share of a camera's picture, of 8 x 6 cells, that
    should have held the target. centre_sigma: of the picture's width, deviation of the principal
    point from the picture's middle. aspect_sigma: relative, of fx and fy. lens_sigma: of k1, k2.
    tangential_sigma: of p1, p2. The sigmas hold what the footage does not tell; lenses are well
    within them. inconsistent: how many times worse than is usual among the cameras one must fit
    the others' targets to be named.
    """

    noise: float = 1.0
    outlier: float = 8.0
    shared_boards: int = 3
    shared_wands: int = 10
    most_frames: int = 300
    few_frames: int = 12
    coverage: float = 0.3
    centre_sigma: float = 0.05
    aspect_sigma: float = 0.01
    lens_sigma: float = 0.3
    tangential_sigma: float = 0.01
    inconsistent: float = 2.0

    def __post_init__(self) -> None:
        for name in ("noise", "outlier"):
            check_range(name, getattr(self, name), 0, 1000)
        for name in ("shared_boards", "shared_wands", "few_frames"):
            check_range(name, getattr(self, name), 1, 10_000, ends=True)
        check_range("most_frames", self.most_frames, 3, 100_000, ends=True)
        check_range("coverage", self.coverage, 0, 1, ends=True)
        for name in ("centre_sigma", "aspect_sigma", "lens_sigma", "tangential_sigma"):
            check_range(name, getattr(self, name), 0, 10)
        check_range("inconsistent", self.inconsistent, 1, 100)
