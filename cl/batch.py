"""Several like objects on one device, whose launches are joined: one launch serves all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import cache
from re import Match
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cl.array import Array
from cl.device import Device, Fill
from cl.launch import Launch, Step
from cl.signature import KERNEL, Argument, Parameter, signatures, without_comments
from cl.staging import Copy

T = TypeVar("T")
#: Bytes in which the places of arrays are counted.
_UNIT = 16
#: Arrays up to this size, bytes, get twice the room: those of other objects may be larger.
_SMALL = 2**16
#: What the additional arguments of a joined kernel begin with: the places of arrays, and the
#: numbers in which objects differ.
_PLACE, _VALUES = "place_of_", "values_of_"
#: What a joined program begins with: its third dimension counts the objects, too. Where work-groups
#: are stated, PLACE is get_group_id, the same for all items of a group: with 256 items a pose,
#: score_poses then needs 64 registers, and an H100 has room for all poses of two people at once.
_HEAD = """
static inline int batch_member(void) { return PLACE(2) / DEPTH; }
#define get_global_id(d) ((d) == 2 ? get_global_id(2) % DEPTH : get_global_id(d))
#define get_group_id(d) ((d) == 2 ? get_group_id(2) % DEPTH : get_group_id(d))
#define get_global_size(d) ((d) == 2 ? DEPTH : get_global_size(d))
#define get_num_groups(d) ((d) == 2 ? DEPTH : get_num_groups(d))
"""


class Batch:
    """`n` like objects, such as the trackers of several people.

    `run(actions)` performs an action of each object, and enqueues what they enqueue. Launches of
    the objects that differ only in their arrays and numbers become one launch, in which each object
    has its own work-groups; fills and copies of large arrays become one; other commands follow each
    other. For this, the first arrays that the objects allocate in their actions lie in one buffer,
    the second ones in another, and so on. Results are bit-equal to those of one action after the
    other.

    joins: whether launches are joined; by default on GPUs, which have room for several at once.
    """

    def __init__(self, device: Device, n: int, joins: bool | None = None) -> None:
        self._device = device
        self._joins = n > 1 and (device.is_gpu if joins is None else joins)
        self._memory = _Memory(device, n)
        self._joined: dict[tuple[int, ...], _JoinedLaunch] = {}
        # What is enqueued for commands that were collected before: by the first one and how many.
        self._plans: dict[tuple[Hashable, ...], tuple[list[list[Step]], list[Step]]] = {}

    def run(self, actions: Sequence[Callable[[], T]]) -> list[T]:
        """Perform an action of each object, in their order, and return the results."""
        if not self._joins:
            return [action() for action in actions]
        results: list[T] = []
        commands: list[list[Step]] = []
        for member, action in enumerate(actions):
            allocate = self._memory.allocator(member)
            with self._device.collect(len(actions), allocate) as own:
                results.append(action())
            commands.append(own)
        self._enqueue(commands)
        return results

    def _enqueue(self, commands: list[list[Step]]) -> None:
        key = (*commands[0][:1], len(commands[0]))
        known, plan = self._plans.get(key, (None, ()))
        if commands != known:
            plan = self._make_plan(commands)
            self._plans[key] = commands, plan
        for step in plan:
            step()

    def _make_plan(self, commands: list[list[Step]]) -> list[Step]:
        """Return what is enqueued instead of the objects' `commands`."""
        if len({len(own) for own in commands}) > 1:
            return [step for own in commands for step in own]
        plan: list[Step] = []
        for steps in zip(*commands, strict=True):
            joined = self._join(steps)
            plan += steps if joined is None else [joined]
        return plan

    def _join(self, steps: Sequence[Step]) -> Step | None:
        """Return one step for one of each object; None if there is none."""
        launches = [step for step in steps if isinstance(step, Launch)]
        if len(launches) == len(steps):
            key = tuple(map(id, steps))
            if key not in self._joined:
                self._joined[key] = _JoinedLaunch(self._device, launches)
            return self._joined[key]
        fills = [step for step in steps if isinstance(step, Fill)]
        if len(fills) == len(steps) and len({fill.value for fill in fills}) == 1:
            filled = self._memory.join([fill.array for fill in fills])
            return None if filled is None else Fill(filled, fills[0].value)
        copies = [step for step in steps if isinstance(step, Copy)]
        if len(copies) == len(steps):
            source = self._memory.join([copy.source for copy in copies])
            target = self._memory.join([copy.target for copy in copies])
            return None if source is None or target is None else Copy(source, target)
        return None

    @property
    def n_joined(self) -> int:
        """Number of launches that serve all objects."""
        return sum(joined.joins for joined in self._joined.values())


class _Memory:
    """Buffers for the arrays of `n` objects, by the order in which each object allocates them."""

    def __init__(self, device: Device, n: int) -> None:
        self._device, self._n = device, n
        self._align = max(_UNIT, device.handle.mem_base_addr_align // 8)
        self._wholes: list[tuple[Any, int]] = []
        self._next = [0] * n

    def allocator(self, member: int) -> Callable[[int], tuple[Any, int]]:
        """Return the function that allocates so many bytes for an object: it returns a buffer, and
        where in it they begin."""

        def allocate(nbytes: int) -> tuple[Any, int]:
            at, self._next[member] = self._next[member], self._next[member] + 1
            if at == len(self._wholes):
                room = nbytes if nbytes > _SMALL else 2 * nbytes
                apart = -(-room // self._align) * self._align
                self._wholes.append((self._device.new_buffer(self._n * apart), apart))
            whole, apart = self._wholes[at]
            if nbytes > apart:
                return self._device.new_buffer(nbytes), 0
            return whole, member * apart

        return allocate

    def join(self, arrays: Sequence[Array]) -> Array | None:
        """Return the memory of one array of each object, flat; None unless they follow each other
        with nothing between them but alignment."""
        first = arrays[0]
        apart = -(-first.nbytes // self._align) * self._align
        for k, array in enumerate(arrays):
            same = array.whole is first.whole and array.nbytes == first.nbytes
            if not same or array.start != first.start + k * apart:
                return None
        size = ((len(arrays) - 1) * apart + first.nbytes) // first.dtype.itemsize
        return Array(first.device, first.whole, (size,), first.dtype, first.start)


class _JoinedLaunch:
    """One launch for those of several objects, if their arguments allow it; else each of them."""

    def __init__(self, device: Device, members: Sequence[Launch]) -> None:
        self._device, self._members = device, members
        self._parameters = members[0].kernel.parameters
        self._alike = _are_alike(members)
        self._changed = set(self._parameters)  # names of arguments
        self._arguments: dict[str, dict[str, Argument]] = {}  # of the joined kernel, for each name
        self._launches: dict[tuple[str, ...], Launch] = {}
        self._values: dict[str, Array] = {}  # each object's own numbers
        self._launch: Launch | None = None
        for member in members:
            member.on_change.append(self._changed.update)

    @property
    def joins(self) -> bool:
        """Whether there is one launch for the latest arguments."""
        return self._launch is not None

    def __call__(self) -> None:
        if self._changed:
            self._update(self._changed)
            self._changed.clear()
        if self._launch is not None:
            self._launch()
            return
        for member in self._members:
            member()

    def _update(self, changed: Iterable[str]) -> None:
        """Take over arguments that the members set."""
        if not self._alike or not self._join_arguments(changed):
            self._launch = None
            return
        each = self._arguments
        given = tuple(name for name in self._parameters if _VALUES + name in each[name])
        launch = self._launches.get(given)
        if launch is None:
            launch = self._launches[given] = self._make_launch(given)
        elif launch is self._launch:
            launch.set(**{k: v for name in changed for k, v in each[name].items()})
        else:
            launch.set(**{k: v for joined in each.values() for k, v in joined.items()})
        self._launch = launch

    def _join_arguments(self, changed: Iterable[str]) -> bool:
        """Join the members' arguments of these names; return whether those of all names are."""
        for name in changed:
            values = [member.arguments[name] for member in self._members]
            joined = _join_values(self._parameters[name], values)
            if joined is None:
                self._arguments.pop(name, None)
                continue
            if isinstance(each := joined.get(_VALUES + name), np.ndarray):
                if name not in self._values:
                    self._values[name] = self._device.empty(each.shape, each.dtype)
                self._values[name].set(each)
                joined[_VALUES + name] = self._values[name]
            self._arguments[name] = joined
        return len(self._arguments) == len(self._parameters)

    def _make_launch(self, given: tuple[str, ...]) -> Launch:
        """Return the launch of the joined kernel, whose third dimension counts the objects. given:
        names of numbers of which each object has its own."""
        device, first = self._device, self._members[0]
        width, height, depth = (*first.global_size, 1, 1)[:3]
        local = None if first.local_size is None else (*first.local_size, 1, 1)[:3]
        source, options = first.kernel.text
        name, file = first.kernel.name, first.kernel.file
        text = join_source(source, file, given)
        options += f" -D DEPTH={depth} -D PLACE=get_{'global' if local is None else 'group'}_id"
        kernel = device.programs.kernel(text, name, file, options)
        arguments = {k: v for joined in self._arguments.values() for k, v in joined.items()}
        size = width, height, depth * len(self._members)
        launch = device.launch(kernel, size, local, **arguments)
        launch.name = first.name
        return launch


def _are_alike(launches: Sequence[Launch]) -> bool:
    """Return whether launches differ in no more than their arguments, and may be joined."""
    first = launches[0]
    shape = first.kernel, first.global_size, first.local_size
    same = all((each.kernel, each.global_size, each.local_size) == shape for each in launches)
    return same and (*(first.local_size or ()), 1, 1, 1)[2] == 1


def _join_values(parameter: Parameter, values: Sequence[Any]) -> dict[str, Argument] | None:
    """Return the arguments of a joined kernel for the `values` of all objects; None if there are
    none."""
    name, first = parameter.name, values[0]
    if parameter.space == "local":
        return {name: max(values, key=lambda value: int(value.size))}
    if parameter.space:
        place = _find_place(values)
        return None if place is None else {name: place[0], _PLACE + name: place[1]}
    if all(np.array_equal(first, value) for value in values):
        return {name: first}
    if parameter.width > 1 or parameter.dtype is None:
        return None
    each = np.array([parameter.convert(value) for value in values], parameter.dtype)
    return {name: first, _VALUES + name: each}


def _find_place(values: Sequence[Any]) -> tuple[Argument, tuple[int, int]] | None:
    """Return the buffer that holds the arrays of all objects, where in it the first one begins and
    how far they are apart, in units; None if there is none."""
    first = values[0]
    if all(value is first for value in values):
        return first, (0, 0)
    if any(value is None for value in values):
        return None
    starts = [value.start for value in values]
    apart = starts[1] - starts[0]
    if any(value.whole is not first.whole for value in values):
        return None
    if starts[0] % _UNIT or apart % _UNIT:
        return None
    if any(start != starts[0] + k * apart for k, start in enumerate(starts)):
        return None
    whole = Array(first.device, first.whole, first.shape, first.dtype)
    return whole, (starts[0] // _UNIT, apart // _UNIT)


@cache
def join_source(source: str, file: str, given: tuple[str, ...] = ()) -> str:
    """Return the text of a program whose kernels serve several objects at once.

    For each array they also take where in its buffer the first object's begins and how far they are
    apart. given: names of numbers of which each object has its own."""
    known = signatures(source, file)

    def join(match: Match[str]) -> str:
        more, begin = [], []
        for p in known[match[1]]:
            place, values = _PLACE + p.name, _VALUES + p.name
            if p.space in ("global", "constant"):
                shift = f"{_UNIT} * ((long){place}.x + batch_member() * (long){place}.y)"
                more.append(f"int2 {place}")
                begin.append(
                    f"{p.name} = (__{p.space} void *)((__{p.space} char *){p.name} + {shift});"
                )
            elif p.name in given:
                more.append(f"__global const {p.type} *{values}")
                begin.append(f"{p.reference} = {values}[batch_member()];")
        return f"{match[0].rpartition(')')[0]}{', '.join(['', *more])}) {{ {' '.join(begin)}"

    return _HEAD + KERNEL.sub(join, without_comments(source))


class Parts:
    """An array `whole`, flat, and `n` arrays of a shape and type that lie in it, `step` elements
    apart, as the device's alignment asks for."""

    def __init__(self, device: Device, n: int, shape: Sequence[int], dtype: npt.DTypeLike) -> None:
        dtype = np.dtype(dtype)
        align = max(dtype.itemsize, device.handle.mem_base_addr_align // 8)
        nbytes = math.prod(shape) * dtype.itemsize
        apart = -(-nbytes // align) * align
        self.step = apart // dtype.itemsize
        self.whole = device.zeros((n * self.step,), dtype, "the parts of several people")
        self.arrays = [self.whole.region(k * apart, shape, dtype) for k in range(n)]
