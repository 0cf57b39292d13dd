"""The identified model that a training simulates, as it was when the run began."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError
from dovetail.plants.twin import Twin, load_twin
from dovetail.reading import TOML_BYTES, read_bytes


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """A model file's content: a twin file, which is what identification writes."""

    name: str
    """File name without its folder."""
    content: bytes
    """The file's bytes."""
    twin: Twin
    """Dynamics, command delay and noise; its engine gives way to the training's."""

    @classmethod
    def load(cls, path: Path) -> "ModelFile":
        """Read a model file once; later changes of the file do not matter.

        Raises:
            ConfigError: No such file, not .toml, or damaged: which key, its value and
                what is allowed.
        """
        if path.suffix != ".toml" or not path.is_file():
            raise ConfigError(
                f"no model file {path}; give the .toml file that `dovetail identify "
                "fit` wrote, or any twin file"
            )
        try:
            content = read_bytes(path, TOML_BYTES)
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror}") from error
        return cls(name=path.name, content=content, twin=load_twin(path))

    def table(self) -> dict[str, Any]:
        """Return the file's table, as JSON knows it."""
        table: dict[str, Any] = json.loads(json.dumps(self.twin.table()))
        return table

    def describe(self) -> dict[str, Any]:
        """Return name, checksum and table, for a policy's provenance."""
        digest = hashlib.sha256(self.content).hexdigest()
        return {"file": self.name, "sha256": digest, "table": self.table()}
