"""`psfs check` judges by the silhouettes that the run was made of."""

from pathlib import Path

import numpy as np
import pytest
from helpers.commands import succeed

from cl import Device
from psfs.diagnostics.reprojection_iou import Checker, volume_region, whole_silhouettes
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.reconstructor import Reconstructor
from psfs.session import Session, SessionSettings
from psfs.silhouettes.silhouette import Silhouette


@pytest.fixture(scope="module")
def run(small_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> ReconstructionFolder:
    """Four frames of a walk, before a background whose silhouettes learn."""
    out = tmp_path_factory.mktemp("check") / "out"
    command = ["reconstruct", str(small_walk), "-o", str(out), "--no-colour"]
    succeed("psfs", *command, "--voxel-size", "0.04")
    return ReconstructionFolder.open(out)


def test_the_silhouettes_are_those_of_the_run(run: ReconstructionFolder, device: Device) -> None:
    sequence, config = run.sequence(), run.config
    region = volume_region(sequence.rig, run.grid)
    reconstruct = Reconstructor(device, sequence.rig, run.grid, sequence.background, config)
    unlearnt = Silhouette(device, sequence.rig, sequence.background, config.silhouette)
    checker = Checker(Session(sequence, device, SessionSettings(config)), run.grid)
    for frame in sequence:
        reconstruct(frame)
        shown = checker.silhouettes(frame)
        expected = reconstruct.evidence() > 0
        np.testing.assert_array_equal(shown, whole_silhouettes(expected, region))
        assert frame.images is not None
        alone = (unlearnt(frame.images).get() > 0) & region
        assert not np.array_equal(shown, whole_silhouettes(alone, region))
