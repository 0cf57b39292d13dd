"""Tables of `tracking.py`: every number, and where ours is not the better one."""

AXES = ("X", "Y", "Z", "C", "B", "A")
UNITS = {
    "rise": ("rise time, 10 to 90 %", "ms", 1e3, 1e3),
    "overshoot": ("overshoot", "%", 1e2, 1e2),
    "steady": ("error 1.2 to 1.5 s after the step", "mm, mrad", 1e3, 1e3),
    "cross_linear": ("others move during the step", "mm", 1e3, 1e3),
    "cross_angular": ("others turn during the step", "mrad", 1e3, 1e3),
    "circle_rms": ("circle, RMS error", "mm, mrad", 1e3, 1e3),
    "circle_max": ("circle, largest error", "mm, mrad", 1e3, 1e3),
    "drift": ("held for 10 s, largest error", "mm, mrad", 1e3, 1e3),
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
    print(f"\n{title}")
    width = max(len(name) for name in row)
    for metric, (words, unit, _, _) in UNITS.items():
        print(f"  {words} [{unit}]" + " " * 4 + "  ".join(AXES))
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


def print_exceptions(results: dict[str, dict]) -> None:
    """Say how often each of our laws is better or equal, and list where it is not."""
    for plant, row in results.items():
        ours = [n for n in row if n.startswith("ours")]
        for name, peer in ((m, p) for m in ours for p in row if p not in ours):
            if "diverged" in row[peer] or "diverged" in row[name]:
                print(f"{plant}: {name} beside {peer}: one of them diverged")
                continue
            worse, count = [], 0
            for metric in UNITS:
                mine = in_units(metric, row[name][metric])
                other = in_units(metric, row[peer][metric])
                for axis, a, b in zip(AXES, mine, other, strict=True):
                    count += 1
                    if is_worse(metric, a, b):
                        worse.append(f"{metric} {axis} {a:.3g} > {b:.3g}")
            said = "; ".join(worse) or "none worse"
            print(
                f"{plant}: {name} beside {peer}: {count - len(worse)}/{count}: {said}"
            )
