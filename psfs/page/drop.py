"""Files that are dropped onto the page: a script of the page sends them, a folder takes them.

viser has no way to drop files. The script opens a websocket below the page's address, whose token
it thereby states, and sends each file as its name and size, then its bytes in pieces; an empty
name ends them. Each message is answered before the next one is sent.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path, PurePath, PureWindowsPath
from typing import Any

from cl import UserError
from psfs.common.files import write_atomically
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES

#: Path of the websocket below the page's address.
PATH = "/dropped-files"
#: Suffixes of files that are taken: footage, and what belongs to it.
SUFFIXES = VIDEO_SUFFIXES | IMAGE_SUFFIXES | {".toml", ".json", ".xml", ".txt", ".trc", ".c3d"}
#: What the page says and shows while files are over it, and the size of the pieces.
SCRIPT = """<script>
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", async (event) => {
  event.preventDefault();
  const files = [...event.dataTransfer.files];
  if (!files.length) return;
  const note = document.body.appendChild(document.createElement("div"));
  note.style = "position:fixed;left:50%;top:40%;transform:translateX(-50%);z-index:9999;" +
    "padding:16px 24px;border-radius:8px;background:#1d2530;color:#fff;font:16px sans-serif";
  const address = location.href.split("?")[0].replace(/^http/, "ws").replace(/\\/?$/, "PATH");
  const socket = new WebSocket(address);
  const answered = () => new Promise((done, fail) => {
    socket.onmessage = (message) => message.data ? fail(message.data) : done();
    socket.onclose = socket.onerror = () => fail("the page's server has closed");
  });
  try {
    await new Promise((done, fail) => { socket.onopen = done; socket.onerror = fail; });
    for (const file of files) {
      let answer = answered();
      socket.send(JSON.stringify({ name: file.name, size: file.size }));
      await answer;
      for (let at = 0; at < file.size; at += PIECE) {
        note.textContent = `${file.name}: ${Math.round(100 * at / file.size)} %`;
        answer = answered();
        socket.send(await file.slice(at, at + PIECE).arrayBuffer());
        await answer;
      }
    }
    const answer = answered();
    socket.send(JSON.stringify({ name: "", size: 0 }));
    await answer;
    note.remove();
  } catch (error) {
    note.textContent = error;
    setTimeout(() => note.remove(), 8000);
  }
  socket.close();
});
</script>""".replace("PIECE", str(2**22)).replace("PATH", PATH)


async def receive_files(
    connection: Any, make_folder: Callable[[], Path], received: Callable[[Path], object]
) -> None:
    """Write the files that a page sends into the folder that `make_folder` names, and tell
    `received` of it. A file that cannot be taken is answered with what was expected, and ends it.
    Files that have not arrived whole are removed."""
    from websockets.exceptions import ConnectionClosed

    messages = aiter(connection)
    folder = None
    try:
        async for text in messages:
            stated = json.loads(text)
            name, size = str(stated["name"]), int(stated["size"])
            if not name:
                if folder is not None:
                    received(folder)
                await connection.send("")
                return
            path = PurePath(PureWindowsPath(name).name)
            if path.suffix.lower() not in SUFFIXES or path.name.startswith("."):
                await connection.send(f"{path.name}: expected videos, pictures or a calibration")
                return
            if folder is None:
                folder = make_folder()
                folder.mkdir(parents=True, exist_ok=True)
            with write_atomically(folder / path.name) as temporary, temporary.open("wb") as file:
                await connection.send("")
                await _receive(messages, size, file.write, connection.send)
    except ConnectionClosed:  # the page
        return
    except (UserError, OSError, ValueError, KeyError, TypeError) as error:
        with suppress(ConnectionClosed):
            await connection.send(f"{error}")
    finally:
        with suppress(OSError):  # it holds files
            if folder is not None:
                folder.rmdir()


async def _receive(
    messages: AsyncIterator[Any], size: int, write: Callable[[bytes], object], answer: Any
) -> None:
    """Write `size` bytes of messages; raise ValueError if others come, or they end before."""
    left = size
    while left > 0:
        piece = await anext(messages, None)
        if not isinstance(piece, bytes) or len(piece) > left:
            raise ValueError(f"a file ended {left} bytes early; drop it again")
        write(piece)
        left -= len(piece)
        await answer("")
