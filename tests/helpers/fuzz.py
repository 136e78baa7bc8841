"""Damage to files for property-based tests of readers.

A few examples of each in the test run; PSFS_APF_FUZZ=10000 tries so many, other ones every time.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

EXAMPLES = int(os.environ.get("PSFS_APF_FUZZ", "0"))
#: How often and how a property is tested.
FUZZING = settings(
    max_examples=EXAMPLES or 12,
    deadline=None,
    database=None,
    derandomize=not EXAMPLES,
    suppress_health_check=list(HealthCheck),
)
#: Most bytes and seconds of a reader of a small file.
MEMORY, SECONDS = 2**30, 10.0
#: What stands for a number, or is put in anywhere.
EVIL = (
    *(b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 400, b"9" * 5000, b"0x10", b"1L"),
    *(b"", b"[", b"]", b"[[[[", b"{", b'"', b"\\", b"\0", b"\xff\xfe", b"\n", b"\r", b"\t", b","),
    *(b"null", b"true", b"%s", b"../", b"&a;", b"<", b">", b"\x80", b"[" * 3000, b"{" * 3000),
)

CHANGE = st.tuples(
    st.sampled_from(["replace a word", "insert", "cut out", "flip", "repeat", "end"]),
    st.floats(0, 1, exclude_max=True),
    st.sampled_from(EVIL),
)


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
