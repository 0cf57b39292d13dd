"""How many tries `dovetail compare` needs, beside a fixed number and beside the floor.

Two policies of known success rates are compared many times, on simulated tries that are
independent of each other. The floor is Wald's sequential test, which knows both rates
and has the same errors: on average no test of the unequal tries needs fewer.
"""

import argparse
import math
from statistics import NormalDist

import numpy as np

from dovetail.evaluation.paired_test import Pairs, judge

RATES = ((0.80, 0.80), (0.95, 0.95), (0.95, 0.85), (0.90, 0.70), (1.00, 0.80))
POWER_MAX = 0.99
QUANTILE = NormalDist().inv_cdf
Rates = tuple[float, float]


def compare(rates: Rates, tries: int, random: np.random.Generator) -> tuple[str, int]:
    """Return the verdict of one comparison, and its tries."""
    pairs, verdict = Pairs(), "undecided"
    while verdict == "undecided":
        pairs = pairs.add(*(bool(r) for r in random.random(2) < rates))
        verdict = judge(pairs, tries)
    return verdict, pairs.tries


def fixed_number(rates: Rates, power: float, error_rate: float = 0.05) -> float:
    """Return the tries of McNemar's test for a power (Connor 1987, Biometrics 43)."""
    won, lost = rates[0] * (1 - rates[1]), rates[1] * (1 - rates[0])
    unequal, lead = won + lost, won - lost
    z_error, z_power = QUANTILE(1 - error_rate / 2), QUANTILE(power)
    spread = z_error * math.sqrt(unequal) + z_power * math.sqrt(unequal - lead**2)
    return (spread / lead) ** 2


def floor(rates: Rates, power: float, error_rate: float = 0.05) -> float:
    """Return Wald's mean number of tries of a test that knows both rates."""
    won, lost = rates[0] * (1 - rates[1]), rates[1] * (1 - rates[0])
    win = min(won / (won + lost), 1 - 1e-9)
    gain = win * math.log(2 * win) + (1 - win) * math.log(2 * (1 - win))
    error, miss = error_rate / 2, 1 - power
    end = (1 - miss) * math.log((1 - miss) / error)
    end += miss * math.log(miss / (1 - error))
    return end / gain / (won + lost)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=1000)
    parser.add_argument("--tries", type=int, default=200, help="most tries of each")
    given = parser.parse_args()
    random = np.random.default_rng(0)
    print("| success rates | found | wrong | mean tries | fixed number | floor |")
    print("|---|---|---|---|---|---|")
    for rates in RATES:
        runs = [compare(rates, given.tries, random) for _ in range(given.repeats)]
        names = [verdict for verdict, _ in runs]
        right, wrong = (names.count(n) / len(names) for n in ("first", "second"))
        mean = np.mean([tries for _, tries in runs])
        cells = "| - | - |"
        if rates[0] == rates[1]:
            right, wrong = 0.0, right + wrong
        else:
            power = min(max(right, 1 - POWER_MAX), POWER_MAX)
            cells = f"| {fixed_number(rates, power):.0f} | {floor(rates, power):.0f} |"
        said = f"{100 * rates[0]:.0f} %, {100 * rates[1]:.0f} %"
        print(
            f"| {said} | {100 * right:.1f} % | {100 * wrong:.1f} % | {mean:.0f} {cells}"
        )


if __name__ == "__main__":
    main()
