"""Tables and pictures keep what they say in every form."""

import csv
import io
import re

import kiwisolver
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from pipeline.report.figures.tabletop import capsule
from pipeline.report.results import Results
from pipeline.report.style import INK, LETTER, _terse, inline, pdf, svg
from pipeline.report.table import Cell, table, to_csv, to_html, to_markdown, to_tex
from pipeline.report.tables import all_tables
from pipeline.report.wording import listed, percent, percent_spread, points, signed

TINY = table("tiny", "50 % & more", ["User", "Rate"], [["a_b", Cell("0.30", bold=True)], ["<c>", "–"]])


def test_bold_survives_every_form():
    assert "*0.30*" in to_csv(TINY)
    assert "**0.30**" in to_markdown(TINY)
    assert r"\textbf{0.30}" in to_tex(TINY)
    assert "<strong>0.30</strong>" in to_html(TINY)


def test_what_a_form_reads_as_code_is_escaped():
    assert r"50 \% \& more" in to_tex(TINY) and r"a\_b" in to_tex(TINY)
    assert "&lt;c&gt;" in to_html(TINY) and "<c>" not in to_html(TINY)


def test_latex_is_balanced_and_ruled_by_booktabs(results: Results):
    for t in all_tables(results):
        tex = re.sub(r"\\[{}\\]", "", to_tex(t))
        assert tex.count("{") == tex.count("}") and tex.count(r"\begin") == tex.count(r"\end")
        assert re.findall(r"\\\w+rule", tex) == [r"\toprule", r"\midrule", r"\bottomrule"]


@given(st.text("\\{}$~^_#%& a[", min_size=1))
def test_latex_reads_no_letter_as_code(text: str):
    tex = to_tex(table("t", text, ["a"], [[text]]))
    caption = re.search(r"\\caption\{(.*)\}\n", tex)[1]  # pyright: ignore[reportOptionalSubscript]
    commands = r"\\textbackslash\{\}|\\textasciitilde\{\}|\\\^\{\}|\\[{}$_#%&]|\{\[\}"
    assert set(re.sub(commands, "", caption)) <= {" ", "a"}
    assert len(re.findall(commands, caption)) == len(text) - text.count(" ") - text.count("a")


def test_latex_breaks_lines_only_where_a_table_is_too_wide():
    words = "ten words of which a narrow column must hold some"
    narrow, wide = to_tex(table("t", "c", ["a"], [[words]])), to_tex(table("t", "c", list("abcd"), [[words] * 4]))
    assert words in narrow and words not in wide
    assert r"\begin{tabular}[t]{@{}l@{}}ten words" in wide


def test_latex_breaks_a_line_of_signs_before_one_of_as_many_letters():
    letters, signs = (" ".join([word] * 39) for word in ("11", "+1"))  # 116 letters each
    assert letters in to_tex(table("t", "c", ["a"], [[letters]]))
    assert signs not in to_tex(table("t", "c", ["a"], [[signs]]))


def test_a_table_without_rows_or_with_ragged_ones_is_refused():
    with pytest.raises(ValueError, match="has no rows"):
        table("t", "c", ["a"], [])
    with pytest.raises(ValueError, match="2 cells under 1 headings"):
        table("t", "c", ["a"], [["1", "2"]])


def test_csv_reads_back_with_every_row(results: Results):
    for t in all_tables(results):
        read = list(csv.reader(io.StringIO(to_csv(t))))
        assert len(read) == 1 + len(t.rows) and {len(row) for row in read} == {len(t.header)}


def test_only_the_verdict_effect_is_bold(results: Results):
    for t in all_tables(results):
        bold = {cell.text for row in t.rows for cell in row if cell.bold}
        if t.name != "interventions":
            assert bold <= {"effect"}


def test_every_table_states_how_many_seeds_it_rests_on(results: Results):
    for t in all_tables(results):
        if t.name not in ("world", "calibration", "intervention_detail", "specifications", "refuters"):
            seeds = "1 validation seed" if t.name == "ablation" else "2 seeds"
            assert seeds in t.caption, t.name


def drawing() -> Figure:
    figure = Figure((2, 1))
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=INK, clip_on=True)
    return figure


def test_a_figure_has_the_same_bytes_twice_and_no_date():
    assert svg(drawing) == svg(drawing) and pdf(drawing) == pdf(drawing)
    assert "<dc:date>" not in svg(drawing) and b"Date" not in pdf(drawing)


def test_a_figure_has_the_same_bytes_wherever_its_layout_lies_in_memory(monkeypatch: pytest.MonkeyPatch):
    def three() -> Figure:
        figure = Figure((3, 5), layout="constrained")
        figure.get_layout_engine().set(rect=(0, 0.1, 1, 0.9))  # pyright: ignore
        for axes in figure.subplots(3):
            axes.plot([0, 1], [0, 1])
            axes.set_xlabel("x")
        return figure

    variable, rng, written = kiwisolver.Variable, np.random.default_rng(0), set()
    for _ in range(20):
        scattered = [variable() for _ in range(600)]
        rng.shuffle(scattered)  # pyright: ignore
        monkeypatch.setattr(kiwisolver, "Variable", lambda _name, left=scattered: left.pop())
        written |= {svg(three)}
    assert len(written) == 1


def test_an_inlined_figure_follows_the_page_and_keeps_its_ids_apart():
    one, two = inline(svg(drawing), "one"), inline(svg(drawing), "two")
    assert INK not in one and "var(--ink)" in one
    ids = [{name for name in re.findall(r'id="([^"]+)"', text) if not name.startswith(LETTER)} for text in (one, two)]
    assert ids[0] and not ids[0] & ids[1]
    assert set(re.findall(r"url\(#([^)]+)", one)) <= ids[0]


@given(st.lists(st.floats(-1000, 1000), min_size=2, max_size=8))
def test_places_in_a_figure_are_right_to_a_hundredth_of_a_point(places: list[float]):
    long = " \nL ".join(f"{place:.6f} {place:.6f}" for place in places)
    short = re.findall(r"-?[\d.]+", _terse(long))
    np.testing.assert_allclose(np.array(short, float), np.repeat(places, 2), atol=0.00501)


def test_numbers_are_written_as_the_paper_writes_them():
    assert percent_spread({"mean": 0.99, "q1": 0.978, "q3": 0.998}) == "99.0\u00a0% [97.8–99.8]"
    assert percent(None) == percent(float("nan")) == "–"
    assert signed(-0.0004) == "0.000" and signed(-0.1, 1) == "−0.1" and signed(0.1, 1) == "+0.1"
    assert points(-0.01) == "1.0 percentage point" and points(0.123) == "12.3 percentage points"


@given(st.lists(st.text("abc", min_size=1), max_size=5))
def test_a_list_names_each_thing_once(words: list[str]):
    text = listed(words)
    assert text == "none" if not words else text.replace(" and ", ", ").split(", ") == words


@given(st.floats(0.01, 0.1), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_capsules_outline_keeps_its_distance(radius: float, x: float, y: float):
    from pipeline.table.layout import point_segment_distance

    ends = np.array([[0.0, 0.0], [x, y]])
    distance = point_segment_distance(capsule(ends, radius), ends[0], ends[1])
    np.testing.assert_allclose(distance, radius, atol=1e-9)


@pytest.mark.parametrize(("rows", "letters"), [(59, "footnotesize"), (61, "scriptsize")])
def test_a_table_too_long_for_a_page_has_smaller_letters(rows: int, letters: str):
    written = to_tex(table("long", "Long.", ["Row", "Value"], [[str(i), "1"] for i in range(rows)]))
    assert re.findall(r"\\(\w+size)", written) == [letters]
