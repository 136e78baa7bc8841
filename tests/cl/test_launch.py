"""Arguments of kernels, bound by their names in the kernel's prototype."""

from pathlib import Path
from typing import Any

import numpy as np
import pyopencl
import pytest

import cl
from cl import Device, DeviceError, Kernel, Launch
from cl.program import kernel_source
from cl.signature import signatures

SOURCE = """
typedef struct { float x; } Own;
// __kernel void commented(int a) {}
/* __kernel void
   also_commented(int a) {} */
static inline int helper(int a) { return a; }
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void gather(const int n, uchar flag, float scale, // the scale, of all
            float4 shift, uint2 key, float3 axis, __global const float4 *restrict points,
            global int *restrict counts, __constant float *table, __local int *scratch,
            __global const Own *own, __global float *out)
{
    scratch[0] = counts[0] + helper(n);
    const float4 v = points[0] * scale + shift;
    out[0] = v.x;
    out[1] = v.w;
    out[2] = scratch[0];
    out[3] = flag;
    out[4] = key.y;
    out[5] = axis.z;
    out[6] = table[1];
    out[7] = own ? own[0].x : -1.0f;
}
kernel void nothing() {}
"""


@pytest.fixture
def gather(device: Device) -> Kernel:
    return device.compile_kernel(SOURCE, "gather", "source.cl")


@pytest.fixture
def arguments(device: Device) -> dict[str, Any]:
    return {
        "n": 3,
        "flag": True,
        "scale": 0.1,
        "shift": (1, 2, 3, 4),
        "key": np.array([7, 2**32 - 256], np.uint32),
        "axis": [0.0, 0.0, 0.25],
        "points": device.to_device(np.array([[10, 20, 30, 40]], np.float32)),
        "counts": device.to_device(np.array([5], np.int32)),
        "table": device.to_device(np.array([0.5, 1.5], np.float32)),
        "scratch": pyopencl.LocalMemory(4),
        "own": device.to_device(np.array([[8]], np.float32)),
        "out": device.zeros(8, np.float32),
    }


def launch_of(device: Device, kernel: Kernel, **arguments: Any) -> Launch:
    return device.launch(kernel, (1,), (1,), **arguments)


@pytest.mark.parametrize("reverse", [False, True])
def test_arguments_arrive_in_any_order(
    device: Device, gather: Kernel, arguments: dict[str, Any], reverse: bool
) -> None:
    order = reversed(arguments) if reverse else iter(arguments)
    launch_of(device, gather, **{name: arguments[name] for name in order})()
    tenth = np.float32(0.1)
    expected = [10 * tenth + 1, 40 * tenth + 4, 8, 1, 2**32 - 256, 0.25, 1.5, 8]
    np.testing.assert_array_equal(arguments["out"].get(), np.array(expected, np.float32))


def test_arguments_change_between_calls(
    device: Device, gather: Kernel, arguments: dict[str, Any]
) -> None:
    launch = launch_of(device, gather, **arguments)
    launch()
    other = device.zeros(8, np.float32)
    launch.set(out=other, shift=np.array([5.0, 0, 0, 6]), n=-2, own=None)
    launch()
    tenth = np.float32(0.1)
    expected = [10 * tenth + 5, 40 * tenth + 6, 3, 1, 2**32 - 256, 0.25, 1.5, -1]
    np.testing.assert_array_equal(other.get(), np.array(expected, np.float32))
    assert arguments["out"].get()[0] == 10 * tenth + 1
    launch.set()
    launch()


@pytest.mark.parametrize("value", [np.pi, 1 / 3, 1e-42, 3e38, float("nan"), np.float64(0.7), 5])
def test_numbers_are_rounded_as_numpy_rounds_them(device: Device, value: float) -> None:
    source = "__kernel void put(float x, __global float *out) { out[0] = x; }"
    out = device.zeros(1, np.float32)
    device.launch(device.compile_kernel(source, "put", "put"), (1,), None, x=value, out=out)()
    np.testing.assert_array_equal(out.get().view(np.uint32), np.float32([value]).view(np.uint32))


def test_launches_of_one_kernel_keep_their_own_arguments(
    device: Device, gather: Kernel, arguments: dict[str, Any]
) -> None:
    other = device.zeros(8, np.float32)
    first = launch_of(device, gather, **arguments)
    second = launch_of(device, gather, **{**arguments, "n": 10, "out": other})
    first()
    second()
    assert (arguments["out"].get()[2], other.get()[2]) == (8, 15)


def test_missing_and_unknown_names_are_refused(
    device: Device, gather: Kernel, arguments: dict[str, Any]
) -> None:
    less = {name: value for name, value in arguments.items() if name not in ("scale", "out")}
    with pytest.raises(TypeError, match=r"^kernel gather of source.cl: missing scale, out$"):
        launch_of(device, gather, **less)
    known = "no argument sclae; expected n, flag, scale, .*, out$"
    with pytest.raises(TypeError, match=rf"^kernel gather of source.cl: {known}"):
        launch_of(device, gather, **arguments, sclae=2.0)
    launch = launch_of(device, gather, **arguments)
    with pytest.raises(TypeError, match=known):
        launch.set(sclae=2.0)
    with pytest.raises(TypeError, match="multiple values"):
        launch_of(device, gather, **arguments, **{"scale": 2.0})


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("n", 2.0, "expected a number for int, got float 2.0"),
        ("n", None, "expected a number for int, got NoneType None"),
        ("n", 2**31, "expected a number for int, got 2147483648"),
        ("flag", -1, "expected a number for uchar, got -1"),
        ("flag", 256, "expected a number for uchar, got 256"),
        ("scale", "1", "expected a number for float, got str '1'"),
        ("scale", np.ones(1, np.float32), "expected a number for float"),
        ("shift", (1, 2, 3), "expected 4 numbers for float4, got "),
        ("shift", 1.0, "expected 4 numbers for float4, got 1.0"),
        ("key", (1.0, 2.0), "expected 2 numbers for uint2, got "),
        ("axis", (1, 2, 3, 4), "expected 3 numbers for float3, got "),
        ("points", np.zeros((1, 4), np.float32), "expected an Array of float32, got ndarray "),
        ("points", 1.0, "expected an Array of float32, got float 1.0"),
        ("scratch", None, "expected pyopencl.LocalMemory, got NoneType None"),
        ("own", 3, "expected an Array for Own, got int 3"),
        ("counts", lambda d: d.zeros(3, "f4"), "expected an Array of int32, got one of float32"),
        ("points", lambda d: d.zeros((2, 3), "f4"), "expected an Array of float4, "),
        ("scratch", lambda d: d.zeros(1, "i4"), "expected pyopencl.LocalMemory, got one of"),
    ],
)
def test_values_of_the_wrong_kind_are_refused(
    device: Device, gather: Kernel, arguments: dict[str, Any], name: str, value: Any, said: str
) -> None:
    value = value(device) if callable(value) else value
    with pytest.raises((TypeError, ValueError)) as caught:
        launch_of(device, gather, **{**arguments, name: value})
    assert str(caught.value).startswith(f"kernel gather of source.cl, argument {name}: {said}")


def test_unknown_kernels_are_refused(device: Device) -> None:
    with pytest.raises(DeviceError, match=r"^source.cl has no kernel gathr; found: gat"):
        device.compile_kernel(SOURCE, "gathr", "source.cl")
    with pytest.raises(DeviceError, match="text has no kernel k; found: none at all"):
        device.compile_kernel("int f(void) { return 1; }", "k", "text")


@pytest.mark.parametrize("argument", ["LIST", "__global float out", "int *n", "float x[4]"])
def test_prototypes_that_cannot_be_read_are_refused(argument: str) -> None:
    with pytest.raises(DeviceError, match=r"kernel k of some.cl: the argument `.*` cannot be read"):
        signatures(f"__kernel void k(int n, {argument}) {{}}", "some.cl")


KERNELS = Path(cl.__file__).parent / "kernels"
STAGES = [path.relative_to(KERNELS).with_suffix("").as_posix() for path in KERNELS.rglob("*.cl")]


@pytest.mark.parametrize("stage", sorted(STAGES))
def test_no_kernel_is_built_without_its_defines(device: Device, stage: str) -> None:
    if "!defined(" not in kernel_source(stage):
        pytest.skip("needs none")
    with pytest.raises(DeviceError, match=r"\.(cl|h) needs [A-Z]"):
        device.compile_kernel(kernel_source(stage), "any", stage)


def test_kernels_that_the_defines_leave_out_are_refused(device: Device) -> None:
    source = "__kernel void a(int n) {}\n#ifdef MORE\n__kernel void b(int n) {}\n#endif\n"
    assert list(device.compile_kernel(source, "b", "some.cl", MORE=1).parameters) == ["n"]
    with pytest.raises(DeviceError, match=r"^kernel b of some.cl was not built with these defines"):
        device.compile_kernel(source, "b", "some.cl")


STRUCT = """
typedef struct { float4 shift; int n, m; float scale; } numbers;
__kernel void take(numbers given, __global float *out)
{
    out[0] = given.n;
    out[1] = given.m;
    out[2] = given.scale;
    out[3] = given.shift.w;
}
"""


def test_a_struct_takes_its_numbers_by_name(device: Device) -> None:
    kernel = device.compile_kernel(STRUCT, "take", "struct.cl")
    out = device.zeros(4, np.float32)
    launch = launch_of(device, kernel, n=3, m=-4, scale=0.5, shift=(0, 0, 0, 8), out=out)
    launch()
    np.testing.assert_array_equal(out.get(), [3, -4, 0.5, 8])
    launch.set(m=5)
    launch()
    np.testing.assert_array_equal(out.get(), [3, 5, 0.5, 8])
    with pytest.raises(TypeError, match="argument scale: expected a number for float"):
        launch.set(scale="large")
    with pytest.raises(TypeError, match="missing n"):
        launch_of(device, kernel, m=1, scale=1.0, shift=(0, 0, 0, 0), out=out)


def test_a_struct_of_other_than_numbers_is_refused() -> None:
    wrong = STRUCT.replace("float scale", "__global float *scale")
    with pytest.raises(DeviceError, match="no number in a struct"):
        signatures(wrong, "struct.cl")
