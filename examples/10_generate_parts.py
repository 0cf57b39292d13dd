"""Write pairs of parts that are drawn at random, to train one policy on many.

    python examples/10_generate_parts.py pairs --count 50 --seed 0
    dovetail train --recipe insert_any --vary part=pairs --num-envs 50

Each file is a part as docs/your-own-part.md describes it.
"""

import argparse
from pathlib import Path

from dovetail import DovetailError, generate_parts


def main() -> None:
    """Draw the pairs and print their files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("pairs"))
    parser.add_argument("--count", type=int, default=50, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument("--kinds", help="drawn in turn, A,B; left out, all but pins")
    parser.add_argument("--quick", action="store_true", help="three pairs only")
    given = parser.parse_args()
    count = 3 if given.quick else given.count
    words = {"kinds": given.kinds.split(",")} if given.kinds else {}
    try:
        files = generate_parts(given.folder, count, given.seed, **words)
    except DovetailError as error:
        parser.error(str(error))
    for file in files:
        print(file)


if __name__ == "__main__":
    main()
