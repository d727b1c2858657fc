"""What keeps the pages light."""

import re

from thesis_lib.book.offline import fewer_tags, named_code, styles_in_use


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


def test_a_cell_loses_the_tags_of_its_only_paragraph() -> None:
    row = """<td class="text-left"><p><span>refuted</span>\n8 of 8</p></td>
<td><p id="claim-1">One.</p>\n<p>Two, by <code class="literal">thesis</code>.</p>\n</td>
<td><p>Three.</p>\n<p>Four.</p></td><td><p>Five.</p>\n</td>"""
    assert fewer_tags(row) == (
        row.replace('<td class="text-left"><p>', '<td class="text-left">')
        .replace("8 of 8</p>", "8 of 8")
        .replace(' class="literal"', "")
        .replace("<td><p>Five.</p>\n</td>", "<td>Five.</td>")
    )
