"""scripts/check_kernels.py: which tests it chooses, and what it reads in messages."""

import shutil
from pathlib import Path

import check_kernels
import pytest
from check_kernels import Findings, Program, Report

from cl import MissingFileError

MESSAGES = """.
Uninitialized value written to global memory address 0x9000000000000
\tKernel: count_slabs
\tEntity: Global(127,0,0) Local(127,0,0) Group(0,0,0)
\t  store <2 x i32> %3, <2 x i32> addrspace(1)* %arrayidx83, align 8, !dbg !193
\tAt line 88 (column 15) of reconstruction/surface.cl:
\t  for (int other = 0; other < LANES; ++other) volume += sums[other].y;
\t

Invalid read of size 4 at global memory address 0x1000000000100
\tKernel: gather
\tEntity: Global(0,0,0) Local(0,0,0) Group(0,0,0)
\t  %0 = load float, float addrspace(1)* %arrayidx, align 4
\tDebugging information not available.
\t

"""


def test_messages_of_oclgrind_are_read() -> None:
    assert list(check_kernels.oclgrind_reports(MESSAGES)) == [
        Report("count_slabs", "Uninitialized value written to", "reconstruction/surface.cl:88"),
        Report("gather", "Invalid read of size 4", "an unknown line"),
    ]


def test_the_first_tests_of_each_kernel_are_chosen() -> None:
    cases = [("a", ["k"]), ("b", ["k"]), ("c", ["k", "l"]), ("d", ["l"]), ("e", ["l"])]
    assert [name for name, _ in check_kernels.choose_cases(cases, 1)] == ["a", "c"]
    assert [name for name, _ in check_kernels.choose_cases(cases, 2)] == ["a", "b", "c", "d"]


def test_a_kernel_is_ok_where_it_was_tried_and_nothing_was_found() -> None:
    program = Program("x.cl", "__kernel void good(int n) {}\n__kernel void bad(int n) {}", "")
    findings = Findings({program}, {"x.good", "x.bad"})
    findings.add({"x.bad"}, "oclgrind", "a data race")
    verdicts = {
        kernel: [check_kernels.verdict(kernel, column, findings) for column in ("dg2", "oclgrind")]
        for kernel in ("x.good", "x.bad", "x.none")
    }
    assert verdicts == {
        "x.good": ["ok", "ok"], "x.bad": ["ok", "1 wrong"], "x.none": ["not built", "not run"]
    }  # fmt: skip


def test_missing_tools_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(check_kernels, "ICD", tmp_path / "none.so")
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    with pytest.raises(MissingFileError, match=r"apt-get install clang\S* intel\S* oclgrind$"):
        check_kernels.require_tools()


@pytest.mark.parametrize("target", [*check_kernels.AMD, check_kernels.INTEL])
def test_compilers_warnings_are_problems(tmp_path: Path, target: str) -> None:
    tool = "ocloc" if target == check_kernels.INTEL else check_kernels.CLANG
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    sound = "__kernel void k(__global int *a) { a[get_global_id(0)] = N; }"
    program = Program("k.cl", sound, "-cl-std=CL1.2 -D N=3")
    assert check_kernels.compiler_problems(tmp_path, program, target) == []
    for text in (sound.replace("N;", "none;"), sound.replace("N;", "(char)0 + (a == 1 ? 1 : 2);")):
        wrong = Program("k.cl", text, program.options)
        assert check_kernels.compiler_problems(tmp_path, wrong, target)
