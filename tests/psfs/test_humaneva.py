"""HumanEva's folders: takes, cameras, synchronisation, empty rooms."""

from pathlib import Path

import numpy as np
import pytest
from helpers import footage
from helpers.camera_texts import humaneva
from helpers.commands import succeed

from cl import InputError
from psfs.sequence import Sequence

NAMES = ("BW1", "C1", "C2")
#: Frames by which the videos are ahead of each other; the motion capture runs twice as fast.
AHEAD = (0, 2, 3)


def subject(root: Path, takes: tuple[str, ...] = ("Box_1", "Walking_1")) -> Path:
    folder = root / "S1"
    for view, (name, camera) in enumerate(zip(NAMES, footage.rig(3), strict=True)):
        calibration = folder / "Calibration_Data" / f"{name}.cal"
        calibration.parent.mkdir(parents=True, exist_ok=True)
        calibration.write_text(humaneva(camera))
        for take in takes:
            levels = [footage.grey(frame + 3 - AHEAD[view], 0) for frame in range(12)]
            footage.write_video(folder / "Image_Data" / f"{take}_({name}).avi", levels, fps=60)
            sync = folder / "Sync_Data" / f"{take}_({name}).ofs"
            sync.parent.mkdir(exist_ok=True)
            sync.write_text(f"5\n{100 + 2 * (5 - 1 - AHEAD[view])}\n2.0\n")
        footage.write_video(root / "Background" / f"Background_1_({name}).avi", [200] * 5)
    return folder


def test_it_opens_and_begins_together(tmp_path: Path) -> None:
    folder = subject(tmp_path)
    sequence = Sequence.open(folder, take="Box_1")
    assert (sequence.layout, sequence.rig.names) == ("HumanEva", list(NAMES))
    assert sequence.fps == 60 and len(sequence) == 9 and sequence.background_kind == "gaussian"
    np.testing.assert_allclose(sequence.rig.centres, footage.rig(3).centres, atol=1e-9)
    shown = sequence.read(0).images
    assert shown is not None and np.ptp(shown.reshape(3, -1).mean(1)) < footage.LOSS
    assert abs(shown.mean() - footage.grey(3, 0)) < footage.LOSS
    note = "frame 0 is frame 99.00 of Box_1.c3d, counted from 0, 2 per frame"
    assert any(note in text for text in sequence.notes)

    out = succeed("psfs", "info", folder, "--take", "Walking_1").out
    assert "HumanEva" in out and "BW1" in out and "--truth-start 99.00" in out
    succeed("psfs", "convert", str(folder), "--take", "Box_1", "-o", str(tmp_path / "own"))
    own = Sequence.open(tmp_path / "own")
    np.testing.assert_array_equal(own.read(1).images, sequence.read(1).images)


def test_what_is_not_there(tmp_path: Path) -> None:
    folder = subject(tmp_path)
    with pytest.raises(InputError, match=r"no `take` is stated; expected one of Box_1, Walking_1"):
        Sequence.open(folder)
    with pytest.raises(InputError, match="there is no take 'Jog_1'; expected one of Box_1"):
        Sequence.open(folder, take="Jog_1")
    (folder / "Sync_Data/Box_1_(C1).ofs").write_text("1 2")
    with pytest.raises(InputError, match=r"Box_1_\(C1\)\.ofs: 2 numbers; expected three"):
        Sequence.open(folder, take="Box_1")
    (folder / "Sync_Data/Box_1_(C1).ofs").unlink()
    (folder / "Calibration_Data/C2.cal").unlink()
    sequence = Sequence.open(folder, take="Box_1")
    assert sequence.rig.names == ["BW1", "C1"] and len(sequence) == 12
    assert any("no .ofs for every camera" in note for note in sequence.notes)
    assert any("C2 is not calibrated" in note for note in sequence.notes)


def test_cameras_of_tsai(tmp_path: Path) -> None:
    folder = subject(tmp_path, ("Box_1",))
    for path in (folder / "Calibration_Data").glob("*.cal"):
        sensor = [1.0, 1.0, 0.01, 0.01, 0.01, 0.01, 32.0, 24.0, 1.0]
        path.write_text(" ".join(map(str, [*sensor, 0.6, 0.3, 0, 0, 3000, 2.0, 0, 0])))
    sequence = Sequence.open(folder)  # the only take
    assert [camera.kappa for camera in sequence.rig] == pytest.approx([0.3 * 0.36] * 3)
    np.testing.assert_allclose(sequence.rig[0].t, [0, 0, 3])
