"""Each of several people is found where they stand, by a network that finds the brightest one."""

import numpy as np
from helpers import scenes

from apf.keypoints.estimation import PersonFinder
from psfs.cameras.camera import Camera
from psfs.people.people import StandingPeople

PLACES = np.array([[-0.5, 0.0, 1.6], [0.5, 0.0, 1.6]])


class Network:
    """Finds a person, 40 px tall, at the middle of the brightest pixels."""

    def __call__(self, picture: np.ndarray) -> np.ndarray | None:
        if picture.max() < 200:
            return None
        rows, columns = np.nonzero(picture[..., 0] == picture.max())
        points = np.tile([columns.mean(), rows.mean(), 0.9], (33, 1))
        points[0, 1] -= 20
        points[32, 1] += 20
        return points

    def forget(self) -> None:
        pass

    def close(self) -> None:
        pass


def camera(*place: float) -> Camera:
    return scenes.pinhole("cam", place, [0.0, 0.0, 0.8], (160, 120), 100)


def show(view: Camera, brightness: tuple[int, int]) -> np.ndarray:
    """Return a picture with a spot at each one's trunk."""
    picture = np.full((120, 160, 3), 60, np.uint8)
    for place, value in zip(PLACES, brightness, strict=True):
        (x, y), _ = view.project(place * [1, 1, 0.67])
        picture[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2] = value
    return picture


def find(view: Camera, *pictures: np.ndarray) -> np.ndarray:
    """Return the mean x (F, P) px of each person in the pictures, NaN for who is not found."""
    people = StandingPeople(np.arange(len(pictures)), np.tile(PLACES, (len(pictures), 1, 1)))
    finders = [PersonFinder(Network(), view, people, k) for k in (0, 1)]  # type: ignore[arg-type]
    found = [[find(picture, k) for find in finders] for k, picture in enumerate(pictures)]
    return np.array([[np.nan if p is None else p[:, 0].mean() for p in row] for row in found])


def test_each_is_found_though_the_other_is_brighter_or_hides_them() -> None:
    view = camera(0.0, -4.0, 0.8)
    expected = view.project(PLACES * [1, 1, 0.67])[0][:, 0]
    found = find(view, show(view, (210, 250)), show(view, (250, 210)), show(view, (0, 250)))
    np.testing.assert_allclose(found[:2], [expected, expected], atol=1)
    assert np.isnan(found[2, 0]) and abs(found[2, 1] - expected[1]) < 1
    view = camera(4.0, 0.0, 0.8)
    found = find(view, show(view, (0, 250)))
    assert np.isnan(found[0, 0]) and np.isfinite(found[0, 1])
