#!/usr/bin/env python3
"""Compile every kernel for GPUs that are not here, and run the parity tests under Oclgrind.

    scripts/check_kernels.py                       # all kernels: half an hour on 2 cores
    scripts/check_kernels.py --only likelihood     # the tests whose names contain this

For each kernel the first parity test that is marked for it (--cases N: the first N) runs on this
machine's first device, taken for a GPU: what is built is compiled for AMD's gfx90a and gfx1100
(clang) and for an Intel GPU (ocloc). The tests run again on Oclgrind's device, which reports data
races, uninitialised values that are written or decide, and accesses out of bounds. The table has a
row for each kernel; the exit code is 1 unless all is clean. OCLGRIND_ICD names another Oclgrind
than Debian's, see docs/add_a_stage.md.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.table import Table

from cl import MissingFileError
from cl.program import kernel_source
from cl.signature import signatures
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command

ROOT = Path(__file__).resolve().parents[1]
ICD = Path(os.environ.get("OCLGRIND_ICD", "/usr/lib/oclgrind/liboclgrind-rt-icd.so"))
AMD, INTEL = ("gfx90a", "gfx1100"), "dg2"
#: Debian's own `clang`, 14, knows no gfx1100.
CLANG = "clang-19"
#: s for one program of one compiler; for a run of pytest that collects, or only builds.
_COMPILING_LIMIT, _COLLECTING_LIMIT = 300, 900
#: What Oclgrind reports though nothing is wrong, by "stage.kernel": a part of the message.
SUPPRESSED = {
    # Oclgrind 21.10 takes element 11 that a shuffle of a vector picks for undefined.
    "common/probe.check": "ninitialized",
    # Reads before atomic_min whether there is something to do at all.
    "reconstruction/colour.nearest_depth": "data race",
    # Follows what other items lower by atomic_min (union-find, Komura 2015).
    "image/features.blob_region": "data race",
}
#: Oclgrind takes minutes for the pixels of the scene; tests of this name have few.
_SMALL = "small"
#: Functions of OpenCL C, whose names are mangled, and those of LLVM may be left to the linker.
_FOREIGN = ("_Z", "__", "llvm.")


@dataclass(frozen=True)
class Program:
    """A compiler's input: the file that names it, its text, its options."""

    file: str
    source: str
    options: str

    @property
    def kernels(self) -> set[str]:
        stage = self.file.removesuffix(".cl")
        return {f"{stage}.{name}" for name in signatures(self.source, self.file)}


@dataclass(frozen=True)
class Report:
    """A message of Oclgrind: what happened in which kernel, and the line where."""

    kernel: str
    what: str
    line: str


@dataclass
class Findings:
    """Results of all cases: programs, launched kernels, problems by kernel and column."""

    programs: set[Program] = field(default_factory=set)
    launched: set[str] = field(default_factory=set)
    wrong: dict[tuple[str, str], set[str]] = field(default_factory=dict)

    def add(self, kernels: Iterable[str], column: str, what: str) -> None:
        for kernel in kernels:
            self.wrong.setdefault((kernel, column), set()).add(what)


def main() -> int:
    parser = argparse.ArgumentParser(prog="check_kernels.py", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1, help="tests of each kernel")
    parser.add_argument("--only", default="", help="a part of the names of the tests to run")
    parser.add_argument("--compile-only", action="store_true", help="without Oclgrind")
    parser.add_argument("--limit", type=float, default=300, metavar="S", help="of a test")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    try:
        return run_command(parser)
    except SystemExit as ended:
        return int(ended.code or 0)


def _run(args: argparse.Namespace) -> None:
    require_tools()
    findings, columns = Findings(), [*AMD, INTEL, *([] if args.compile_only else ["oclgrind"])]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        cases = choose_cases(collected_cases(place), args.cases)
        chosen = [(case, kernels) for case, kernels in cases if args.only in case]
        findings.programs |= built_programs(place, [case for case, _ in chosen])
        if not args.compile_only:
            for case, kernels in chosen:
                started = time.perf_counter()
                run_case(place, case, kernels, args.limit, findings)
                print(f"{time.perf_counter() - started:6.1f} s {case}", file=sys.stderr)
        for program in sorted(findings.programs, key=lambda p: (p.file, p.options)):
            for target in (*AMD, INTEL):
                problems = compiler_problems(place, program, target)
                for problem in problems:
                    findings.add(program.kernels, target, problem)
    rows = sorted({k for _, kernels in chosen for k in kernels} if args.only else all_kernels())
    stdout.print(table(rows, columns, findings))
    for (kernel, column), problems in sorted(findings.wrong.items()):
        for problem in sorted(problems):
            stdout.print(f"{kernel}, {column}: {problem}", markup=False, highlight=False)
    verdicts = [verdict(row, column, findings) for row in rows for column in columns]
    if not all(found.startswith("ok") for found in verdicts):
        raise SystemExit(1)


def require_tools() -> None:
    """Raise MissingFileError unless the compilers and Oclgrind are here."""
    tools = {CLANG: CLANG, "ocloc": "intel-opencl-icd"}
    missing = {tool: package for tool, package in tools.items() if shutil.which(tool) is None}
    missing |= {} if ICD.is_file() else {"Oclgrind": "oclgrind"}
    if missing:
        raise MissingFileError(
            f"{' and '.join(missing)} not found; expected {CLANG}, ocloc and Oclgrind as Debian "
            f"installs them: apt-get install {' '.join(missing.values())}"
        )


def all_kernels() -> set[str]:
    """Return "stage.kernel" of every kernel that there is."""
    folder = ROOT / "cl" / "kernels"
    stages = [str(path.relative_to(folder).with_suffix("")) for path in folder.rglob("*.cl")]
    return {f"{s}.{name}" for s in stages for name in signatures(kernel_source(s), s)}


# Oclgrind ---------------------------------------------------------------------------------------


def collected_cases(place: Path) -> list[tuple[str, list[str]]]:
    """Return the parity tests on the device, and the kernels that each is marked for."""
    ended = _pytest(place, ("--collect-only", "-m", "parity", "tests"), _COLLECTING_LIMIT, False)
    record = _record(place)
    if record is None:
        raise MissingFileError(f"no parity tests could be collected: {ended[-500:]}")
    return [(case, kernels) for case, kernels in record["cases"] if "device" in case]


def built_programs(place: Path, cases: Sequence[str]) -> set[Program]:
    """Return what the tests build where this machine's first device says that it is a GPU."""
    ended = _pytest(place, cases, _COLLECTING_LIMIT, simulated=False)
    record = _record(place)
    if record is None:
        raise MissingFileError(f"the parity tests could not be run: {ended[-500:]}")
    return {Program(*program) for program in record["programs"]}


def choose_cases(cases: Sequence[tuple[str, list[str]]], each: int) -> list[tuple[str, list[str]]]:
    """Return the first tests, small ones before others, such that each kernel has `each` of them,
    or all that there are."""
    seen: dict[str, int] = {}
    chosen = []
    for case, kernels in sorted(cases, key=lambda named: _SMALL not in named[0]):
        if any(seen.get(kernel, 0) < each for kernel in kernels):
            chosen.append((case, kernels))
            for kernel in kernels:
                seen[kernel] = seen.get(kernel, 0) + 1
    return chosen


def run_case(place: Path, case: str, kernels: list[str], limit: float, findings: Findings) -> None:
    """Run a test on Oclgrind's device and add what it builds, launches and does wrong."""
    text = _pytest(place, (case,), limit)
    record = _record(place)
    if record is None:
        last = text.strip().splitlines()[-1:] or ["nothing said"]
        findings.add(kernels, "oclgrind", f"{case} did not end in {limit:g} s: {last[0]}")
        return
    if "Oclgrind" not in record["device"]:
        raise MissingFileError(
            f"the tests ran on {record['device']}; expected {ICD} to be Oclgrind's"
        )
    findings.launched |= set(record["launched"])
    if "\nerror: exit code" in text:
        findings.add(kernels, "oclgrind", f"{case} fails")
    for report in oclgrind_reports(text):
        named = {k for k in record["launched"] if k.rpartition(".")[2] == report.kernel}
        named = {k for k in named if k not in SUPPRESSED or SUPPRESSED[k] not in report.what}
        findings.add(named, "oclgrind", f"{report.what} at {report.line}")


def _pytest(place: Path, arguments: Sequence[str], limit: float, simulated: bool = True) -> str:
    """Run pytest with the plugin that records, on Oclgrind's device or on this machine's first
    one; return its output."""
    (place / "record.json").unlink(missing_ok=True)
    paths = [str(ROOT), str(ROOT / "tests"), str(ROOT / "scripts")]
    environment = {
        **os.environ,
        **(_simulate_device(place) if simulated else {"RECORD_AS_GPU": "1"}),
        **{"KERNEL_RECORD": str(place / "record.json"), "PYTHONPATH": os.pathsep.join(paths)},
    }
    options = ("-p", "no:cacheprovider", "-p", "kernel_recorder", "-n", "0", "-q", "-s")
    command = [sys.executable, "-m", "pytest", *options, *arguments]
    return _output(command, limit, environment)


def _simulate_device(place: Path) -> dict[str, str]:
    """Return the environment in which Oclgrind's is the only device."""
    (place / "icd").mkdir(exist_ok=True)
    (place / "icd" / "oclgrind.icd").write_text(f"{ICD}\n")
    return {
        **{"OCL_ICD_VENDORS": str(place / "icd"), "PYOPENCL_NO_CACHE": "1"},
        **{"OCLGRIND_DATA_RACES": "1", "OCLGRIND_UNINITIALIZED": "1"},
        # Optimised, its detector stops at LLVM's `freeze` and takes vectors for undefined; inlined,
        # at noalias.scope.decl.
        **{"OCLGRIND_BUILD_OPTIONS": "-cl-opt-disable -DINLINED=static"},
        **{"OCLGRIND_MAX_ERRORS": "200", "OCLGRIND_GLOBAL_MEM_SIZE": str(2**31)},
        # A CPU's work-groups of the refinement take more than the 32 KB that it has by itself.
        "OCLGRIND_LOCAL_MEM_SIZE": str(2**20),
        # With more threads it loses track of what is initialised, and may crash.
        **{"OCLGRIND_NUM_THREADS": "1"},
    }


def _record(place: Path) -> dict | None:
    path = place / "record.json"
    return json.loads(path.read_text()) if path.is_file() else None


def oclgrind_reports(text: str) -> Iterator[Report]:
    """Yield the messages of Oclgrind: a line that says what, then tabbed lines of where."""
    pattern = r"^(\S[^\n]*)\n\tKernel: (\w+)\n((?:\t[^\n]*\n)*)"
    for what, kernel, where in re.findall(pattern, text, re.MULTILINE):
        line = re.search(r"[Aa]t line (\d+)[^\n]* of ([^\s:]+)", where)
        named = f"{line[2]}:{line[1]}" if line else "an unknown line"
        yield Report(kernel, re.sub(r" (at )?\S* ?(memory )?address 0x\w+", "", what), named)


# Compilers --------------------------------------------------------------------------------------


def compiler_problems(place: Path, program: Program, target: str) -> list[str]:
    """Return the warnings and errors of a compiler, and helpers that it left to a linker."""
    source, output = place / "program.cl", place / "program.s"
    source.write_text(program.source)
    output.unlink(missing_ok=True)
    if target == INTEL:
        more = ["-file", str(source), "-out_dir", str(place), "-options", program.options]
        command = ["ocloc", "compile", "-device", target, *more]
    else:
        command = [CLANG, "-x", "cl", "-target", "amdgcn-amd-amdhsa", f"-mcpu={target}"]
        command += ["-nogpulib", "-Xclang", "-finclude-default-header", "-O3", "-S"]
        command += ["-Wall", "-Wno-unused-function"]  # headers hold more than a kernel needs
        command += [*program.options.split(), str(source), "-o", str(output)]
    messages = _output(command, _COMPILING_LIMIT, dict(os.environ))
    problems = re.findall(r"^.*(?:warning|error):.*$", messages, re.MULTILINE)
    if output.is_file():
        problems += [f"{name} is not defined" for name in undefined_calls(output.read_text())]
    elif target != INTEL and not problems:
        problems.append(messages.strip()[-200:] or "no output")
    return problems


def undefined_calls(assembly: str) -> list[str]:
    """Return the functions of ours that AMD's assembly calls and does not define: C99's `inline`
    gives none where the compiler does not inline."""
    called = set(re.findall(r"([\w.]+)@(?:gotpcrel|rel)32@", assembly))
    defined = set(re.findall(r"^([\w.]+):", assembly, re.MULTILINE))
    return sorted(name for name in called - defined if not name.startswith(_FOREIGN))


def _output(command: list[str], limit: float, environment: dict[str, str]) -> str:
    try:
        ended = subprocess.run(
            command, cwd=ROOT, env=environment, timeout=limit, text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        printed = late.stdout or b""
        return f"{printed.decode(errors='replace')}\nerror: not done after {limit:g} s"
    return ended.stdout + (f"\nerror: exit code {ended.returncode}" if ended.returncode else "")


# Table ------------------------------------------------------------------------------------------


def table(kernels: Iterable[str], columns: Sequence[str], findings: Findings) -> Table:
    """Return a row for each kernel, with a verdict in each column."""
    shown = Table("kernel", *columns)
    for kernel in kernels:
        shown.add_row(kernel, *(verdict(kernel, column, findings) for column in columns))
    return shown


def verdict(kernel: str, column: str, findings: Findings) -> str:
    """Return ok, or how many different things are wrong, or that nothing was tried."""
    if wrong := findings.wrong.get((kernel, column), ()):
        return f"{len(wrong)} wrong"
    if column == "oclgrind":
        return "ok" if kernel in findings.launched else "not run"
    built = any(kernel in program.kernels for program in findings.programs)
    return "ok" if built else "not built"


if __name__ == "__main__":
    sys.exit(main())
