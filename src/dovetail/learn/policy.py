"""A trained policy as plain numbers: loaded and run with NumPy alone.

A policy is a pair of files, NAME.safetensors (weights) and NAME.json (everything else:
shapes, environment, scaling, provenance, and the checksum of the weights). Nothing in
the files is executed.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError, PolicyError
from dovetail.files import write_atomic

FORMAT = "dovetail-policy"
VERSION = 1

POLICY_FOLDER = Path(__file__).parent.parent / "policies"
"""Where the shipped policies are."""

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weight (inputs, outputs) and bias (outputs,) of a dense layer."""

ACTIVATIONS = ("relu", "tanh")
OUTPUTS = ("tanh", "clip")

_HEADER = ("format", "version", "sha256")


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
        for i, (weight, bias) in enumerate(layers):
            rows = shapes[i - 1][1] if i else shapes[0][0]
            if weight.shape[0] != rows or bias.shape != weight.shape[1:]:
                raise PolicyError(
                    f"policy layer {i} has weights of shape {weight.shape} and a bias "
                    f"of shape {bias.shape}; its neighbour needs {rows} rows"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PolicyError(f"policy layer {i} holds a number that is not finite")
        self.observation_size = int(shapes[0][0])
        self.action_size = int(shapes[-1][1])

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action for one observation, each number in [-1, 1].

        Args:
            observation: The environment's observation, shape (observation_size,).

        Raises:
            PolicyError: Wrong size, or a number that is not finite.
        """
        x = np.asarray(observation, dtype=np.float32)
        if x.shape != (self.observation_size,):
            raise PolicyError(
                f"the observation has shape {x.shape}, this policy was trained with "
                f"({self.observation_size},); its file names stack = "
                f"{self._section('env').get('stack')}: give the environment that, and "
                "where it has that already, export the policy again"
            )
        if not np.isfinite(x).all():
            index = int(np.flatnonzero(~np.isfinite(x))[0])
            raise PolicyError(
                f"observation[{index}] is {x[index]}; needs a finite number"
            )
        for weight, bias in self.layers[:-1]:
            x = x @ weight + bias
            x = np.maximum(x, 0.0) if self._is_relu else np.tanh(x)
        weight, bias = self.layers[-1]
        x = x @ weight + bias
        return np.tanh(x) if self._is_tanh else np.clip(x, -1.0, 1.0)

    def require_env(self, env_id: str, env: Mapping[str, Any]) -> None:
        """Refuse an environment in which observation or action mean something else.

        Args:
            env_id: Gymnasium id.
            env: Its keyword arguments; "task" and "stack" are compared where given,
                the others (peg, clearance, plant, ...) may differ from training.

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
        data = save(
            {
                f"layer{i}.{name}": np.ascontiguousarray(array, dtype=np.float32)
                for i, layer in enumerate(self.layers)
                for name, array in zip(("weight", "bias"), layer, strict=True)
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
        from safetensors import SafetensorError
        from safetensors.numpy import load

        weights, sidecar = policy_files(path)
        metadata = _read_sidecar(sidecar)
        data = _read(weights)
        if hashlib.sha256(data).hexdigest() != metadata.get("sha256"):
            raise PolicyError(
                f"{weights} ({len(data)} bytes) is cut short, damaged or not the "
                f"partner of {sidecar.name}: its SHA-256 is not the one noted "
                "there; copy both files again"
            )
        try:
            tensors = load(data)
            layers = [
                (tensors[f"layer{i}.weight"], tensors[f"layer{i}.bias"])
                for i in range(len(tensors) // 2)
            ]
        except (SafetensorError, KeyError) as error:
            raise PolicyError(f"{weights} holds no policy: {error}") from error
        return cls(layers, metadata)

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
    """Return the path of a policy given as a file or by a shipped policy's name.

    Raises:
        ConfigError: Neither; lists the shipped ones.
    """
    path = Path(name_or_path).expanduser()
    if any(file.is_file() for file in policy_files(path)):
        return policy_files(path)[0]
    if name_or_path in list_policies():
        return POLICY_FOLDER / f"{name_or_path}.safetensors"
    raise ConfigError(
        f"no policy {name_or_path!r}: there are no such files (NAME.safetensors "
        "and NAME.json), and the shipped policies are: "
        f"{', '.join(list_policies()) or 'none'}"
    )


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise PolicyError(
            f"cannot read {path}: {error.strerror}; a policy is the pair "
            "NAME.safetensors and NAME.json in one folder"
        ) from error


def _read_sidecar(path: Path) -> dict[str, Any]:
    content = _read(path)
    try:
        metadata = json.loads(content)
    except ValueError as error:
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
