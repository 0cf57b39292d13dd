"""Linear-Gaussian models about points, fitted to the nearest of all transitions.

Locally weighted regression, with the fit to all transitions as its prior: contact makes
the dynamics differ from place to place, and few samples lie at each.

Reference:
    Atkeson, Moore, Schaal 1997, Locally weighted learning.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]

PRIOR = 1.0
"""Samples nearby that the prior counts for [1]."""
RIDGE = 1e-6
"""Share of each input's own spread by which the fit to all is kept regular [1]."""


class Linear(NamedTuple):
    """Linear-Gaussian models: y ~ N(slope (x - at) + value, covariance)."""

    slope: Floats
    """Shape (points, outputs, inputs)."""
    value: Floats
    """Mean at the point, shape (points, outputs)."""
    covariance: Floats
    """Of what the model does not explain, shape (points, outputs, outputs)."""


def neighbour_weights(features: Floats, at: Floats, count: int) -> Floats:
    """Return how much each sample counts at each point: a Gaussian of the distance.

    Its width at a point is the distance of the neighbour number `count`.

    Args:
        features: Of the samples, scaled alike, shape (samples, features).
        at: The same of the points, shape (points, features).
        count: Neighbours that count.

    Returns:
        Weights from 0 to 1, shape (points, samples).
    """
    squares = (at**2).sum(1)[:, None] + (features**2).sum(1) - 2.0 * at @ features.T
    squares = np.maximum(squares, 0.0)
    last = min(count, len(features)) - 1
    width = np.partition(squares, last, axis=1)[:, last]
    return np.exp(-2.0 * squares / np.maximum(width, 1e-9)[:, None])


def fit(inputs: Floats, outputs: Floats, at: Floats, weights: Floats) -> Linear:
    """Fit a linear model about each point.

    Args:
        inputs: Of the samples, shape (samples, inputs).
        outputs: Of the samples, shape (samples, outputs).
        at: The points, shape (points, inputs).
        weights: Of the samples at each point, shape (points, samples).
    """
    mean, spread = inputs.mean(0), np.maximum(inputs.std(0), 1e-9)
    x = np.column_stack([(inputs - mean) / spread, np.ones(len(inputs))])
    p = np.column_stack([(at - mean) / spread, np.ones(len(at))])
    moment = x.T @ x / len(x) + RIDGE * np.eye(x.shape[1])
    prior = np.linalg.solve(moment, x.T @ outputs / len(x))  # (inputs + 1, outputs)
    rest = outputs - x @ prior
    pairs = (x[:, :, None] * x[:, None, :]).reshape(len(x), -1)
    size = x.shape[1]
    measured = (weights @ pairs).reshape(-1, size, size)
    total = weights.sum(1)[:, None]
    middle = weights @ x[:, :-1] / total
    near = np.diagonal(measured, axis1=1, axis2=2)[:, :-1] / total - middle**2
    # The prior is as strong as `PRIOR` samples that lie as far apart as those nearby.
    strength = np.zeros_like(measured)
    inner = np.arange(size - 1)
    strength[:, inner, inner] = PRIOR * np.maximum(near, RIDGE)
    left = measured + strength
    crossed = (x[:, :, None] * rest[:, None, :]).reshape(len(x), -1)
    right = (weights @ crossed).reshape(-1, size, outputs.shape[1])
    own = np.linalg.solve(left, right)  # (points, inputs + 1, outputs)
    coefficients = prior + own
    value = np.einsum("pi,pio->po", p, coefficients)
    # Weighted squares of what the local fit leaves: those of the prior's residuals,
    # less what the local part explains.
    squares = (rest[:, :, None] * rest[:, None, :]).reshape(len(x), -1)
    many = outputs.shape[1]
    local = (weights @ squares).reshape(-1, many, many)
    cross = np.einsum("pio,piq->poq", own, right)
    explained = np.einsum("pio,pij,pjq->poq", own, measured, own)
    local += explained - cross - cross.transpose(0, 2, 1)
    local += PRIOR * rest.T @ rest / len(x)
    covariance = local / (total[..., None] + PRIOR)
    slope = coefficients[:, :-1].transpose(0, 2, 1) / spread
    return Linear(slope, value, covariance)
