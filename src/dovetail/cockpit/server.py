"""The web server of the page: on this machine alone, at exactly the port asked for."""

import logging
import socket
from typing import TYPE_CHECKING

from dovetail.errors import ConfigError, MissingDependencyError, install_command

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
"""Where it listens: whoever may log in to this machine may drive the arm."""
PORT = 8080
_SOCKETS = "websockets.server"
"""Name under which the page's sockets say what went wrong in them."""


def open_server(port: int = PORT) -> "viser.ViserServer":
    """Start the web server.

    Args:
        port: To listen at; 0 is any free one.

    Raises:
        MissingDependencyError: viser is not installed.
        ConfigError: The port is not free, or none.
    """
    try:
        import viser
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"the page needs viser ({error.name} is not installed): "
            f"{install_command('view')}"
        ) from error
    if not 0 <= port <= 65535:
        raise ConfigError(f"port is {port}; allowed: 0 to 65535, 0 is any free one")
    _require_free(port)
    logging.getLogger(_SOCKETS).addFilter(_in_a_line)
    server = viser.ViserServer(host=HOST, port=port, verbose=False)
    if port not in (0, server.get_port()):  # somebody was faster: viser took another
        server.stop()
        raise _taken(port)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.set_panel_label("dovetail")
    server.initial_camera.position = (1.55, -1.15, 0.85)
    server.initial_camera.look_at = (0.32, 0.0, 0.36)
    server.initial_camera.fov = 0.72
    return server


def light(scene: "viser.SceneApi") -> None:
    """Light the scene so that a browser without a GPU draws it, too.

    An environment map looks a little better and takes such a browser six times as long.
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


def _in_a_line(record: logging.LogRecord) -> bool:
    """Say of what no browser sends, such as a port scan, a line and no traceback."""
    if record.exc_info:
        error = record.exc_info[1]
        why = f"{type(error).__name__}: {error}".strip().splitlines()[0]
        record.msg, record.args = f"page: {record.getMessage()} ({why})", ()
        record.exc_info = None
    return True


def _require_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except PermissionError as error:
            raise ConfigError(
                f"port {port} needs rights that this user has not: {error.strerror}; "
                "give one from 1024 on with --port"
            ) from error
        except OSError as error:
            raise _taken(port) from error


def _taken(port: int) -> ConfigError:
    return ConfigError(
        f"port {port} is in use on {HOST}, by another cockpit perhaps: end that one, "
        "or give another with --port; 0 is any free one"
    )
