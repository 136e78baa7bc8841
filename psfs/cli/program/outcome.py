"""The end of a command: its exit code, and one line on standard error if it failed."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from cl import UserError
from psfs.common.names import escape_unprintable
from psfs.common.system import handle_signals

DONE, MENDABLE, UNEXPECTED, INTERRUPTED = 0, 2, 70, 130
_LONGEST_LINE = 800
#: Signals that are handled like Ctrl-C: finished work is kept.
_ENDING = ("SIGTERM", "SIGHUP")


def exit_code(program: str, run: Callable[[], None]) -> int:
    """Call `run` and return the exit code.

    0: success. 2: an error that the user can mend. 130: interrupted, also by SIGTERM and SIGHUP.
    70: a bug of the program, with the traceback in a log file. All but 0 print one line on standard
    error.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # for LANG=C and paths that are not UTF-8
            stream.reconfigure(errors="backslashreplace")
    try:
        with _interrupt_on_signals():
            run()
        sys.stdout.flush()
        return DONE
    except SystemExit as exit:  # from the parser, which has printed the reason
        return exit.code if isinstance(exit.code, int) else DONE
    except BrokenPipeError:  # `psfs info x | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except KeyboardInterrupt:
        _say(f"{program}: interrupted")
        return INTERRUPTED
    except Exception as error:
        reason = describe_user_error(error)
        if reason is not None:
            _say(f"{program}: error: {reason}")
            return MENDABLE
        _say(f"{program}: error: {describe(error)}; please report it{_write_traceback(program)}")
        return UNEXPECTED


def describe(error: BaseException) -> str:
    """Return the message of an error: of one that the user can mend its reason, of others that they
    are unexpected, with their kind."""
    reason = describe_user_error(error) if isinstance(error, Exception) else None
    if reason is not None:
        return reason
    text = " ".join(str(error).split())[: _LONGEST_LINE // 2]
    return f"unexpected {type(error).__name__}{f': {text}' if text else ''}"


def describe_user_error(error: Exception) -> str | None:
    """Return the message for an error that the user can mend: the program's own errors, those of
    the file system, and a lack of memory. Return None for all others, which are bugs."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError) and error.errno is not None:
        where = (
            f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        )
        return f"{where}cannot be read or written: {error.strerror}"
    short = "not enough memory; expected fewer or larger voxels, smaller pictures or fewer frames"
    if isinstance(error, MemoryError):
        return short
    return short if _is_memory_of_opencv(error) else None


def _is_memory_of_opencv(error: Exception) -> bool:
    cv2 = sys.modules.get("cv2")  # an error of OpenCV's comes from an imported OpenCV
    return cv2 is not None and isinstance(error, cv2.error) and error.code == cv2.Error.StsNoMem


@contextlib.contextmanager
def _interrupt_on_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt inside, in the main thread, on the signals of `_ENDING`."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with handle_signals(interrupt, _ENDING):
        yield


def _say(text: str) -> None:
    # A closed or full standard error must not hide the exit code.
    with contextlib.suppress(OSError):
        line = escape_unprintable(text)
        if len(line) > _LONGEST_LINE:  # an error may quote a list of a thousand numbers
            line = f"{line[: _LONGEST_LINE // 2]} ... {line[-_LONGEST_LINE // 2 :]}"
        print(line, file=sys.stderr, flush=True)


def _write_traceback(program: str) -> str:
    """Write the traceback of the current error to a file; return a text that names the file."""
    name = f"{program.split()[0]}-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.log"
    try:
        path = Path(tempfile.gettempdir()) / name
        arguments = " ".join(map(repr, sys.argv[1:]))
        text = f"{program} {arguments}\n{traceback.format_exc()}"
        path.write_text(text, encoding="utf-8", errors="backslashreplace")
    except OSError:
        return " with the command that you gave"
    return f" with the log {path}"
