"""Lists the slow tests: those that `make test-fast` leaves out.

`python tests/list_slow.py durations.xml > tests/slow.txt`, where the file is what
`ARGS=--junitxml=durations.xml make test-python` wrote on an idle machine.
"""

import sys
import xml.etree.ElementTree as ET
from collections import defaultdict

SLOW = 0.05
"""Mean time of a function's tests from which they are slow [s]."""


def slow_functions(report: str) -> list[str]:
    """Return the slow test functions of a JUnit report, as tests.room.module::name.

    A module whose functions are all slow is named alone.
    """
    times = defaultdict(list)
    for case in ET.parse(report).iter("testcase"):
        name = case.attrib["name"].partition("[")[0]
        times[f"{case.attrib['classname']}::{name}"].append(float(case.attrib["time"]))
    slow = {n for n, taken in times.items() if sum(taken) / len(taken) > SLOW}
    modules = {n.partition("::")[0] for n in times}
    mixed = {n.partition("::")[0] for n in times.keys() - slow}
    return sorted(modules - mixed | {n for n in slow if n.partition("::")[0] in mixed})


if __name__ == "__main__":
    sys.stdout.write("\n".join(slow_functions(sys.argv[1])) + "\n")
