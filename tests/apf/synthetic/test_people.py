"""Several synthetic walkers: apart, hidden by whom is nearer, true in the truth."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from apf.evaluation.truth import load_people_truth
from apf.reference.synthetic.scene import silhouette
from apf.synthetic.config import SceneConfig
from apf.synthetic.courses import make_walks, presence
from apf.synthetic.gait import GaitModel
from apf.synthetic.generate import generate
from apf.synthetic.render import SyntheticScene
from cl import Device

SMALL = SceneConfig(cameras=2, frames=12, fps=2, size=(64, 48), seed=3, people=3, visitor=True)


@pytest.mark.parametrize(("people", "seed"), [(2, 1), (3, 2), (5, 3)])
def test_walkers_stay_apart_and_in_the_room(people: int, seed: int) -> None:
    config = SceneConfig(people=people, seed=seed)
    gaits = [GaitModel(walk) for walk in make_walks(config)]
    motions = [gait.motion(np.arange(0, 12, 0.2)) for gait in gaits]
    pelvis = np.stack([motion.positions[:, 0, :2] for motion in motions])
    apart = np.linalg.norm(pelvis[:, None] - pelvis, axis=-1)
    assert apart[~np.eye(people, dtype=bool)].min() > 0.55
    assert np.abs(pelvis).max() < 1.7
    assert len({round(gait.skeleton.height, 3) for gait in gaits}) == people


def test_who_is_nearer_hides_the_others(device: Device) -> None:
    scene, hidden = SyntheticScene(SMALL, device), 0
    for index in (0, 7):
        numbers = scene.frame(index)[1]
        there = np.flatnonzero(presence(SMALL)[:, index])
        for view, camera in enumerate(scene.rig):
            drawn = [silhouette(camera, scene.posed(index, int(k))[0]) for k in there]
            depths = np.stack([np.where(mask > 0, depth, np.inf) for mask, depth in drawn])
            expected = np.where(np.isfinite(depths).any(0), there[depths.argmin(0)] + 1, 0)
            assert (numbers[view] != expected).mean() <= 0.004  # rays that graze a surface
            hidden += (np.isfinite(depths).sum(0) > 1).sum()
    assert hidden > 50


def test_a_visitor_is_in_the_truth_while_there(device: Device, tmp_path: Path) -> None:
    generate(tmp_path / "walk", SMALL, device)
    truth = load_people_truth(tmp_path / "walk" / "truth.npz")
    assert list(truth) == ["person1", "person2", "person3"]
    there = np.isfinite(truth["person3"].joints).all((1, 2))
    assert there.tolist() == [False] * 4 + [True] * 4 + [False] * 2 + [True] * 2
    assert np.isfinite(truth["person1"].joints).all()
    folder = tmp_path / "walk" / "truth_masks_people"
    shown = [cv2.imread(str(folder / f"cam01_{k:06d}.png"), cv2.IMREAD_UNCHANGED) for k in (0, 10)]
    assert set(np.unique(shown[0])) <= {0, 1, 2}
    assert {1, 2} <= set(np.unique(shown[1]))
    assert (tmp_path / "walk" / "truth_person3.trc").exists()
