"""Web server of the page: on this machine alone, at exactly the port given."""

import io
import socket
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dovetail.cockpit.page_log import PageLog
from dovetail.errors import ConfigError, MissingDependencyError, install_command

if TYPE_CHECKING:
    import viser

    from dovetail.cockpit.gate import Gate

HOST = "127.0.0.1"
"""Address that the server listens at."""
PORT = 8080


@dataclass(frozen=True)
class PageServer:
    """Web server of a page, and the gate in front of it."""

    viser: "viser.ViserServer"
    """Server that draws the page."""
    gate: "Gate"
    """Access control."""
    log: PageLog
    """Log of the server."""

    @property
    def port(self) -> int:
        """Port that it listens at."""
        return self.viser.get_port()

    @property
    def address(self) -> str:
        """Address of the page; anyone who knows it may drive."""
        return f"http://{HOST}:{self.port}/{self.gate.drive_token}/"

    @property
    def watch_address(self) -> str:
        """Address that sees everything and may stop, but never drive."""
        return f"http://{HOST}:{self.port}/{self.gate.watch_token}/"

    def stop(self) -> None:
        """Close every connection, and listen no more."""
        self.gate.close()
        self.viser.stop()
        self.log.close()


def open_server(port: int = PORT) -> PageServer:
    """Start the web server behind a gate, and test the gate.

    Args:
        port: Port to listen at; 0 is any free one.

    Raises:
        MissingDependencyError: viser is not installed.
        ConfigError: The port is not free, or out of range.
        GateError: The installed viser cannot be guarded.
    """
    try:
        import viser
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"the page needs viser ({error.name} is not installed): "
            f"{install_command('view')}"
        ) from error
    from dovetail.cockpit.gate import Gate, require_closed, serving

    if not 0 <= port <= 65535:
        raise ConfigError(f"port is {port}; allowed: 0 to 65535, 0 is any free one")
    _require_free(port)
    gate = Gate(f"viser-v{viser.__version__}")
    # viser prints an address without the token, which opens nothing.
    with serving(gate), redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=HOST, port=port, verbose=False)
    opened = PageServer(server, gate, PageLog())
    try:
        if port not in (0, opened.port):  # taken meanwhile: viser chose another
            raise _taken(port)
        gate.guard(server)
        require_closed(gate, opened.port)
    except BaseException:
        opened.stop()
        raise
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.set_panel_label("dovetail")
    server.initial_camera.position = (1.55, -1.15, 0.85)
    server.initial_camera.look_at = (0.32, 0.0, 0.36)
    server.initial_camera.fov = 0.72
    return opened


def light(scene: "viser.SceneApi") -> None:
    """Light the scene with two lights.

    An environment map looks a little better and takes a browser without a GPU six times
    as long.
    """
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere(
        "/light/sky",
        sky_color=(255, 255, 255),
        ground_color=(150, 145, 138),
        intensity=2.2,
    )
    scene.add_light_directional("/light/sun", intensity=2.0, position=(1.0, -1.5, 2.0))


def _require_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except PermissionError as error:
            raise ConfigError(
                f"this user may not listen at port {port}: {error.strerror}; "
                "give another with --port, 1024 or more"
            ) from error
        except OSError as error:
            raise _taken(port) from error


def _taken(port: int) -> ConfigError:
    return ConfigError(
        f"port {port} is in use on {HOST}, perhaps by another cockpit: end that one, "
        "or give another with --port; 0 is any free one"
    )
