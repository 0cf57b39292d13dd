"""The web server of the page: on this machine alone, at exactly the port asked for."""

import socket
from typing import TYPE_CHECKING

from dovetail.errors import ConfigError, MissingDependencyError, install_command

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
"""Where it listens: whoever may log in to this machine may drive the arm."""
PORT = 8080


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
    server = viser.ViserServer(host=HOST, port=port, verbose=False)
    if port not in (0, server.get_port()):  # somebody was faster: viser took another
        server.stop()
        raise _taken(port)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.set_panel_label("dovetail")
    server.scene.configure_default_lights(cast_shadow=False)
    server.initial_camera.position = (1.35, -0.85, 0.75)
    server.initial_camera.look_at = (0.45, 0.0, 0.3)
    server.initial_camera.fov = 0.75
    return server


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
