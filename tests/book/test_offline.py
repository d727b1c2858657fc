"""What keeps the pages light."""

import re
from pathlib import Path

from thesis_lib.book.offline import fewer_tags, named_code, styles_in_use
from thesis_lib.edition.ledger import Verdict

ROOT = Path(__file__).resolve().parents[2]


def test_a_sheet_keeps_the_rules_whose_names_are_in_use() -> None:
    used = """@charset "UTF-8";.used%s{color:red}
#here.used:not(.gone):is(.gone,h1)::before{content:"."}h1 > p{margin:.5em}
@media print{.used{display:none}%s}%s@font-face{src:url(a.woff2)}"""
    sheet = used % (
        *(",.gone", ".gone{display:none}"),
        "@media print{.gone{margin:0}}.gone .used{color:blue}/* {} */",
    )
    assert styles_in_use(sheet, {"used", "here"}) == used % ("", "", "")


def test_folded_code_is_named_by_the_figure_it_makes() -> None:
    fold = """<details><summary aria-label="Toggle hidden content">
<p class="collapsed admonition-title">Show code cell source</p>
<p class="expanded admonition-title">Hide code cell source</p>
</summary><pre>plot()</pre></details>"""
    figure = '<figcaption><span class="caption-number">Fig. 3.1 </span></figcaption>'
    alone = '<div class="cell docutils">'  # a cell in sight makes the second figure
    page = named_code(fold + fold + figure + fold + alone + figure)
    assert re.findall("(?<=>)(?:Show|Hide)[^<]*", page) == [
        *("Show the code", "Hide the code"),
        *("Show the code of Fig. 3.1", "Hide the code of Fig. 3.1"),
        *("Show the code", "Hide the code"),
    ]
    own = fold.replace("code cell source", "the imports")
    assert re.findall("(?<=>)(?:Show|Hide)[^<]*", named_code(own + fold + figure)) == [
        *("Show the imports", "Hide the imports"),
        *("Show the code of Fig. 3.1", "Hide the code of Fig. 3.1"),
    ]
    assert "aria-label" not in page + named_code(own)  # which would be read instead


def test_a_table_of_the_ledger_loses_what_html_leaves_out() -> None:
    row = """<tr>
<td class="text-left"><p><span class="verdict not-run">not run</span>\n8 of 8</p></td>
<td><p id="claim-1">One.</p>\n<details><summary>Evidence</summary><p>By
<code class="literal">thesis</code>.</p>\n<p>Two, <a href="a.html#b">b</a>.</p>\n</details></td>
<td><p>Three.</p>\n<p>Four.</p></td>\n</tr>\n<tr><td><p>Five.</p>\n</td>
<td><span class="verdict refuted" title="a b">refuted</span></td>\n</tr>\n"""
    assert fewer_tags(row) == (
        "<tr>\n<td class=text-left><span class=verdict>not run</span>\n8 of 8"
        "<td><p id=claim-1>One.<details><summary>Evidence</summary><p>By\n"
        "<code>thesis</code>.<p>Two, <a href=a.html#b>b</a>.</details>"
        "<td><p>Three.<p>Four.<tr><td>Five."
        '<td><span class="verdict refuted" title="a b">refuted</span>'
    )


def test_verdicts_keep_the_classes_that_colour_them() -> None:
    sheet = (ROOT / "book" / "_static" / "book.css").read_text(encoding="utf-8")
    coloured = re.findall(r"\.([\w-]+) \{ --verdict", sheet)
    assert coloured == [v.slug for v in Verdict if v.slug in coloured]
    for verdict in Verdict:
        mark = f'<span class="verdict {verdict.slug}">{verdict}</span>'
        assert (fewer_tags(mark) == mark) == (verdict.slug in coloured)
