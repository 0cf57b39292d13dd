"""Pages say what the commands of docs/figures.toml print."""

import pytest

import docs_scripts

docs_figures = docs_scripts.load("figures")
COMMANDS = docs_figures.load()
QUICK = [command for command in COMMANDS if not command.is_slow]


@pytest.mark.parametrize(
    "figure", [figure for command in COMMANDS for figure in command.figures]
)
def test_a_page_has_the_sentence_of_a_figure_once(figure):
    assert len(figure.locate().groups()) == figure.text.count("{:")


@pytest.mark.parametrize("command", QUICK, ids=lambda command: command.run[-1])
def test_a_page_says_what_its_command_prints(command):
    output = command.output()
    for figure in command.figures:
        now = figure.write(figure.read(output))
        for said, printed in zip(figure.locate().groups(), now, strict=True):
            if said == printed:
                continue
            digit = 10.0 ** -len(said.partition(".")[2])
            allowed = max(figure.within * abs(float(printed)), 1.01 * digit)
            assert abs(float(said) - float(printed)) <= allowed, figure


def test_values_are_found_formatted_and_written_into_a_page(tmp_path, monkeypatch):
    monkeypatch.setattr(docs_figures, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text("It moves by\n1.25 mm in 3 of 4 tries.\n")
    figure = docs_figures.Figure(
        find=r"moved (\S+) m, (\d+)/(\d+)",
        page="page.md",
        text="moves by {:.2f} mm in {:.0f} of {:.0f} tries",
    )
    figure.replace(figure.read("moved 2.5 m, 4/4"))
    assert page.read_text() == "It moves by\n2.50 mm in 4 of 4 tries.\n"
    largest = docs_figures.Figure(
        find=r"row (\S+) (\S+)", page="", text="{}", every=True, take="max"
    )
    assert largest.read("row 1 2\nrow 3e1 4\n") == (30.0,)
    with pytest.raises(ValueError, match="not in the output"):
        largest.read("")
