"""A policy's memory: one gated recurrent unit, run with NumPy alone."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import PolicyError

Weights = NDArray[np.float32]

TENSORS = ("inputs", "recurrent", "bias", "candidate_bias")
"""Names of a GRU's weights, in the order of `Gru`'s arguments."""


class Gru:
    r"""A gated recurrent unit: what an episode has shown so far, in `units` numbers.

    .. math::
        r = \sigma(W_r x + U_r h + b_r), \quad z = \sigma(W_z x + U_z h + b_z), \\
        n = \tanh(W_n x + b_n + r \odot (U_n h + c_n)), \quad
        h' = (1 - z) \odot n + z \odot h

    It is Flax's `GRUCell` and PyTorch's `GRU`, whose two biases of r and z are one sum
    here. Its state is zero at the start of an episode.

    Reference:
        Cho et al. 2014, with the reset gate after the product.
    """

    def __init__(
        self,
        inputs: Weights,
        recurrent: Weights,
        bias: Weights,
        candidate_bias: Weights,
    ) -> None:
        """Take the weights, gates in the order r, z, n.

        Args:
            inputs: W, shape (num_inputs, 3 units).
            recurrent: U, shape (units, 3 units).
            bias: b, shape (3 units,).
            candidate_bias: c of n, shape (units,).

        Raises:
            PolicyError: Shapes that do not fit, or a number that is not finite.
        """
        arrays = (inputs, recurrent, bias, candidate_bias)
        self.weights = tuple(np.asarray(array, dtype=np.float32) for array in arrays)
        shapes = [array.shape for array in self.weights]
        units = shapes[3][0] if len(shapes[3]) == 1 else 0
        rows = shapes[0][0] if len(shapes[0]) == 2 else 0
        fitting = [(rows, 3 * units), (units, 3 * units), (3 * units,), (units,)]
        if not units or not rows or shapes != fitting:
            found = ", ".join(f"{n} {s}" for n, s in zip(TENSORS, shapes, strict=True))
            raise PolicyError(
                f"the policy's GRU has weights of shapes {found}; needs (n, 3 units), "
                "(units, 3 units), (3 units,), (units,)"
            )
        for name, array in zip(TENSORS, self.weights, strict=True):
            if not np.isfinite(array).all():
                raise PolicyError(f"the policy's GRU has {name} that are not finite")
        self.num_inputs, self.units = rows, units
        self._state = np.zeros(units, dtype=np.float32)

    def reset(self) -> None:
        """Forget everything."""
        self._state = np.zeros(self.units, dtype=np.float32)

    def step(self, x: Weights) -> Weights:
        """Take one input, shape (num_inputs,); return the new state, shape (units,)."""
        inputs, recurrent, bias, candidate_bias = self.weights
        old, units = self._state, self.units
        given = x @ inputs + bias
        remembered = old @ recurrent
        gates = given[: 2 * units] + remembered[: 2 * units]
        reset, keep = np.split(0.5 * (1.0 + np.tanh(0.5 * gates)), 2)  # the logistic
        candidate = remembered[2 * units :] + candidate_bias
        candidate = np.tanh(given[2 * units :] + reset * candidate)
        self._state = ((1.0 - keep) * candidate + keep * old).astype(np.float32)
        return self._state

    def describe(self) -> dict[str, Any]:
        """Return kind and size, for a policy's JSON file."""
        return {"kind": "gru", "inputs": self.num_inputs, "units": self.units}

    @classmethod
    def from_flax(cls, params: Mapping[str, Any]) -> Self:
        """Take the parameters of a Flax `GRUCell`: ir, iz, in, hr, hz, hn."""

        def kernel(*names: str) -> Weights:
            return np.hstack([np.asarray(params[name]["kernel"]) for name in names])

        bias = np.hstack([np.asarray(params[name]["bias"]) for name in _GIVEN])
        return cls(
            kernel(*_GIVEN), kernel("hr", "hz", "hn"), bias, params["hn"]["bias"]
        )

    @classmethod
    def from_torch(cls, state: Mapping[str, Any], layer: int = 0) -> Self:
        """Take the `state_dict` of a PyTorch `GRU`, one layer of it, one direction."""

        def array(name: str) -> Weights:
            return np.asarray(state[f"{name}_l{layer}"].detach().cpu().numpy())

        given, remembered = array("bias_ih"), array("bias_hh")
        units = len(given) // 3
        bias = given.copy()
        bias[: 2 * units] += remembered[: 2 * units]
        inputs, recurrent = array("weight_ih").T, array("weight_hh").T
        return cls(inputs, recurrent, bias, remembered[2 * units :])


_GIVEN = ("ir", "iz", "in")
