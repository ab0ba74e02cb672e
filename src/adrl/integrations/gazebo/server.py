"""A gzserver process with our plugin in it, and the connection to that."""

import functools
import hashlib
import os
import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from xml.etree.ElementTree import Element

from adrl.errors import MissingExtra, WorldError
from adrl.worlds.sdf_write import to_bytes

PATIENCE_S = 120.0
"""Time in which Gazebo must answer; a start on a busy machine took 20 s."""
SETUP = "run scripts/gazebo-chroot of the source, as root"


def gazebo_folder() -> Path:
    """The folder that scripts/gazebo-chroot fills: ADRL_GAZEBO, or adrl/gazebo in the user's cache."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("ADRL_GAZEBO") or Path(cache) / "adrl" / "gazebo")


@functools.cache
def plugin_file() -> str:
    """Name of the plugin's library, with the checksum of its source: a build of another source is never loaded."""
    source = Path(__file__).parent / "plugin"
    text = b"".join(path.read_bytes() for path in sorted(source.glob("*.?pp")))
    return f"libadrl_lockstep-{hashlib.sha256(text).hexdigest()[:12]}.so"


def is_installed() -> bool:
    """Whether scripts/gazebo-chroot has done its work, for the plugin of today."""
    folder = gazebo_folder()
    chroot = folder / "root"
    return ((chroot / "opt/adrl" if chroot.is_dir() else folder) / plugin_file()).exists()


class GazeboServer:
    """gzserver on a world, headless, that waits for our messages. Use as a context, or close()."""

    def __init__(self, world_sdf: Element, *, seed: int = 0, rendered: bool = False) -> None:
        """world_sdf: the document of a world with our plugin, whose port is filled in here. rendered: for cameras,
        whose frames are saved.

        Raises MissingExtra where Gazebo is not set up, WorldError when it does not start.
        """
        folder = gazebo_folder()
        if not is_installed():
            raise MissingExtra(
                f"Gazebo is not set up in {folder}: no {plugin_file()} of this version; {SETUP}"
            )
        root = folder / "root"
        chroot = root.is_dir()
        self._files = Path(tempfile.mkdtemp(prefix="adrl-", dir=root / "tmp" if chroot else None))
        self._display: subprocess.Popen[bytes] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._log = self._files / "log"
        try:
            with socket.create_server(("127.0.0.1", 0)) as listener:
                world = self._files / "adrl.world"
                for port in world_sdf.iterfind("world/plugin/port"):
                    port.text = str(listener.getsockname()[1])
                inside = Path("/", world.relative_to(root)) if chroot else world
                for path in world_sdf.iter("path"):
                    path.text = str(inside.parent / "frames")
                world.write_bytes(to_bytes(world_sdf))
                self._process = self._start(root if chroot else None, folder, inside, seed, rendered)
                self._socket = self._accept(listener)
        except BaseException:
            self.close()
            raise

    def _start(
        self, root: Path | None, folder: Path, world: Path, seed: int, rendered: bool
    ) -> subprocess.Popen[bytes]:
        command = ["gzserver", "--seed", str(seed + 1), str(world)]
        if root is not None:
            # Only root may chroot; others may in a user namespace of their own.
            enter = [] if os.geteuid() == 0 else ["unshare", "--map-root-user"]
            prefix = [*enter, "chroot", str(root)]
        else:
            prefix = []
        environment = {
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": str(world.parent),
            "LC_ALL": "C",
            "GAZEBO_MASTER_URI": f"http://127.0.0.1:{_free_port()}",
            "GAZEBO_IP": "127.0.0.1",
            "GAZEBO_MODEL_DATABASE_URI": "",
            "GAZEBO_PLUGIN_PATH": "/opt/adrl" if root is not None else str(folder),
            "GAZEBO_RESOURCE_PATH": "/usr/share/gazebo-11",
        }
        if rendered:
            # Gazebo waits for its cameras, so that no frame is left out.
            command.append("--lockstep")
            environment |= {"DISPLAY": self._open_display(prefix), "LIBGL_ALWAYS_SOFTWARE": "1"}
        with open(self._log, "wb") as log:
            return subprocess.Popen(
                [*prefix, *command],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,  # Ctrl-C is for the parent, which then ends it
            )

    def _open_display(self, prefix: list[str]) -> str:
        """A screen in memory that Gazebo renders with. Raises MissingExtra without Xvfb."""
        reader, writer = os.pipe()
        command = ["Xvfb", "-displayfd", str(writer), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
        try:
            self._display = subprocess.Popen(
                [*prefix, *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(writer,),
                process_group=0,
            )
        except FileNotFoundError:
            os.close(reader)
            raise MissingExtra("cameras need Xvfb; install the package xvfb") from None
        finally:
            os.close(writer)
        with open(reader, "rb") as numbers:
            number = numbers.readline().decode().strip()
        if not number:
            raise MissingExtra("cameras need Xvfb, which did not start; install the package xvfb")
        return f":{number}"

    def frames(self) -> list[bytes]:
        """Pictures that cameras have saved, in order."""
        return [path.read_bytes() for path in sorted((self._files / "frames").glob("*.jpg"))]

    def _accept(self, listener: socket.socket) -> socket.socket:
        """The plugin's connection."""
        assert self._process is not None
        listener.settimeout(0.2)
        give_up_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up_s:
            try:
                connection, _ = listener.accept()
            except TimeoutError:
                if self._process.poll() is not None:
                    raise WorldError(f"Gazebo ended before it was ready: {self._words()}") from None
                continue
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.settimeout(PATIENCE_S)
            return connection
        raise WorldError(f"Gazebo was not ready in {PATIENCE_S:.0f} s: {self._words()}")

    @property
    def process_id(self) -> int:
        """Of gzserver, which chroot and unshare have become."""
        assert self._process is not None
        return self._process.pid

    def exchange(self, message: bytes, reply: memoryview) -> None:
        """Send a message and fill reply with the answer. Raises WorldError when Gazebo has ended."""
        assert self._socket is not None
        try:
            self._socket.sendall(message)
            while reply:
                got = self._socket.recv_into(reply)
                if got == 0:
                    raise ConnectionError("closed")
                reply = reply[got:]
        except OSError as error:
            raise WorldError(f"Gazebo does not answer ({error}): {self._words()}") from None

    def _words(self) -> str:
        """The last lines of Gazebo's output."""
        lines = self._log.read_text(errors="replace").split("\n")
        return " / ".join(line.strip() for line in lines[-6:] if line.strip()) or "it wrote nothing"

    def close(self) -> None:
        """End Gazebo and delete its files. Doing so again changes nothing."""
        if self._socket is not None:
            self._socket.close()  # upon which the plugin ends its process
            self._socket = None
        if self._process is not None:
            try:
                self._process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        if self._display is not None:
            self._display.kill()
            self._display.wait()
            self._display = None
        shutil.rmtree(self._files, ignore_errors=True)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]
