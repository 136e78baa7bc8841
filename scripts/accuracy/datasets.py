"""Public datasets with markers as suites: BioCV, TotalCapture and Human3.6M, by their published
layouts.

BioCV (Evans et al., University of Bath, researchdata.bath.ac.uk/1258): in a participant's folder
NN.mp4.calib for each camera, and in a folder for each trial NN.mp4 and markers.c3d, whose joint
centres are LEFT_HIP and so on, in mm. TotalCapture (Trumble et al. 2017, CVSSP): calibration.cal,
videos TC_S1_walking1_cam1.mp4, and gt_skel_gbl_pos.txt in a folder of the trial's name, joints in
inches, Y up. Human3.6M (Ionescu et al. 2014): metadata.xml with the cameras, and in a subject's
folder Videos/ACTION.CAMERA.mp4 and MyPoseFeatures/D3_Positions/ACTION.cdf, 32 joints in mm, Z up.
The data themselves were not at hand: the readers are tested on files made in these layouts.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from apf.formats.c3d import read_c3d
from apf.formats.trc import JointSeries
from cl import InputError
from psfs.cameras.calibration.number_lists import read_surrey
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.files import read_text, write_atomically

DATASETS = ("biocv", "totalcapture", "human36m")
#: Joints by their names in BioCV, after LEFT_ or RIGHT_, and in TotalCapture, after Left or Right.
_BIOCV = {"SHO": "shoulder"} | {n.upper(): n for n in ("elbow", "wrist", "hip", "knee", "ankle")}
_TOTALCAPTURE = {
    "Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist",
    "UpLeg": "hip", "Leg": "knee", "Foot": "ankle",
}  # fmt: skip
_INCH, _TOTALCAPTURE_FPS = 0.0254, 60.0
#: Human3.6M's joints of the limbs by their rows out of 32, its cameras with their picture sizes,
#: its number of subjects, and its rate, frames/s.
_HUMAN36M = {
    "Right": {"UpLeg": 1, "Leg": 2, "Foot": 3, "Arm": 25, "ForeArm": 26, "Hand": 27},
    "Left": {"UpLeg": 6, "Leg": 7, "Foot": 8, "Arm": 17, "ForeArm": 18, "Hand": 19},
}
_HUMAN36M_CAMERAS = {
    "54138969": (1000, 1002), "55011271": (1000, 1000),
    "58860488": (1000, 1000), "60457274": (1000, 1002),
}  # fmt: skip
_HUMAN36M_SUBJECTS, _HUMAN36M_FPS = 11, 50.0
#: From Y up to Z up.
_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial of a dataset. videos: in the order of the cameras."""

    name: str
    rig: CameraRig
    videos: tuple[Path, ...]
    truth: JointSeries


def prepare_dataset(kind: str, folder: Path, suite: Path) -> Path:
    """Make a suite of a dataset's trials: a folder each with links to the videos, calibration.toml
    and truth.npz; return `suite`. Raises InputError if there is none, or one that is damaged."""
    readers = (read_biocv, read_totalcapture, read_human36m)
    count = 0
    for trial in dict(zip(DATASETS, readers, strict=True))[kind](folder):
        own, count = suite / trial.name, count + 1
        (own / "videos").mkdir(parents=True, exist_ok=True)
        for camera, video in zip(trial.rig, trial.videos, strict=True):
            link = own / "videos" / f"{camera.name}{video.suffix}"
            link.unlink(missing_ok=True)
            link.symlink_to(video.resolve())
        write_toml_tables(own / "calibration.toml", trial.rig)
        series = trial.truth
        with write_atomically(own / "truth.npz") as temporary:
            np.savez(
                temporary, joint_names=np.array(series.joint_names), joints=series.joints,
                fps=series.fps, frames=series.frames,
            )  # fmt: skip
    if not count:
        raise InputError(f"{folder}: no trial with videos and joints; expected {kind}'s layout")
    return suite


def read_biocv(folder: Path) -> Iterator[Trial]:
    """Yield the trials of a participant, or of all in a folder."""
    for path in sorted(folder.rglob("markers.c3d")):
        videos = sorted(path.parent.glob("[0-9][0-9].mp4"))
        given = [(video, path.parent.parent / f"{video.name}.calib") for video in videos]
        lacking = [calibration.name for _, calibration in given if not calibration.is_file()]
        if lacking or not videos:
            found = f"no {', '.join(lacking)}" if videos else "no videos 00.mp4, 01.mp4, ..."
            raise InputError(f"{path.parent}: {found} beside it; expected a file for each camera")
        cameras = [read_biocv_camera(file, f"cam{video.stem}") for video, file in given]
        truth = _select(path, read_c3d(path), _BIOCV, ("LEFT_", "RIGHT_"))
        name = f"{path.parent.parent.name}_{path.parent.name}"
        yield Trial(name, CameraRig(tuple(cameras)), tuple(videos), truth)


def read_biocv_camera(path: Path, name: str) -> Camera:
    """Read a camera: width and height, K by rows (9), the transformation from the world in mm by
    rows (16), and five coefficients as OpenCV's."""
    text = read_text(path, "BioCV's calibration")
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected numbers alone") from None
    if values.size != 32 or not np.isfinite(values).all():
        raise InputError(
            f"{path}: {values.size} numbers; expected 32: width, height, K (9), L (16) and 5 "
            "coefficients"
        )
    moved = values[11:27].reshape(4, 4)
    return Camera(
        name=name, K=values[2:11].reshape(3, 3), distortion=values[27:], R=moved[:3, :3],
        t=moved[:3, 3] / 1000, size=(int(values[0]), int(values[1])),
    )  # fmt: skip


def read_totalcapture(folder: Path) -> Iterator[Trial]:
    """Yield the trials of all subjects in a folder with calibration.cal."""
    found = sorted(folder.rglob("calibration.cal"))
    if len(found) != 1:
        raise InputError(f"{folder}: {len(found)} files calibration.cal; expected one")
    rig = CameraRig(tuple(_turn_upright(camera) for camera in read_surrey(found[0], None).cameras))
    every = {path.name.lower(): path for path in folder.rglob("TC_*.mp4")}
    for path in sorted(folder.rglob("gt_skel_gbl_pos.txt")):
        subject = next((p.name for p in path.parents if re.fullmatch(r"[Ss]\d+", p.name)), "")
        name = f"{subject.upper()}_{path.parent.name}"
        wanted = [f"tc_{name}_cam{k}.mp4".lower() for k in range(1, len(rig) + 1)]
        lacking = [video for video in wanted if video not in every]
        if lacking:
            raise InputError(f"{path}: no video {lacking[0]}; expected one for each camera")
        truth = _select(path, _read_positions(path), _TOTALCAPTURE, ("Left", "Right"))
        yield Trial(name, rig, tuple(every[video] for video in wanted), truth)


def _turn_upright(camera: Camera) -> Camera:
    return Camera(
        name=camera.name, K=camera.K, distortion=camera.distortion, R=camera.R @ _UPRIGHT.T,
        t=camera.t, size=camera.size,
    )  # fmt: skip


def _read_positions(path: Path) -> JointSeries:
    """Read joints: a line of names, then a line per frame, `x y z` of each between tabs."""
    lines = read_text(path, "TotalCapture's joints", 256 * 2**20).splitlines()
    names = lines[0].split() if lines else []
    try:
        rows = np.array([[float(v) for v in line.split()] for line in lines[1:] if line.strip()])
        joints = _INCH * rows.reshape(len(rows), len(names), 3)
    except ValueError:
        raise InputError(
            f"{path}: expected names, then as many times x y z in every line"
        ) from None
    frames = np.arange(len(joints))
    return JointSeries(tuple(names), joints @ _UPRIGHT.T, _TOTALCAPTURE_FPS, frames)


def read_human36m(folder: Path) -> Iterator[Trial]:
    """Yield the trials of all subjects in a folder with metadata.xml."""
    found = sorted(folder.rglob("metadata.xml"))
    if len(found) != 1:
        raise InputError(f"{folder}: {len(found)} files metadata.xml; expected one")
    numbers = _read_camera_numbers(found[0])
    for path in sorted(folder.rglob("D3_Positions/*.cdf")):
        home = path.parents[2]
        if not re.fullmatch(r"S([1-9]|1[01])", home.name):
            raise InputError(f"{path}: in a folder {home.name}; expected a subject's, S1 to S11")
        videos = [home / "Videos" / f"{path.stem}.{camera}.mp4" for camera in _HUMAN36M_CAMERAS]
        lacking = [video for video in videos if not video.is_file()]
        if lacking:
            raise InputError(f"{path}: no video {lacking[0].name}; expected one for each camera")
        cameras = _make_human36m_cameras(numbers, int(home.name[1:]))
        truth = _select(path, _read_cdf(path), _TOTALCAPTURE, ("Left", "Right"))
        name = f"{home.name}_{path.stem.replace(' ', '_')}"
        yield Trial(name, CameraRig(cameras), tuple(videos), truth)


def _read_camera_numbers(path: Path) -> np.ndarray:
    """Return the 300 numbers of metadata.xml: for each camera and subject three angles and the
    centre, mm, then for each camera fx fy cx cy k1 k2 k3 p1 p2."""
    try:
        text = ElementTree.fromstring(read_text(path, "Human3.6M's metadata")).findtext(".//w0")
        numbers = np.array([float(word) for word in (text or "").strip(" []\n").split()])
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path}: {error}; expected Human3.6M's metadata") from None
    if numbers.size != 300 or not np.isfinite(numbers).all():
        raise InputError(f"{path}: w0 has {numbers.size} numbers; expected 300 finite ones")
    return numbers


def _make_human36m_cameras(numbers: np.ndarray, subject: int) -> tuple[Camera, ...]:
    """Return the cameras of a subject. Their tangential terms are taken as OpenCV's; the published
    projection has half of them, which moves a point near the picture's corner by half a pixel."""
    count = len(_HUMAN36M_CAMERAS)
    outer = numbers[: -9 * count].reshape(count, _HUMAN36M_SUBJECTS, 6)[:, subject - 1]
    cameras = []
    for (name, size), (*angles, x, y, z), inner in zip(
        _HUMAN36M_CAMERAS.items(), outer, numbers[-9 * count :].reshape(count, 9), strict=True
    ):
        R = Rotation.from_euler("XYZ", angles).as_matrix()
        fx, fy, cx, cy, k1, k2, k3, p1, p2 = inner
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        t = -R @ np.array([x, y, z]) / 1000
        distortion = np.array([k1, k2, p1, p2, k3])
        cameras.append(Camera(name=name, K=K, distortion=distortion, R=R, t=t, size=size))
    return tuple(cameras)


def _read_cdf(path: Path) -> JointSeries:
    """Read the limbs' joints of a CDF file, whose variable Pose is (1, F, 96) mm."""
    try:
        import cdflib
    except ImportError:
        raise InputError(
            f"{path}: reading CDF needs cdflib; expected: pip install cdflib"
        ) from None
    try:
        pose = np.asarray(cdflib.CDF(path)["Pose"], float).reshape(-1, 32, 3)
    except Exception as error:  # whatever the parser meets in a damaged file
        raise InputError(f"{path}: {error}; expected a CDF file with Pose, 32 joints") from None
    places = {side + name: row for side, rows in _HUMAN36M.items() for name, row in rows.items()}
    joints = pose[:, list(places.values())] / 1000
    return JointSeries(tuple(places), joints, _HUMAN36M_FPS, np.arange(len(joints)))


def _select(
    path: Path, series: JointSeries, names: dict[str, str], sides: tuple[str, str]
) -> JointSeries:
    """Return the limbs' joints by our names. Raises InputError if one is missing."""
    wanted = {
        f"{side[0].lower()}_{ours}": f"{side}{theirs}"
        for side in sides
        for theirs, ours in names.items()
    }
    plain = [name.split(":")[-1] for name in series.joint_names]
    lacking = [name for name in wanted.values() if name not in plain]
    if lacking:
        raise InputError(f"{path}: no {', '.join(lacking)}; it has {', '.join(plain[:8])}, ...")
    columns = [plain.index(name) for name in wanted.values()]
    return JointSeries(tuple(wanted), series.joints[:, columns], series.fps, series.frames)
