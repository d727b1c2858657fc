"""What keeps the pages light."""

from thesis_lib.book.offline import styles_in_use


def test_a_sheet_keeps_the_rules_whose_names_are_in_use() -> None:
    used = """@charset "UTF-8";.used%s{color:red}
#here.used:not(.gone):is(.gone,h1)::before{content:"."}h1 > p{margin:.5em}
@media print{.used{display:none}%s}%s@font-face{src:url(a.woff2)}"""
    sheet = used % (
        *(",.gone", ".gone{display:none}"),
        "@media print{.gone{margin:0}}.gone .used{color:blue}/* {} */",
    )
    assert styles_in_use(sheet, {"used", "here"}) == used % ("", "", "")
