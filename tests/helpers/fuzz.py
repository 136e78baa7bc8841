"""Damage to files, and readers that meet it: one clear error, little memory, little time.

A few examples of each in the test run; PSFS_APF_FUZZ=10000 tries so many, other ones every time.
"""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

from cl import InputError
from helpers.memory import limited_memory

EXAMPLES = int(os.environ.get("PSFS_APF_FUZZ", "0"))
#: Most bytes and seconds of a reader of a small file.
MEMORY, SECONDS = 2**30, 10.0
#: What stands for a number, or is put in anywhere.
EVIL = (
    *(b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 400, b"9" * 5000, b"0x10", b"1L"),
    *(b"", b"[", b"]", b"[[[[", b"{", b'"', b"\\", b"\0", b"\xff\xfe", b"\n", b"\r", b"\t", b","),
    *(b"null", b"true", b"%s", b"../", b"&a;", b"<", b">", b"\x80", b"[" * 3000, b"{" * 3000),
)

KINDS = ("replace a word", "insert", "cut out", "flip", "repeat", "end")


def draw_examples() -> Iterator[Random]:
    """Yield random numbers for each example of a property, the same ones in every test run."""
    seed = time.time_ns() if EXAMPLES else 0
    for number in range(EXAMPLES or 12):
        yield Random(seed + number)


def check_reader(read: Callable[[], Any], files: list[Path], *named: Path) -> None:
    """Damage `files` in turn: `read` takes what is left, or raises an InputError that names one of
    the places `named`. A file that makes it do otherwise stays as it is."""
    for number, random in enumerate(draw_examples()):
        file = files[number % len(files)]
        whole = damaged = file.read_bytes()
        for _ in range(random.randint(1, 3)):
            damaged = changed(damaged, random.choice(KINDS), random.random(), random.choice(EVIL))
        file.write_bytes(damaged)
        began = time.process_time()
        with limited_memory(MEMORY):
            try:
                read()
            except InputError as error:
                text = str(error)
                assert any(str(place) in text for place in named), text
                assert text.count(f"{file}: ") < 2, text
        assert time.process_time() - began < SECONDS
        file.write_bytes(whole)


def changed(data: bytes, kind: str, place: float, evil: bytes) -> bytes:
    """Damage `data` at a share of its length."""
    at = int(place * len(data))
    end = min(len(data), at + 1 + len(evil))
    if kind == "replace a word":
        stops = [data.find(mark, at) for mark in b' ,\n\t]}:"' if data.find(mark, at) >= 0]
        return data[:at] + evil + data[min(stops, default=len(data)) :]
    if kind == "flip":
        return data[:at] + bytes(b ^ 0xFF for b in data[at:end]) + data[end:]
    if kind == "repeat":
        return data[:end] + data[at:]
    return {
        "insert": data[:at] + evil + data[at:],
        "cut out": data[:at] + data[end:],
        "end": data[:at],
    }[kind]
