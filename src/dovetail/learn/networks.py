"""SAC's networks as SBX has them, in a form that costs a CPU less time.

The numbers are of the same distribution; what differs is how they are made. JAX
compiles a program for the drawing of every layer, seconds before the first step, so
that NumPy draws them here. And SBX computes its critics as one with an axis more, whose
products are slower than those of one critic after the other.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import flax.linen as nn
import jax  # noqa: TID253
import jax.numpy as jnp  # noqa: TID253
import numpy as np
from numpy.typing import NDArray
from sbx.common.policies import (  # noqa: TID253
    ContinuousCritic,
    SquashedGaussianActor,
)

_FARTHEST = 2.0
"""Cut-off of the normal distribution of a weight [standard deviations]."""
_SPREAD = 0.87962566
"""Standard deviation of what is left of a standard normal one [1]."""


class SbxActor(SquashedGaussianActor):
    """SBX's actor, drawn without a compilation."""

    num_seen: int | None = None
    """Number of leading entries of an observation that it uses; None is all."""

    def __call__(self, observation: jax.Array) -> Any:
        """Return the distribution of actions."""
        return super().__call__(observation[..., : self.num_seen])

    def init(self, rngs: Any, *inputs: Any, **options: Any) -> Any:
        """Return the parameters; see `draw`."""
        return draw(partial(super().init, **options), rngs, *inputs)


class Critics(nn.Module):
    """SBX's critics, one after the other; drawn without a compilation."""

    net_arch: Sequence[int]
    use_layer_norm: bool = False
    dropout_rate: float | None = None
    n_critics: int = 2
    activation_fn: Callable[[jax.Array], jax.Array] = nn.relu

    def init(self, rngs: Any, *inputs: Any, **options: Any) -> Any:
        """Return the parameters; see `draw`."""
        return draw(partial(super().init, **options), rngs, *inputs)

    @nn.compact
    def __call__(self, observation: jax.Array, action: jax.Array) -> jax.Array:
        """Return what each critic says, shape (critics, batch, 1)."""
        critic = partial(
            ContinuousCritic,
            net_arch=self.net_arch,
            use_layer_norm=self.use_layer_norm,
            dropout_rate=self.dropout_rate,
            activation_fn=self.activation_fn,
        )
        values = [critic()(observation, action) for _ in range(self.n_critics)]
        return jnp.stack(values)


def draw(init: Callable[..., Any], rngs: Any, *inputs: Any) -> Any:
    """Return parameters of a module's shapes, drawn as flax draws them by default.

    Kernels are LeCun's: normal, cut off, of variance 1 / inputs. Scales are 1,
    biases 0.

    Args:
        init: The module's own.
        rngs: Key of JAX, or keys by name; "params" decides the numbers.
        *inputs: Of the module.

    Reference:
        LeCun et al. 1998, Efficient BackProp, section 4.6.
    """
    shapes = jax.eval_shape(init, rngs, *inputs)
    key = rngs["params"] if isinstance(rngs, Mapping) else rngs
    rng = np.random.default_rng(np.asarray(key))

    def value(path: Any, leaf: Any) -> jax.Array:
        name = path[-1].key
        if name == "kernel":
            spread = 1.0 / (_SPREAD * np.sqrt(leaf.shape[0]))
            return jnp.asarray(spread * _cut_normal(rng, leaf.shape), leaf.dtype)
        return jnp.asarray(np.full(leaf.shape, float(name == "scale")), leaf.dtype)

    return jax.tree_util.tree_map_with_path(value, shapes)


def _cut_normal(
    rng: np.random.Generator, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Draw standard normal numbers, again where one is too far out."""
    drawn = rng.standard_normal(shape)
    while (far := np.abs(drawn) > _FARTHEST).any():
        drawn[far] = rng.standard_normal(np.count_nonzero(far))
    return drawn
