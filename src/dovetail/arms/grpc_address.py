"""An arm that `dovetail serve` offers: `grpc://HOST:PORT?KEY=VALUE&...`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self
from urllib.parse import unquote

from dovetail.arms.arm_address import ArmAddress, Keys
from dovetail.control.period import PERIODS
from dovetail.errors import ConfigError

PORT = 50051
LOOPBACK = ("localhost", "127.0.0.1", "::1")
_FILES = ("ca", "cert", "key")


@dataclass(frozen=True, kw_only=True)
class GrpcAddress(ArmAddress):
    """A service that owns an arm and its controller, here or on another machine."""

    transport: ClassVar[str] = "grpc"
    is_service: ClassVar[bool] = True

    host: str
    """Machine on which the service runs."""
    port: int
    """TCP port."""
    ca: Path | None = None
    """Certificate of the authority that signed the service's certificate."""
    cert: Path | None = None
    """Own certificate."""
    key: Path | None = None
    """Own private key."""
    token: str | None = field(default=None, repr=False, compare=False)
    """Token of the service, which `text` leaves out: texts are kept and sent around.
    None is that of the environment variable DOVETAIL_TOKEN."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address.

        Raises:
            ConfigError: Unknown key (lists the known ones), a file that is none, or
                another machine without certificates.
        """
        text, token = split_token(text)  # messages show the text
        keys = Keys(text, PORT, (*_FILES, "token", "period", "margins"))
        files = {
            name: Path(given).expanduser()
            for name in _FILES
            if (given := keys.get(name)) is not None
        }
        if ("cert" in files) != ("key" in files):
            given, needed = ("cert", "key") if "cert" in files else ("key", "cert")
            raise ConfigError(
                f"arm {text!r} gives {given} without {needed}; give both or none"
            )
        if not files and keys.host not in LOOPBACK:
            raise ConfigError(
                f"arm {text!r}: {keys.host} is another machine and needs certificates: "
                "add ?ca=FILE&cert=FILE&key=FILE"
            )
        for name, path in files.items():
            if not path.is_file():
                raise ConfigError(f"arm {name} {str(path)!r} is no file")
        return cls(
            text=text,
            token=token or None,
            host=keys.host,
            port=keys.port,
            period=keys.period(PERIODS),
            margins=keys.choice("margins", ("hardware", "model")),
            ca=files.get("ca"),
            cert=files.get("cert"),
            key=files.get("key"),
        )

    def describe_ground(self) -> str:
        """Return where a result was found."""
        return f"the arm at {self.text.partition('?')[0]}"

    @property
    def undisturbed(self) -> str:
        """Reason why nothing can push the arm: the service does not offer that."""
        return (
            "cannot be done to an arm over gRPC; try it where the arm is: --plant, "
            "--twin, or fri:// with control=HOST:PORT"
        )

    def with_approach(self) -> str:
        """Refuse it: who serves the arm says so."""
        raise ConfigError(
            f"approach is asked of {self.text!r}, which is not fri://; add "
            "approach=yes to the address of `dovetail serve`"
        )


def split_token(text: str) -> tuple[str, str]:
    """Return an address without the secret in it, and the secret, "" if it has none."""
    where, mark, keys = text.partition("?")
    kept, token = [], ""
    for pair in keys.split("&"):
        name, _, value = pair.partition("=")
        if unquote(name) == "token":
            token = unquote(value)
        else:
            kept.append(pair)
    return f"{where}{mark}{'&'.join(kept)}".removesuffix("?"), token
