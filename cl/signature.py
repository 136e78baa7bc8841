"""Parameters of a kernel by name, read from its prototype in the source.

The driver is not queried (clGetKernelArgInfo), because a program from a binary cache lacks that
information.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from numbers import Integral, Real
from typing import Any, TypeAlias

import numpy as np
import pyopencl

from cl.array import Array
from cl.errors import DeviceError

#: Types of an argument of a kernel, see `Launch.set`.
Argument: TypeAlias = (
    Array | pyopencl.LocalMemory | np.ndarray | np.generic | float | Sequence[float] | None
)

_SCALARS = {
    **{"char": np.int8, "short": np.int16, "int": np.int32, "long": np.int64},
    **{"uchar": np.uint8, "ushort": np.uint16, "uint": np.uint32, "ulong": np.uint64},
    **{"half": np.float16, "float": np.float32, "double": np.float64},
}
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
#: A kernel's prototype: its name and parameters.
_KERNEL = re.compile(r"\b(?:__)?kernel\b[^;{}]*?\bvoid\s+(\w+)\s*\(([^()]*)\)\s*\{")
_QUALIFIER = re.compile(r"\b(?:const|restrict|volatile)\b")
_PARAMETER = re.compile(r"(?:(?:__)?(global|constant|local)\s+)?(\w+)(\s*\*\s*|\s+)(\w+)")
_VECTOR = re.compile(r"([a-z]+?)(2|3|4|8|16)?")
#: A struct's fields and name.
_STRUCT = re.compile(r"\btypedef\s+struct\s*\{([^{}]*)\}\s*(\w+)\s*;")


@dataclass(frozen=True)
class Parameter:
    """An argument of a kernel, or a number in a struct that is one.

    type: its OpenCL type, or that of what it points to. space: "global", "constant" or "local"
    for pointers, "" for values. dtype: of a number, None for types that are the kernel's own.
    width: numbers of a vector, else 1. struct: name of the argument that holds the number; empty
    for an argument itself. offset: place of the number in it, bytes.
    """

    name: str
    type: str
    space: str
    dtype: np.dtype | None
    width: int
    struct: str = ""
    offset: int = 0

    @property
    def argument(self) -> str:
        """The name of the argument of the kernel that this is, or is a part of."""
        return self.struct or self.name

    def convert(self, value: Argument) -> Any:
        """Return `value` as pyopencl takes it, arrays as they are. Raises TypeError or ValueError,
        whose text says what was expected and found, for a value that the kernel would misread."""
        if self.space == "local":
            if not isinstance(value, pyopencl.LocalMemory):
                raise TypeError(f"expected pyopencl.LocalMemory, got {_describe(value)}")
            return value
        if self.space:
            return self._buffer(value)
        return self._number(value) if self.width == 1 else self._vector(value)

    def _buffer(self, value: Argument) -> Any:
        if value is None:  # a null pointer, for what the kernel does not use
            return None
        if not isinstance(value, Array) or self.dtype not in (None, value.dtype):
            expected = f"of {self.dtype}" if self.dtype else f"for {self.type}"
            raise TypeError(f"expected an Array {expected}, got {_describe(value)}")
        if self.width != 3 and value.size % self.width:
            raise TypeError(f"expected an Array of {self.type}, got {_describe(value)}")
        return value

    def _number(self, value: Any) -> Any:
        if self.dtype is None:
            raise TypeError(f"the type {self.type} cannot be passed by value")
        real = self.dtype.kind == "f"
        if not isinstance(value, (Real if real else Integral, np.bool_)):
            raise TypeError(f"expected a number for {self.type}, got {_describe(value)}")
        if not real:
            limits, whole = np.iinfo(self.dtype), int(value)  # type: ignore[arg-type]
            if not limits.min <= whole <= limits.max:
                raise ValueError(f"expected a number for {self.type}, got {value}")
        return self.dtype.type(value)

    def _vector(self, value: Any) -> np.ndarray:
        assert self.dtype is not None  # vectors of numbers only
        numbers = np.asarray(value)
        of_kind = np.can_cast(numbers.dtype, self.dtype, "same_kind")
        if numbers.shape != (self.width,) or not of_kind:
            raise TypeError(f"expected {self.width} numbers for {self.type}, got {value!r}")
        stored = np.zeros(4 if self.width == 3 else self.width, self.dtype)
        stored[: self.width] = numbers
        return stored


#: The parameters of kernels, by the kernels' names.
Signatures = dict[str, tuple[Parameter, ...]]


@cache
def signatures(source: str, file: str) -> Signatures:
    """Return the parameters of every kernel in `source`, in the order of its prototype.

    A struct that is passed by value stands for its fields, which are numbers and vectors. Raises
    DeviceError, naming `file`, for a parameter that is more than qualifiers, a type and a name: no
    macros, no arrays.
    """
    text = _COMMENT.sub("", source)
    structs = {name: fields for fields, name in _STRUCT.findall(text)}
    found: Signatures = {}
    for name, inside in _KERNEL.findall(text):
        parameters: list[Parameter] = []
        for each in filter(str.strip, inside.split(",")):
            parameter = _parameter(each, name, file)
            if parameter.type in structs and not parameter.space:
                parameters += _fields(structs[parameter.type], parameter.name, name, file)
            else:
                parameters.append(parameter)
        found[name] = tuple(parameters)
    return found


def _fields(text: str, struct: str, kernel: str, file: str) -> list[Parameter]:
    """Return the numbers of a struct that is the argument `struct`, each at the next multiple of
    its size, as C lays them out."""
    fields: list[Parameter] = []
    end = 0
    for line in filter(None, map(str.strip, text.split(";"))):
        kind, names = line.split(None, 1)
        for name in names.split(","):
            field = _parameter(f"{kind} {name}", kernel, file)
            if field.dtype is None or field.space:
                raise DeviceError(f"kernel {kernel} of {file}: `{line}` is no number in a struct")
            size = field.dtype.itemsize * (4 if field.width == 3 else field.width)
            offset = -(-end // size) * size
            fields.append(replace(field, struct=struct, offset=offset))
            end = offset + size
    return fields


def _parameter(text: str, kernel: str, file: str) -> Parameter:
    read = _PARAMETER.fullmatch(_QUALIFIER.sub("", text).strip())
    if read is None or bool(read[1]) != ("*" in read[3]):
        what = " ".join(text.split())
        raise DeviceError(f"kernel {kernel} of {file}: the argument `{what}` cannot be read")
    space, type_, _, name = read.groups()
    vector = _VECTOR.fullmatch(type_)
    if vector is None or vector[1] not in _SCALARS:
        return Parameter(name, type_, space or "", None, 1)
    dtype = np.dtype(_SCALARS[vector[1]])
    return Parameter(name, type_, space or "", dtype, int(vector[2] or 1))


def _describe(value: object) -> str:
    if isinstance(value, Array):
        return f"one of {value.dtype} {value.shape}"
    return f"{type(value).__name__} {value!r}"
