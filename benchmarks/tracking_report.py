"""Tables of `tracking.py`: every number, and where ours is not the better one."""

import math

AXES = ("X", "Y", "Z", "C", "B", "A")
UNITS = {
    "rise": ("rise time, 10 to 90 %", "ms", 1e3, 1e3),
    "overshoot": ("overshoot", "%", 1e2, 1e2),
    "steady": ("error 1.2 to 1.5 s after the step", "mm, mrad", 1e3, 1e3),
    "cross_linear": ("others move during the step", "mm", 1e3, 1e3),
    "cross_angular": ("others turn during the step", "mrad", 1e3, 1e3),
    "circle_rms": ("circle, RMS error", "mm, mrad", 1e3, 1e3),
    "circle_max": ("circle, largest error", "mm, mrad", 1e3, 1e3),
    "held": ("held for 10 s, largest error", "mm, mrad", 1e3, 1e3),
    "drift": ("held, after 10 s", "mm, mrad", 1e3, 1e3),
}
"""Words and unit of each metric, and the factors of linear axes and rotations."""

EQUAL_SHARE = 0.05
EQUAL_SIZE = {"rise": 5.0, "overshoot": 0.5}
"""Two numbers are equal within a share, or within a size [ms, %; else mm, mrad]."""
EQUAL_LENGTH = 0.05


def in_units(metric: str, values: list[float]) -> list[float]:
    """Return the six numbers in the table's units."""
    _, _, linear, angular = UNITS[metric]
    return [v * (linear if i < 3 else angular) for i, v in enumerate(values)]


def print_table(title: str, row: dict[str, dict]) -> None:
    """Print every metric of every law on one plant."""
    width = max(len(name) for name in row)
    print(f"\n{title:{width + 4}}" + "".join(f"{axis:>9}" for axis in AXES))
    for metric, (words, unit, _, _) in UNITS.items():
        print(f"  {words} [{unit}]")
        for name, found in row.items():
            if "diverged" in found:
                print(f"    {name:{width}}  diverged: {found['diverged'][:60]}")
                continue
            numbers = "".join(f"{v:9.3g}" for v in in_units(metric, found[metric]))
            print(f"    {name:{width}}{numbers}", flush=True)


def is_worse(metric: str, mine: float, other: float) -> bool:
    """Return whether a number is neither better nor equal, in the table's units."""
    size = EQUAL_SIZE.get(metric, EQUAL_LENGTH)
    return mine > other * (1.0 + EQUAL_SHARE) and mine > other + size


def compare(mine: dict, other: dict) -> tuple[int, int, list[str]]:
    """Return how many numbers are better or equal, how many there are, and the rest.

    Who does not arrive (no rise time) cannot overshoot: that is not counted for it.
    """
    worse, count = [], 0
    for metric in UNITS:
        a, b = in_units(metric, mine[metric]), in_units(metric, other[metric])
        for i, axis in enumerate(AXES):
            if metric == "overshoot" and math.isinf(other["rise"][i]):
                continue
            count += 1
            if is_worse(metric, a[i], b[i]):
                worse.append(f"{metric} {axis} {a[i]:.3g} > {b[i]:.3g}")
    return count - len(worse), count, worse


def print_exceptions(results: dict[str, dict]) -> None:
    """Say how often each of our laws is better or equal, and list where it is not."""
    for plant, row in results.items():
        peers = [name for name in row if name.startswith("robosuite")]
        for name, peer in ((n, p) for n in row if n not in peers for p in peers):
            if "diverged" in row[peer] or "diverged" in row[name]:
                print(f"{plant}: {name} beside {peer}: one of them diverged")
                continue
            good, count, worse = compare(row[name], row[peer])
            print(f"{plant}: {name} beside {peer}: {good} of {count} better or equal")
            print("".join(f"    {line}\n" for line in worse), end="")


def print_markdown(results: dict[str, dict]) -> None:
    """Print one table per metric: rows are plants, columns axes, in a cell each law."""
    for metric, (words, unit, _, _) in UNITS.items():
        print(f"\n| {words} [{unit}] | " + " | ".join(AXES) + " |")
        print("|---" * 7 + "|")
        for plant, row in results.items():
            cells = [["diverged"] * 6 for _ in row]
            for cell, found in zip(cells, row.values(), strict=True):
                if "diverged" not in found:
                    cell[:] = [short(v) for v in in_units(metric, found[metric])]
            joined = (" / ".join(cell) for cell in zip(*cells, strict=True))
            print(f"| {plant} | " + " | ".join(joined) + " |")
    print("\nin each cell: " + " / ".join(next(iter(results.values()))))
    print_exceptions(results)


def short(value: float) -> str:
    """Return two digits, in words where the goal was never reached."""
    if math.isinf(value):
        return "never"
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}".removesuffix(".0")
