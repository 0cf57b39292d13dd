r"""Values that are plausible before any log: a Gaussian about the controller's model.

A log leaves directions open in which parameters trade places. Without a prior they end
anywhere, with masses that no arm has. The best values are those of the highest
posterior density. The size of the error is not known beforehand either; with Jeffreys'
prior for it they minimise

.. math::
    e(\theta) \exp\Big(\frac{1}{2 n} \sum_i
    \frac{(\theta_i - \theta_{i,0})^2}{\sigma_i^2}\Big)

with n independent facts in the log. The finer the model meets the log, the less the
prior counts; a parameter that moves the tool is not pulled visibly.
"""

import numpy as np

from dovetail.identify.excitation import FREQUENCIES
from dovetail.identify.parameters import ParameterSet
from dovetail.types import Array

FACTS_PER_SEQUENCE = 3 * 2 * len(FREQUENCIES)
"""Independent facts in a sequence: sine and cosine of each of an axis' sines, for the
three axes of the position. Its thousands of samples hang together."""


class Prior:
    """The prior of some parameters, as a factor on the error."""

    def __init__(self, parameters: ParameterSet, sequences: int) -> None:
        """Take start and spread of each parameter, and the facts in the log."""
        self.parameters = parameters
        self.facts = FACTS_PER_SEQUENCE * sequences

    def factor(self, vector: Array) -> float:
        """Return what the error of a vector of all parameters is multiplied by."""
        from_centre = np.asarray(vector) - self.parameters.start
        distance = from_centre / self.parameters.spread
        return float(np.exp(distance @ distance / (2.0 * self.facts)))
