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
from dovetail.learn.gru import TENSORS, Gru

FORMAT = "dovetail-policy"
VERSIONS = (1, 2)
"""Versions that are read: 2 is 1 with a memory, and written only where there is one."""

RUN_POLICY = "policy.safetensors"
"""A training's policy in the folder of its run."""
POLICY_FOLDER = Path(__file__).parent.parent / "policies"
"""Where the shipped policies are."""

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weight (inputs, outputs) and bias (outputs,) of a dense layer."""

ACTIVATIONS = ("relu", "tanh")
OUTPUTS = ("tanh", "clip")

_HEADER = ("format", "version", "sha256")


class Actor(Protocol):
    """What chooses actions; whoever runs it calls `reset` when an episode begins."""

    def reset(self) -> None:
        """Forget the last episode."""
        ...

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[Any]:
        """Return the action for the newest observation."""
        ...


class Policy:
    """A multilayer perceptron from an environment's observation to its action.

    Called with an observation as the environment returns it (scaled, stacked), it gives
    the mean action in [-1, 1], without exploration. With a memory, a GRU before one of
    its layers, each call is one step of 50 ms, and `reset` begins an episode.
    """

    def __init__(
        self,
        layers: list[Layer],
        metadata: Mapping[str, Any],
        memory: Gru | None = None,
    ) -> None:
        """Take the weights.

        Args:
            layers: The dense layers, first to last.
            metadata: Content of the JSON file.
            memory: A GRU whose input is what the layers before it give, and whose state
                is what the layer number `network.memory.before` takes.

        Raises:
            PolicyError: The weights do not fit the metadata or one another.
        """
        self.layers = layers
        self.memory = memory
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
        self._before = self._place_of_memory(network)
        width = shapes[0][0]
        if self.memory is not None and self._before == 0:
            width = self.memory.num_inputs
        self.observation_size = int(width)
        for i, (weight, bias) in enumerate(layers):
            rows = width
            if self.memory is not None and self._before == i:
                self._require_inputs(width)
                rows = self.memory.units
            if weight.shape[0] != rows or bias.shape != weight.shape[1:]:
                raise PolicyError(
                    f"policy layer {i} has weights of shape {weight.shape} and a bias "
                    f"of shape {bias.shape}; its neighbour needs {rows} rows"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PolicyError(f"policy layer {i} holds a number that is not finite")
            width = weight.shape[1]
        self.action_size = int(shapes[-1][1])

    def _place_of_memory(self, network: Mapping[str, Any]) -> int:
        """Return the number of the layer that takes the memory's state; -1 for none."""
        said = network.get("memory")
        if self.memory is None and said is None:
            return -1
        own = None if self.memory is None else self.memory.describe()
        before = said.get("before") if isinstance(said, Mapping) else None
        if not isinstance(said, Mapping) or own is None or {**said, **own} != said:
            raise PolicyError(
                f"the weights have the memory {own}, the policy's JSON file says "
                f"{str(said)[:80]}; export the policy again"
            )
        if type(before) is not int or not 0 <= before < len(self.layers):
            raise PolicyError(
                f"the policy's memory stands before layer {str(before)[:20]!r}; "
                f"allowed: 0 to {len(self.layers) - 1}"
            )
        return before

    def _require_inputs(self, width: int) -> None:
        if self.memory is not None and self.memory.num_inputs != width:
            raise PolicyError(
                f"the policy's memory takes {self.memory.num_inputs} numbers, the "
                f"layer before it gives {width}"
            )

    def reset(self) -> None:
        """Forget the last episode; call it when an episode begins."""
        if self.memory is not None:
            self.memory.reset()

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
            if self.memory is not None and i == self._before:
                x = self.memory.step(x)
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
        if self.memory is not None:
            arrays = zip(TENSORS, self.memory.weights, strict=True)
            tensors |= {f"memory.{name}": array for name, array in arrays}
        data = save(
            {
                name: np.ascontiguousarray(array, dtype=np.float32)
                for name, array in tensors.items()
            }
        )
        self.metadata = {
            "format": FORMAT,
            "version": VERSIONS[self.memory is not None],
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
            memory = None
            if "memory.bias" in tensors:
                memory = Gru(*(tensors.pop(f"memory.{name}") for name in TENSORS))
            layers = [
                (tensors[f"layer{i}.weight"], tensors[f"layer{i}.bias"])
                for i in range(len(tensors) // 2)
            ]
        except (SafetensorError, KeyError) as error:
            raise PolicyError(f"{weights} holds no policy: {error}") from error
        return cls(layers, metadata, memory)

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
        metadata = json.loads(content, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise PolicyError(
            f"{path} ({len(content)} bytes) is cut short or no JSON: {error}; copy it "
            "again"
        ) from error
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise PolicyError(
            f"{path} does not describe a policy: format is not {FORMAT!r}"
        )
    if metadata.get("version") not in VERSIONS:
        raise PolicyError(
            f"{path} has format version {metadata.get('version')!r}, this release "
            f"reads {' and '.join(map(str, VERSIONS))}"
        )
    return metadata


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _known(name: str, network: Mapping[str, Any], known: tuple[str, ...]) -> str:
    value = network.get(name)
    if value not in known:
        raise PolicyError(
            f"policy {name} {value!r} is unknown; known: {', '.join(known)}"
        )
    return value
