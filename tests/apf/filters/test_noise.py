"""Random numbers: Random123's known answers, and the same words on every device."""

from importlib import resources

import numpy as np
import pytest
from scipy import stats

from apf.reference.filters.noise import normals, philox4x32, uniform01
from cl import Device, Kernel

#: philox4x32 10 of Random123's kat_vectors: counter, key, words.
KNOWN = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000",
     "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff",
     "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0",
     "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip

KERNEL = """
__kernel void draw(__global const uint4 *counters, uint2 key, __global uint4 *words,
                   __global float *uniforms, __global float *normals)
{
    const int i = get_global_id(0);
    words[i] = philox4x32(counters[i], key);
    uniforms[i] = uniform01(words[i].x);
    const vwords counter = {counters[i].x, counters[i].y, counters[i].z, counters[i].w};
    normals[i] = normal_pack(counter, key);
}
__kernel void ends(__global const uint *words, __global float *uniforms)
{
    uniforms[get_global_id(0)] = uniform01(words[get_global_id(0)]);
}
"""


def words_of(text: str) -> np.ndarray:
    return np.array([int(word, 16) for word in text.split()], np.uint32)


def kernel(device: Device, name: str) -> Kernel:
    kernels = resources.files("cl") / "kernels"
    names = ("common/inlined.h", "common/pack.h", "common/philox.h")
    header = "".join((kernels / file).read_text() for file in names)
    for file in names:
        header = header.replace(f'#include "{file}"', "")
    return device.compile_kernel(header + KERNEL, name, "test_noise")


def drawn(device: Device, counters: np.ndarray, seed: int) -> tuple[np.ndarray, ...]:
    """Words (N, 4), uniforms (N,) and normals (N,) of the device."""
    n = len(counters)
    given = device.to_device(counters.astype(np.uint32))
    words, uniforms = device.empty((n, 4), np.uint32), device.empty(n, np.float32)
    normals = device.empty(n, np.float32)
    key = np.array([seed & 0xFFFFFFFF, seed >> 32], np.uint32)
    out = {"words": words, "uniforms": uniforms, "normals": normals}
    device.launch(kernel(device, "draw"), (n,), None, counters=given, key=key, **out)()
    return tuple(array.get() for array in out.values())


def grid_of_counters() -> np.ndarray:
    """Counters as the tracker uses them (frame, layer, particle, dimension), and far ones."""
    ranges = np.meshgrid([0, 1, 7], [0, 9], [0, 1, 36, 128], [0, 30], indexing="ij")
    near = np.stack(ranges, -1).reshape(-1, 4)
    far = np.random.default_rng(0).integers(0, 2**32, (500, 4))
    return np.concatenate([near, far])


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_known_answers(device: Device, counter: str, key: str, words: str) -> None:
    """Of the twin and of the device."""
    low, high = words_of(key).tolist()
    counters, seed = words_of(counter)[None], high << 32 | low
    for answer in (philox4x32(counters, seed), drawn(device, counters, seed)[0]):
        np.testing.assert_array_equal(answer[0], words_of(words))


@pytest.mark.parametrize("seed", [0, 1, 2**32, 0xDEADBEEF_12345678])
def test_the_device_draws_what_the_twin_draws(device: Device, seed: int) -> None:
    counters = grid_of_counters()
    words, uniforms, gaussians = drawn(device, counters, seed)
    expected = philox4x32(counters, seed)
    np.testing.assert_array_equal(words, expected)
    u, v = uniform01(expected[:, 0]), uniform01(expected[:, 1])
    np.testing.assert_array_equal(uniforms, u.astype(np.float32))
    wanted = np.sqrt(-2 * np.log(u)) * np.cos(2 * np.pi * v)
    np.testing.assert_allclose(gaussians, wanted, rtol=1e-4, atol=2e-6)


def test_uniforms_stay_inside_the_interval(device: Device) -> None:
    """Also in float: neither 0, whose logarithm is infinite, nor 1."""
    words = np.array([0, 1, 511, 512, 2**31, 2**32 - 513, 2**32 - 512, 2**32 - 1], np.uint32)
    out = device.empty(len(words), np.float32)
    given = device.to_device(words)
    device.launch(kernel(device, "ends"), (len(words),), None, words=given, uniforms=out)()
    np.testing.assert_array_equal(out.get(), uniform01(words))
    assert out.get().min() > 0 and out.get().max() < 1
    assert np.all(np.diff(uniform01(words)) >= 0)


def test_normals_are_normal_and_independent() -> None:
    numbers = normals(3, 5, 2, 4000, 31)
    assert numbers.shape == (4000, 31)
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3
    correlation = np.corrcoef(numbers.T) - np.eye(31)
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)
    neighbours = np.corrcoef(numbers[:-1].ravel(), numbers[1:].ravel())[0, 1]
    assert abs(neighbours) < 5 / np.sqrt(numbers.size)
