"""The colours of the parts of a body in the pictures, and their kernels against the twin."""

from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import observe_pictures
from helpers.worlds import World

from apf.body.kinematics import posed_cones
from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.config import FilterConfig
from apf.likelihood.part_colour import (
    N_CODES,
    N_COLOURS,
    PartColours,
    find_part,
    fit_palette,
    list_part_names,
    list_scored_parts,
)
from apf.likelihood.voxel import choose_cone_sampling, make_sample_rows
from apf.reference.image_objective.render import draw_hypotheses
from apf.reference.likelihood.part_colour import (
    ColourModel,
    colour_means,
    compute_ratios,
    count_codes,
    encode_colours,
)
from cl import Device
from psfs.cameras.camera import CameraRig

SONG = bodies.named("song31")
RIG = scenes.ring(4, (161, 121))
SHIRT, SKIN, HIDDEN, NOTHING = 3, 9, N_CODES - 2, N_CODES - 1


def painted(rig: CameraRig, pose: np.ndarray, arms: int) -> np.ndarray:
    """Codes (V, H, W) of pictures of a person in this pose: `arms` at arms and head, else SHIRT."""
    bare = [cone.name[2:] in ("forearm", "upper_arm") or cone.name == "head" for cone in SONG.cones]
    code = np.array([NOTHING, *np.where(bare, arms, SHIRT)], np.uint8)
    codes = np.full((len(rig), rig.height, rig.width), NOTHING, np.uint8)
    for view, drawn in enumerate(draw_hypotheses(SONG, rig, pose[None])):
        parts = drawn[0][0]
        codes[view, : parts.shape[0], : parts.shape[1]] = code[parts]
    return codes


def means(poses: np.ndarray, codes: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """The term's means (N,) over the cameras."""
    rows = make_sample_rows(choose_cone_sampling(SONG, 0.06))
    look = ColourModel(ratios, list_scored_parts(SONG, rows), rows)
    cones = posed_cones(SONG, poses)
    views = zip(RIG, codes, strict=True)
    return np.mean([colour_means(camera, SONG, cones, view, look) for camera, view in views], 0)


@pytest.mark.parametrize("arms", [SKIN, SHIRT])
def test_an_arm_before_the_trunk_is_found_by_its_colour(arms: int) -> None:
    """Learnt with hanging arms; then one crosses the belly. Of one colour, nothing tells."""
    counts = count_codes(RIG, SONG, SONG.rest_pose, painted(RIG, SONG.rest_pose, arms))
    ratios = compute_ratios(counts)
    poses = np.stack([SONG.rest_pose, bodies.crossing()])
    hanging, right = means(poses, painted(RIG, bodies.crossing(), arms), ratios)
    if arms == SHIRT:
        assert abs(right - hanging) < 1e-6
        return
    assert right > hanging + 0.03
    # A pose that has the arm on the belly learns no shirt of an arm that hangs, and is hidden.
    counts = count_codes(RIG, SONG, bodies.crossing(), painted(RIG, SONG.rest_pose, SKIN))
    forearm = list_part_names(SONG).index("forearm")
    assert counts[forearm, SHIRT] < 0.25 * counts[forearm].sum()


def test_left_and_right_are_one_part_and_hands_are_as_bare_as_the_head() -> None:
    names, cones = list_part_names(SONG), SONG.cone_names
    assert len(names) == len(set(names)) == 6  # torso, thigh, calf, upper arm, forearm, head
    for forearm in (cones.index("l_forearm"), cones.index("r_forearm")):
        shares = [names[find_part(SONG, forearm, share)] for share in (0.1, 0.6, 0.9)]
        assert shares == ["forearm", "forearm", "head"]
    assert find_part(SONG, cones.index("hips"), 0.5) == -1
    rows = make_sample_rows(choose_cone_sampling(SONG, 0.06))
    parts, of_torso = list_scored_parts(SONG, rows), rows[:, 0] == cones.index("torso")
    assert (parts[of_torso] == -1).all() and (parts[~of_torso] >= 0).all()


def test_a_palette_tells_a_persons_colours_apart() -> None:
    random = np.random.default_rng(0)
    colours = np.array([(90, 80, 60), (120, 150, 200), (40, 40, 45)])
    chosen = random.integers(0, 3, (2, 40, 50))
    noisy = colours[chosen] + random.normal(0, 4, (2, 40, 50, 3))
    pictures = np.clip(noisy, 0, 255).astype(np.uint8)
    silhouettes = np.full(chosen.shape, 255, np.uint8)
    palette = fit_palette(pictures, silhouettes)
    assert palette is not None and palette.shape == (N_COLOURS,)
    np.testing.assert_array_equal(palette, fit_palette(pictures, silhouettes))
    codes = encode_colours(pictures, silhouettes, palette)
    seen = [np.unique(codes[chosen == k]) for k in range(3)]
    assert len(set().union(*seen)) == sum(map(len, seen))
    silhouettes[:] = 0
    assert fit_palette(pictures, silhouettes) is None
    assert (encode_colours(pictures, silhouettes, palette) == NOTHING).all()


@pytest.mark.parity("tracking/part_colour.encode_colours")
def test_codes_agree_with_the_twin(device: Device) -> None:
    rig = scenes.ring(3)
    shape = (len(rig), rig.height, rig.width, 3)
    images = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    here, twin, voxels = observe_pictures(device, rig, images)
    colours, codes = here.terms["part_colour"], twin.terms["part_colour"].codes
    assert isinstance(colours, PartColours) and colours.known
    assert ((colours.codes.get() == NOTHING) == (codes == NOTHING)).mean() > 0.99
    shown = here.reprojection.maps.get()
    palette = fit_palette(images, shown[..., 0])
    shown[:, ::2, :, 0] ^= 1  # hidden, see `Reprojection`
    here.reprojection.maps.set(shown)
    colours.observe(voxels, voxels.pictures())
    found = colours.codes.get()
    np.testing.assert_array_equal(found, encode_colours(images, shown[..., 0], palette))
    assert (found == HIDDEN).sum() > 100 and 0.02 < (found != NOTHING).mean() < 0.9


@pytest.mark.parity("tracking/part_colour.count_colours", "tracking/part_colour.learn_colours")
def test_trackers_learn_at_their_estimates(device: Device) -> None:
    """How, test_terms.py compares with the twin."""
    world = World(device)
    tracker = AnnealedParticleFilter(world.scene(), FilterConfig.create(n_particles=37, n_layers=2))
    random, shape = np.random.default_rng(0), (len(world.rig), world.rig.height, world.rig.width, 3)
    pictures = device.to_device(random.integers(0, 256, shape).astype(np.uint8))
    tracker.start(world.pose(0))
    colours = tracker.likelihood.terms["part_colour"]
    voxels: Any = world.voxels(0)
    voxels.pictures = lambda: pictures
    counts = count_codes(world.rig, SONG, tracker.step(voxels).pose, colours.codes.get())
    assert np.abs(colours.histograms.get() - counts).sum() < 0.05 * counts.sum() > 5
    assert colours.ratios.get().any()
    tracker.start(world.pose(0))
    assert not colours.ratios.get().any()
