"""A term of the likelihood in a package of its own, docs/add_a_stage.md, is installed and used."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import fail

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "tests" / "example_term"
TERMS = "silhouette,near_limits=0.7"
SMALL = ["--particles", "40", "--layers", "2", "--voxel-size", "0.05", "--frames", "0:1"]
TRACK = [*SMALL, "--one-way", "--all-cameras", "--no-overlay", "--no-report"]
TRACK += ["--likelihood", TERMS]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process that has the package installed."""
    source, site = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("site")
    shutil.copytree(PACKAGE, source / "package", ignore=shutil.ignore_patterns("__pycache__"))
    build = ["build_py", "--build-lib", str(site), "egg_info", "--egg-base", str(site)]
    setup = [sys.executable, "-c", "import setuptools; setuptools.setup()", "-q", *build]
    subprocess.run(setup, cwd=source / "package", check=True)  # pip would need the package wheel
    paths = [str(site), str(ROOT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def test_a_tracker_uses_the_term_whose_parity_test_passes(
    small_walk: Path, tmp_path: Path, installed: dict[str, str]
) -> None:
    """The test of all terms has a row for it; a process with the package then tracks with it."""
    tests = ["tests/apf/likelihood/test_terms.py", "-k", "near_limits and stick", "-n", "0"]
    words = ["track", str(small_walk), "-o", str(tmp_path), *TRACK]
    words += ["--init", str(small_walk / "truth.npz")]
    code = (
        "import sys, pytest; from apf.cli import main;"
        f"sys.exit(pytest.main({['-p', 'no:cacheprovider', *tests]!r}) or main({words!r}))"
    )
    command = [sys.executable, "-c", code]
    ran = subprocess.run(command, cwd=ROOT, env=installed, capture_output=True, text=True)
    assert ran.returncode == 0 and " passed" in ran.stdout, ran.stdout + ran.stderr
    track = np.load(tmp_path / "track.npz")
    settings = json.loads(str(track["provenance"]))["filter"]
    assert settings["near_limits_weight"] == 0.7 and settings["near_limits_free"] == 0.8
    assert np.isfinite(track["poses"]).all()


def test_without_the_package_there_is_no_such_term(small_walk: Path, tmp_path: Path) -> None:
    said = fail("apf", "track", small_walk, "-o", tmp_path / "out", *TRACK)
    assert "no term 'near_limits'" in said
