"""Takes the results of `dovetail reproduce` over into docs/experiments.md.

    python docs/measured.py FOLDER   numbers and figures go to docs/measured, the
                                     tables into the page
    python docs/measured.py          the page and the figures are of the numbers that
                                     lie in docs/measured; rc 1 if not

tests/test_docs_measured.py does the second.
"""

import hashlib
import json
import shutil
import sys
from pathlib import Path

from PIL import Image

from dovetail.reproduce.report import FIGURES, RESULTS, STAMP, in_words
from dovetail.reproduce.tables import Tabular

HERE = Path(__file__).parent
PAGE = HERE / "experiments.md"
NUMBERS = HERE / "measured"
BEGIN, END = "<!-- results.json: begin -->\n", "<!-- results.json: end -->\n"


def section(numbers: Path) -> str:
    """Return the part of the page that a results.json gives; empty without one."""
    if not (numbers / RESULTS).exists():
        return ""
    found = json.loads((numbers / RESULTS).read_text())
    tables = [Tabular(**one) for one in found["tables"]]
    parts = [in_words(found["sentences"], tables)]
    parts += [f"![{what}](measured/{name})\n" for name, what in FIGURES.items()]
    return "\n".join(parts)


def differences(page: Path = PAGE, numbers: Path = NUMBERS) -> list[str]:
    """Return what is older than the numbers: figures, or the page."""
    found = []
    if numbers.exists():
        digest = hashlib.sha256((numbers / RESULTS).read_bytes()).hexdigest()
        for name in FIGURES:
            with Image.open(numbers / name) as image:
                if image.info.get(STAMP) != digest:
                    found.append(f"{name} shows other numbers than {RESULTS}")
    before, _, rest = page.read_text().partition(BEGIN)
    inside, _, after = rest.partition(END)
    if not before or not after or inside != section(numbers):
        found.append(f"the tables in {page.name} are not those of {RESULTS}")
    return found


def take(folder: Path, page: Path = PAGE, numbers: Path = NUMBERS) -> None:
    """Copy numbers and figures, and write the tables into the page."""
    numbers.mkdir(exist_ok=True)
    for name in (RESULTS, *FIGURES):
        shutil.copyfile(folder / name, numbers / name)
    before, _, rest = page.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    page.write_text(before + BEGIN + section(numbers) + END + after)


if __name__ == "__main__":
    if sys.argv[1:]:
        take(Path(sys.argv[1]))
    sys.exit("\n".join(differences()) or None)
