"""Several people on one reconstruction: their expected places, and their tracks."""

from __future__ import annotations

import numpy as np
import pytest

from apf.body import load_body
from apf.body.spheres import ALONG
from apf.reference.people import expect_spheres
from apf.tracking.places import SLOTS, Places
from cl import Device


@pytest.mark.parity("tracking/people.expect_spheres")
def test_expected_places_equal_the_twin(device: Device) -> None:
    body, random = load_body("song32"), np.random.default_rng(0)
    spheres = device.zeros((2, ALONG * len(body.cones), 4), np.float32)
    places = Places(device, [body, body], spheres)
    poses = body.rest_pose + 0.1 * random.normal(size=(2, 4, body.n_dof))
    for person in range(2):
        places.start(person, poses[person, 0])
        for frame in range(1, 4):
            given = device.to_device(poses[person, frame].astype(np.float32))
            places.pose_launches(device, person, given)[frame % SLOTS]()
    places.expect(3, 2)
    expected = [expect_spheres(body, own[3], own[2], 2) for own in poses]
    np.testing.assert_allclose(spheres.get(), expected, atol=2e-5)
    places.start(1, poses[1, 0])  # at rest from now on
    places.expect(3, 2)
    at_rest = expect_spheres(body, poses[1, 0], poses[1, 0], 2)
    np.testing.assert_allclose(spheres.get()[1], at_rest, atol=2e-5)
