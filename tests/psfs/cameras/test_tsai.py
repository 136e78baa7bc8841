"""Tsai's camera model: text files, and projections compared with an implementation of the
equations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import scenes
from scipy.spatial.transform import Rotation

from cl import Device, InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.reference.surface import occupancy, smooth
from psfs.voxels.bricks import Bricks

SIZE = (644, 488)
#: mm and radians: an analog camera, whose pixels are wider than high, that sees 60 degrees.
CAMERA = {
    "Ncx": 768.0, "Nfx": 644.0, "dx": 0.0084, "dy": 0.0098, "dpx": 0.0084 * 768 / 644,
    "dpy": 0.0098, "Cx": 320.5, "Cy": 241.25, "sx": 1.0123, "f": 5.6, "kappa1": 8.1e-3,
    "Tx": 120.0, "Ty": 905.0, "Tz": 4210.0, "Rx": 1.9, "Ry": -0.34, "Rz": 0.21,
}  # fmt: skip


def projected(values: dict[str, float], point: np.ndarray) -> np.ndarray:
    """Project one point, mm, by Rymut 2016 eq. (2.22)-(2.26); NumPy's eigenvalues solve the
    cubic."""
    turn = Rotation.from_euler("xyz", [values[k] for k in ("Rx", "Ry", "Rz")])
    x, y, z = turn.apply(point) + np.array([values[k] for k in ("Tx", "Ty", "Tz")])
    u = values["f"] * np.array([x, y]) / z
    radius = float(np.hypot(*u))
    roots = np.roots([values["kappa1"], 0, 1, -radius]) if values["kappa1"] else np.array([radius])
    real = roots[np.abs(roots.imag) < 1e-9].real
    distorted = u / radius * real[real > 0].min()
    scale, centre = sensor(values)
    return distorted * scale + centre


def sensor(values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels per mm (2,) and the pixel (2,) of the sensor's middle."""
    scale = np.array([values["sx"] / values["dpx"], 1 / values["dpy"]])
    return scale, np.array([values["Cx"], values["Cy"]])


def unprojected(values: dict[str, float], pixel: np.ndarray) -> np.ndarray:
    """Undistort a pixel to normalised coordinates by eq. (2.24)-(2.26)."""
    scale, centre = sensor(values)
    distorted = (pixel - centre) / scale
    return distorted * (1 + values["kappa1"] * distorted @ distorted) / values["f"]


def write(
    folder: Path, values: dict[str, float], suffix: str = ".cpar", named: bool = False
) -> None:
    folder.mkdir(exist_ok=True)
    lines = [f"{name} = {value!r}" if named else repr(value) for name, value in values.items()]
    (folder / f"cam1{suffix}").write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("kappa1", [8.1e-3, 0.0, -4e-3, 1e-10])
def test_points_agree_with_the_equations(tmp_path: Path, kappa1: float) -> None:
    values = CAMERA | {"kappa1": kappa1}
    write(tmp_path / "calib", values)
    (camera,) = read_calibration(tmp_path / "calib", sizes=SIZE)
    random = np.random.default_rng(0)
    points = random.uniform([-1200, -900, -200], [1200, 900, 1900], (200, 3))
    pixels, depth = camera.project(points / 1000)
    expected = np.array([projected(values, point) for point in points])
    shown = ((expected > -50) & (expected < np.add(SIZE, 50))).all(1)
    assert shown.sum() > 60 and (depth[shown] > 0).all()
    np.testing.assert_allclose(pixels[shown], expected[shown], atol=1e-6)

    back = camera.undistort(expected[shown])
    plane = np.array([unprojected(values, pixel) for pixel in expected[shown]])
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    np.testing.assert_allclose(back, plane * focal + camera.K[:2, 2], atol=1e-6)
    rays = camera.rays(expected[shown])
    along = points[shown] / 1000 - camera.centre
    away = np.cross(rays, along) / np.linalg.norm(rays, axis=1, keepdims=True)
    assert np.abs(away).max() < 1e-9  # m


def test_layouts_units_and_a_folder_s_own_files(tmp_path: Path) -> None:
    write(tmp_path / "numbers", CAMERA, ".cal")
    write(tmp_path / "names", CAMERA, ".txt", named=True)
    degrees = {**CAMERA, **{k: float(np.degrees(CAMERA[k])) for k in ("Rx", "Ry", "Rz")}}
    text = "\n".join(
        f"{k} = {v!r} {'[deg]' if k[0] == 'R' else '[mm]'}" for k, v in degrees.items()
    )
    write(tmp_path / "printed", CAMERA)
    (tmp_path / "printed/cam1.cpar").write_text(
        f"Noncoplanar calibration (full optimization)\n{text}\n"
    )
    first = read_calibration(tmp_path / "numbers", sizes=SIZE)
    for name in ("names", "printed"):
        other = read_calibration(tmp_path / name, sizes=SIZE)
        np.testing.assert_allclose(other[0].packed(), first[0].packed(), rtol=1e-6)
    assert first.unit == "mm" and first[0].kappa == pytest.approx(8.1e-3 * 5.6**2)
    half = read_calibration(tmp_path / "numbers", unit="cm", sizes=SIZE)
    np.testing.assert_allclose(half[0].t, 10 * first[0].t)
    write_toml_tables(tmp_path / "own.toml", first)
    own = read_calibration(tmp_path / "own.toml")
    np.testing.assert_allclose(own[0].packed(), first[0].packed(), rtol=1e-6)


def test_two_distortions_are_refused() -> None:
    with pytest.raises(InputError, match="distortion beside Tsai's kappa"):
        replace(scenes.ring(1)[0], kappa=0.1)


def test_kernels_project_by_these_lenses(device: Device) -> None:
    """And by those of fish eyes: each of three cameras has another one."""
    lenses = (
        {"kappa": 0.6}, {"kappa": -0.15}, {"fisheye": True, "distortion": [0.1, 0.02, -0.01, 5e-3]}
    )  # fmt: skip
    straight = scenes.without_distortion(scenes.ring(3)).cameras
    bent = tuple(replace(camera, **lens) for camera, lens in zip(straight, lenses, strict=True))
    rig = CameraRig(bent)
    grid, config = scenes.small_grid(), scenes.ALL_BRICKS
    evidence = scenes.patches_of_evidence(rig, len(rig), 8)
    maps = device.to_device(evidence)
    found = scenes.carve(Bricks(device, rig, grid, maps, 0.1, config))
    expected = smooth(occupancy(rig, grid, evidence, 0.1, config), True)
    assert (np.abs(found - expected) > 1e-5).mean() < 1e-2
    for view, camera in enumerate(straight):
        other = CameraRig((*bent[:view], camera, *bent[view + 1 :]))
        plain = smooth(occupancy(other, grid, evidence, 0.1, config), True)
        assert (np.abs(found - plain) > 1e-5).mean() > 0.02
