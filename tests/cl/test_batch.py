"""Launches of several like objects, joined: the results are those of each object's own launches."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pyopencl
import pytest

from cl import Array, Device, Launch
from cl.batch import Batch
from cl.staging import Copy

SOURCE = """
// Adds up what differs between objects: number, array, place in the grid.
__kernel __attribute__((reqd_work_group_size(4, 1, 1)))
void combine(int n, float factor, __local int *scratch, __global const float *restrict shared,
         __global const float *none, __global const float *restrict own, __global float *out)
{
    scratch[get_local_id(0)] = get_group_id(2);
    barrier(CLK_LOCAL_MEM_FENCE);
    const int layer = get_global_id(2), at = layer * get_global_size(0) + get_global_id(0);
    if ((int)get_global_id(0) >= n) return;
    out[at] = factor * own[get_global_id(0)] + shared[layer] + (none ? 1.0f : 0.0f) +
              100.0f * scratch[get_local_id(0)] + 1000.0f * get_num_groups(2);
}
"""


class Thing:
    """An object with arrays of `n` numbers and a launch over three layers."""

    def __init__(self, device: Device, shared: Array, factor: float, n: int) -> None:
        self.own = device.to_device(np.arange(n, dtype=np.float32) * (1 + factor))
        self.out = device.zeros((3, 8), np.float32)
        self.launch: Launch = device.launch(
            device.compile_kernel(SOURCE, "combine", "source.cl"), (n, 1, 3), (4, 1, 1),
            n=n, factor=factor, scratch=pyopencl.LocalMemory(16), shared=shared, none=None,
            own=self.own, out=self.out,
        )  # fmt: skip

    def run(self, value: float | None = None) -> None:
        if value is not None:
            self.own.fill(value)
        self.launch()


def make_actions(
    device: Device, factors: tuple[float, ...], sizes: tuple[int, ...]
) -> list[Callable[[], Thing]]:
    shared = device.to_device(np.array([0.25, 0.5, 0.75], np.float32))
    return [partial(Thing, device, shared, *each) for each in zip(factors, sizes, strict=True)]


@pytest.mark.parametrize(
    ("factors", "sizes", "joined"),
    [((2.0, 2.0, 2.0), (8, 8, 8), 1), ((2.0, 3.0), (8, 8), 1), ((2.0, 3.0), (8, 4), 0)],
    ids=["only arrays differ", "a number differs", "the grids differ"],
)
def test_joined_launches_compute_what_single_ones_do(
    device: Device, factors: tuple[float, ...], sizes: tuple[int, ...], joined: int
) -> None:
    found = []
    for joins in (True, False):
        batch = Batch(device, len(factors), joins)
        things = batch.run(make_actions(device, factors, sizes))
        results = []
        for value in (None, -2.0):
            batch.run([partial(thing.run, value) for thing in things])
            results.append([thing.out.get() for thing in things])
        things[0].launch.set(factor=7.0)  # a later change is seen
        batch.run([thing.run for thing in things])
        found.append([*results, [thing.out.get() for thing in things]])
        assert batch.n_joined == (joined if joins else 0)
    np.testing.assert_array_equal(*found)
    assert np.unique(found[0][0][0]).size > 10


def test_joined_launches_need_no_sub_buffers(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NVIDIA's driver (580) crashed when those of two people's trackers were released."""
    made: list[int] = []
    make = pyopencl.Buffer.get_sub_region
    monkeypatch.setattr(
        pyopencl.Buffer, "get_sub_region", lambda *a: (made.append(a[2]), make(*a))[1]
    )
    batch = Batch(device, 2, joins=True)
    things = batch.run(make_actions(device, (2.0, 3.0), (8, 8)))
    batch.run([partial(thing.run, 1.0) for thing in things])
    results = [thing.out.get() for thing in things]
    assert batch.n_joined == 1 and not made
    things[1].launch()  # a launch of one alone does need one, and gives the same
    np.testing.assert_array_equal(results[1], things[1].out.get())
    assert made


def test_a_change_is_seen_by_all_joined_launches_of_which_a_launch_is_a_part(
    device: Device,
) -> None:
    """As when one of two people is lost and starts again: the launches of their frames, of which
    each has two in turn, meet in other pairs from then on."""
    batch = Batch(device, 2, joins=True)
    first, second = batch.run(make_actions(device, (2.0, 3.0), (8, 8)))
    arguments = second.launch.arguments
    other = device.launch(second.launch.kernel, (8, 1, 3), (4, 1, 1), **arguments)
    batch.run([first.run, second.run])
    batch.run([first.run, other])
    assert batch.n_joined == 2
    first.launch.set(factor=7.0)
    batch.run([first.run, second.run])
    joined = first.out.get()
    first.run()
    np.testing.assert_array_equal(joined, first.out.get())


def test_what_waits_for_the_device_gets_what_was_collected_before_it(device: Device) -> None:
    array = device.zeros((4,), np.float32)
    with device.collect() as commands:
        array.fill(3.0)
        assert len(commands) == 1
        assert array.get().tolist() == [3.0] * 4
        assert not commands
        array.fill(5.0)
    assert array.get().tolist() == [3.0] * 4
    for command in commands:
        command()
    assert array.get().tolist() == [5.0] * 4


@pytest.mark.parametrize(("size", "commands"), [(20_001, 2), (50, 4)], ids=["large", "small"])
def test_fills_and_copies_of_large_arrays_are_joined(
    device: Device, monkeypatch: pytest.MonkeyPatch, size: int, commands: int
) -> None:
    batch = Batch(device, 2, joins=True)
    pairs = batch.run([lambda: [device.zeros((size,), np.float32) for _ in range(2)]] * 2)
    sent: list[str] = []
    for name in ("enqueue_fill_buffer", "enqueue_copy"):
        plain = getattr(pyopencl, name)
        monkeypatch.setattr(
            pyopencl, name, lambda *a, _plain=plain, **k: (sent.append(""), _plain(*a, **k))[1]
        )

    def run(source: Array, target: Array, value: float) -> None:
        source.fill(value)
        device.enqueue([Copy(source, target)])

    batch.run([partial(run, *pair, 3.0) for pair in pairs])
    assert len(sent) == commands
    batch.run([partial(run, *pair, 4.0 + k) for k, pair in enumerate(pairs)])
    for k, (_, target) in enumerate(pairs):
        np.testing.assert_array_equal(target.get(), np.full(size, 4.0 + k, np.float32))
