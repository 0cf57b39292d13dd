"""A trained policy as plain numbers: loaded and run with NumPy alone.

A policy is a pair of files, NAME.safetensors (weights) and NAME.json (everything else:
shapes, environment, scaling, provenance, and the checksum of the weights). Nothing in
the files is executed.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError, PolicyError, did_you_mean
from dovetail.files import write_atomic
from dovetail.reading import parse_json, read_bytes

FORMAT = "dovetail-policy"
VERSION = 1
WEIGHT_BYTES = 100_000_000
"""Largest file of weights that is read [bytes]; the shipped ones have up to 0.4 MB."""
_HEADER_BYTES = 1_000_000
"""Longest header of it, which lists the tensors."""
_SIDECAR_BYTES = 4_000_000
"""Largest JSON file beside it [bytes]."""

RUN_POLICY = "policy.safetensors"
"""A training's policy in the folder of its run."""
POLICY_FOLDER = Path(__file__).parent.parent / "policies"
"""Folder of the shipped policies."""

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weight (inputs, outputs) and bias (outputs,) of a dense layer."""

ACTIVATIONS = ("relu", "tanh")
OUTPUTS = ("tanh", "clip")

_HEADER = ("format", "version", "sha256")


class Actor(Protocol):
    """Policy, script or search that chooses actions; `reset` begins an episode."""

    def reset(self) -> None:
        """Forget the last episode."""
        ...

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[Any]:
        """Return the action for the newest observation."""
        ...


class Policy:
    """A multilayer perceptron from an environment's observation to its action.

    Called with an observation as the environment returns it (scaled, stacked), it gives
    the mean action in [-1, 1], without exploration.
    """

    def __init__(self, layers: list[Layer], metadata: Mapping[str, Any]) -> None:
        """Take the weights.

        Args:
            layers: The dense layers, first to last.
            metadata: Content of the JSON file.

        Raises:
            PolicyError: The weights do not fit the metadata or one another.
        """
        self.layers = layers
        self.metadata = dict(metadata)
        network = self._section("network")
        self._is_relu = _known("activation", network, ACTIVATIONS) == "relu"
        self._is_tanh = _known("output", network, OUTPUTS) == "tanh"
        shapes = [list(weight.shape) for weight, _ in layers]
        if not layers or network.get("layers") != shapes:
            raise PolicyError(
                f"the weights have shapes {shapes}, the policy's JSON file says "
                f"{network.get('layers')}; export the policy again"
            )
        width = shapes[0][0]
        self.observation_size = int(width)
        for i, (weight, bias) in enumerate(layers):
            if weight.shape[0] != width or bias.shape != weight.shape[1:]:
                raise PolicyError(
                    f"policy layer {i} has weights of shape {weight.shape} and a bias "
                    f"of shape {bias.shape}; its neighbour needs {width} rows"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PolicyError(f"policy layer {i} holds a number that is not finite")
            width = weight.shape[1]
        self.action_size = int(shapes[-1][1])

    def reset(self) -> None:
        """Do nothing: its actions depend on the newest observation alone."""

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action for one observation, each number in [-1, 1].

        Args:
            observation: The environment's observation, shape (observation_size,).

        Raises:
            PolicyError: Wrong size, or a number that is not finite.
        """
        x = np.asarray(observation, dtype=np.float32)
        self.require_size(x, (self.action_size,))
        if not np.isfinite(x).all():
            index = int(np.flatnonzero(~np.isfinite(x))[0])
            raise PolicyError(
                f"observation[{index}] is {x[index]}; needs a finite number"
            )
        last = len(self.layers) - 1
        for i, (weight, bias) in enumerate(self.layers):
            x = x @ weight + bias
            if i < last:
                x = np.maximum(x, 0.0) if self._is_relu else np.tanh(x)
        return np.tanh(x) if self._is_tanh else np.clip(x, -1.0, 1.0)

    def require_size(self, observation: ArrayLike, action: tuple[int, ...]) -> None:
        """Refuse an observation or an action of another size.

        Args:
            observation: The environment's observation.
            action: Shape of the action that the environment takes.

        Raises:
            PolicyError: Names both shapes.
        """
        shape = np.shape(observation)
        if shape != (self.observation_size,):
            raise PolicyError(
                f"the observation has shape {shape}, this policy was trained with "
                f"({self.observation_size},); its file names stack = "
                f"{self._section('env').get('stack')}: give the environment that, and "
                "where it has that already, export the policy again"
            )
        if action != (self.action_size,):
            raise PolicyError(
                f"the policy gives actions of shape ({self.action_size},), its "
                f"environment takes {action}: it was trained for another task"
            )

    def require_env(self, env_id: str, env: Mapping[str, Any]) -> None:
        """Refuse an environment in which observation or action mean something else.

        Args:
            env_id: Gymnasium id.
            env: Its keyword arguments; "task" and "stack" are compared where given,
                the others (clearance, plant, ...) may differ from training.

        Raises:
            PolicyError: Names what differs, and both values.
        """
        own = self._section("env")
        pairs = [("environment", self.metadata.get("env_id"), env_id)]
        if "task" in env:
            trained, asked = TaskSpec.parse(own["task"]), TaskSpec.parse(env["task"])
            pairs.append(("task", str(trained), str(asked)))
        if "stack" in env:
            pairs.append(("stack", own.get("stack"), env["stack"]))
        for name, trained, asked in pairs:
            if trained != asked:
                raise PolicyError(
                    f"this policy was trained for the {name} {trained!r}, not for "
                    f"{asked!r}; choose that {name} or another policy"
                )

    def save(self, path: str | Path) -> Path:
        """Write the pair of files, each whole or absent.

        Args:
            path: NAME, NAME.json or NAME.safetensors.

        Returns:
            Path of the weights.

        Raises:
            LogError: The disk is full or the folder is not writable.
        """
        from safetensors.numpy import save

        weights, sidecar = policy_files(path)
        tensors = {
            f"layer{i}.{name}": array
            for i, layer in enumerate(self.layers)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }
        data = save(
            {
                name: np.ascontiguousarray(array, dtype=np.float32)
                for name, array in tensors.items()
            }
        )
        self.metadata = {
            "format": FORMAT,
            "version": VERSION,
            "sha256": hashlib.sha256(data).hexdigest(),
            **{k: v for k, v in self.metadata.items() if k not in _HEADER},
        }
        text = json.dumps(self.metadata, indent=2, allow_nan=False) + "\n"
        write_atomic(weights, data)
        write_atomic(sidecar, text)
        return weights

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a policy.

        Args:
            path: NAME, NAME.json or NAME.safetensors; both files are read.

        Raises:
            PolicyError: A file is missing, cut short, no policy, of another version, or
                not the partner of the other.
        """
        weights, sidecar = policy_files(path)
        metadata = _read_sidecar(sidecar)
        data = _read(weights, WEIGHT_BYTES)
        if hashlib.sha256(data).hexdigest() != metadata.get("sha256"):
            raise PolicyError(
                f"{weights} ({len(data)} bytes) is cut short, damaged or not the "
                f"partner of {sidecar.name}: its SHA-256 is not the one noted "
                "there; copy both files again"
            )
        return cls(_read_layers(data, weights), metadata)

    def _section(self, name: str) -> Mapping[str, Any]:
        section = self.metadata.get(name)
        if not isinstance(section, Mapping):
            raise PolicyError(
                f"the policy's JSON file has no section {name!r}; export it again"
            )
        return section


def policy_files(path: str | Path) -> tuple[Path, Path]:
    """Return the paths of weights and sidecar, given either one or NAME alone."""
    path = Path(path)
    name = path.name.removesuffix(".safetensors").removesuffix(".json")
    return path.with_name(f"{name}.safetensors"), path.with_name(f"{name}.json")


def list_policies() -> tuple[str, ...]:
    """Return the names of the shipped policies."""
    return tuple(sorted(path.stem for path in POLICY_FOLDER.glob("*.safetensors")))


def find_policy(name_or_path: str) -> Path:
    """Return the path of a policy: a file, a training's folder or a shipped one's name.

    Raises:
        ConfigError: None of these; lists the shipped ones.
    """
    path = Path(name_or_path).expanduser()
    if any(file.is_file() for file in policy_files(path)):
        return policy_files(path)[0]
    if (path / RUN_POLICY).is_file():
        return path / RUN_POLICY
    if name_or_path in list_policies():
        return POLICY_FOLDER / f"{name_or_path}.safetensors"
    if path.is_dir():
        raise ConfigError(
            f"{path} is a folder without {RUN_POLICY}, which a training writes at its "
            "end: give the folder of one that has ended, or a policy's file"
        )
    raise ConfigError(
        f"no policy {name_or_path!r}{did_you_mean(name_or_path, list_policies())}: "
        "there are no such files (NAME.safetensors and NAME.json), and the shipped "
        "policies are: "
        f"{', '.join(list_policies()) or 'none'}"
    )


def _read(path: Path, limit: int) -> bytes:
    try:
        return read_bytes(path, limit)
    except OSError as error:
        raise PolicyError(
            f"cannot read {path}: {error.strerror}; a policy is the pair "
            "NAME.safetensors and NAME.json in one folder"
        ) from error


def _read_layers(data: bytes, path: Path) -> list[Layer]:
    """Return the layers in a file of weights."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    header = int.from_bytes(data[:8], "little")
    if header > _HEADER_BYTES:
        raise PolicyError(
            f"{path} holds no policy: its header has {header} bytes; allowed: up to "
            f"{_HEADER_BYTES}"
        )
    try:
        tensors = load(data)  # holds shapes and offsets against the file's size
        layers = [
            (tensors.pop(f"layer{i}.weight"), tensors.pop(f"layer{i}.bias"))
            for i in range(len(tensors) // 2)
        ]
    except (SafetensorError, KeyError, AttributeError, TypeError, ValueError) as error:
        raise PolicyError(f"{path} holds no policy: {error}") from error
    for i, layer in enumerate(layers):
        for array, ndim in zip(layer, (2, 1), strict=True):
            if array.dtype != np.float32 or array.ndim != ndim:
                raise PolicyError(
                    f"{path} holds no policy: layer {i} has an array of {array.dtype} "
                    f"and shape {array.shape}; needs float32, {ndim} axes"
                )
    if tensors:
        raise PolicyError(f"{path} holds {str([*tensors])[:80]}, which is no layer")
    return layers


def _read_sidecar(path: Path) -> dict[str, Any]:
    content = _read(path, _SIDECAR_BYTES)
    try:
        metadata = parse_json(content, str(path), is_finite=True)
    except ConfigError as error:
        raise PolicyError(
            f"{path} ({len(content)} bytes) is cut short or no JSON: {error}; copy it "
            "again"
        ) from error
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise PolicyError(
            f"{path} does not describe a policy: format is not {FORMAT!r}"
        )
    if metadata.get("version") != VERSION:
        raise PolicyError(
            f"{path} has format version {metadata.get('version')!r}, this release "
            f"reads {VERSION}"
        )
    return metadata


def _known(name: str, network: Mapping[str, Any], known: tuple[str, ...]) -> str:
    value = network.get(name)
    if value not in known:
        raise PolicyError(
            f"policy {name} {value!r} is unknown; known: {', '.join(known)}"
        )
    return value
