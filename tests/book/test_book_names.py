"""Names of the package that prose mentions."""

from types import SimpleNamespace

import pytest
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.util.docutils import new_document

from thesis_lib.book.names import NOTATION, _link_notation, _resolve, exists


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("thesis_lib", True),
        ("thesis_lib.mdp.model", True),
        ("thesis_lib.mdp.model.TabularMDP", True),
        ("thesis_lib.edition.page.Page.run", True),
        ("thesis_lib.edition.page.Page.budget", True),  # a field without a default
        ("thesis_lib.edition.page.Page.budget.upper", False),
        ("thesis_lib.mdp.model.NoSuchThing", False),
        ("thesis_lib.no_such_module", False),
        ("numpy.array", False),
    ],
)
def test_exists(name: str, known: bool) -> None:
    assert exists(name) is known


@pytest.mark.parametrize("docname", [NOTATION, "book/other"])
def test_code_on_the_page_notation_is_linked_where_the_reference_has_it(docname: str) -> None:
    page = new_document("page")
    spans = ("mdp.learn(alpha)", "mdp.MDP.reward", "no.such", "thesis_lib", "alpha")
    page += [nodes.literal("", span) for span in spans]
    _link_notation(SimpleNamespace(env=SimpleNamespace(docname=docname)), page)
    links = list(page.findall(pending_xref))
    assert [link.astext() for link in links] == ([*spans[:2]] if docname == NOTATION else [])
    assert [code.astext() for code in page.findall(nodes.literal)] == [*spans]
    if links:
        described = SimpleNamespace(docname="book/api/mdp", node_id="learn")
        objects = {"thesis_lib.mdp.learning.learn": described}
        env = SimpleNamespace(docname=docname, domains={"py": SimpleNamespace(objects=objects)})
        builder = SimpleNamespace(get_relative_uri=lambda start, end: f"{start} to {end}")
        made = [
            _resolve(SimpleNamespace(builder=builder), env, link, link.children[0])
            for link in links
        ]
        assert made[0]["refuri"] == "book/notation to book/api/mdp#learn"
        assert made[1] is links[1].children[0]  # a field stays code
