"""The site's pages, without building it: `make docs` does that."""

import json
import re
from pathlib import Path

import pytest
from rich.console import Console

import docs_scripts
import dovetail

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
API = {path.name: path.read_text() for path in sorted((DOCS / "api").glob("*.md"))}
NAV = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")[2].partition("\n\n")[0]


def test_every_page_is_in_the_navigation_once_and_every_entry_is_a_page():
    entries = re.findall(r": (\S+\.md)$", NAV, re.M)
    pages = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    assert sorted(entries) == sorted(pages)


def test_the_reference_has_each_public_name_once():
    shown = re.findall(r"^::: dovetail\.(\w+)$", "\n".join(API.values()), re.M)
    assert sorted(shown) == sorted(set(dovetail.__all__) - {"__version__"})


@pytest.mark.parametrize("page", API)
def test_links_of_the_reference_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", API[page]):
        assert (DOCS / "api" / link).exists(), link


def test_the_notebook_is_the_tutorial():
    script = docs_scripts.load("notebook")
    assert script.NOTEBOOK.read_text() == script.notebook()


def test_a_cell_of_the_notebook_runs_what_a_block_of_the_page_does():
    script = docs_scripts.load("notebook")
    page = (
        "# Title\n\nText.\n\n```bash\ndovetail a\ndovetail b \\\n  > c\n```\n\n"
        "```text\nprinted\n```\n\n```bash\ndovetail cockpit\n```\n\n"
        "```python\nif True:\n    print(1)\n```\n"
    )
    code = [
        "".join(cell["source"])
        for cell in script.cells(page)
        if cell["cell_type"] == "code"
    ]
    assert code == ["!dovetail a\n!dovetail b \\\n  > c", "if True:\n    print(1)"]


def test_the_program_of_the_tutorial_reads_a_log(tmp_path, monkeypatch, capsys):
    config = dovetail.EvaluationConfig(
        policy="peg_square", twin="medium", tries=1, out=tmp_path / "on-medium"
    )
    dovetail.evaluate(config, Console(quiet=True))
    (program,) = re.findall(
        r"```python\n(.*?)```", (DOCS / "tutorial.md").read_text(), re.S
    )
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "tutorial.md", "exec"), {})
    assert re.fullmatch(r"\d+ cycles, peak \d+\.\d N\n", capsys.readouterr().out)


def test_the_notebook_is_a_notebook():
    content = json.loads((DOCS / "tutorial.ipynb").read_text())
    assert content["nbformat"] == 4
    assert {cell["cell_type"] for cell in content["cells"]} == {"code", "markdown"}
