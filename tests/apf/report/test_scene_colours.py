"""The sides of the body, and what is lost, differ for people who are colour-blind."""

from itertools import combinations

import cv2
import numpy as np
import pytest

from apf.report.drawing import LOST, SIDES

#: Linear RGB as people without one kind of cone see it (Machado, Oliveira & Fernandes, IEEE TVCG
#: 15, 2009, severity 1).
SIGHTS = {
    "usual": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
#: Distance in CIELAB; 2.3 is just noticeable.
LEAST = 22.0


@pytest.mark.parametrize("sight", SIGHTS)
def test_colours_of_the_body_differ(sight: str) -> None:
    colours = np.array([*SIDES.values(), LOST], float) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ np.array(SIGHTS[sight]).T, 0, 1)
    rgb = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    lab = cv2.cvtColor(rgb[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0]
    apart = {(a, b): float(np.linalg.norm(lab[a] - lab[b])) for a, b in combinations(range(4), 2)}
    assert min(apart.values()) > LEAST, apart
