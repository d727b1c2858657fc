const here = document.currentScript.src;

// The copy buttons that Sphinx adds have a tooltip but no name that a screen reader could read.
window.addEventListener("load", () => {
  for (const button of document.querySelectorAll("button.copybtn")) {
    button.setAttribute("aria-label", button.dataset.tooltip);
  }
});

window.addEventListener("DOMContentLoaded", () => {
  // What unfolds the pages below another has no name either.
  for (const fold of document.querySelectorAll(".bd-sidebar-primary summary")) {
    const page = fold.closest("li").querySelector("a").textContent.trim();
    fold.setAttribute("aria-label", `Pages of ${page}`);
  }
  // The search field's text has its keys, which its label leaves out.
  document.querySelectorAll(".search-button-field").forEach((e) => e.removeAttribute("aria-label"));
  // The bibliography is no list by its children's roles.
  document.querySelectorAll(".citation-list[role=list]").forEach((e) => e.removeAttribute("role"));
  // A figure opens in its own size, so that its small print can be read on a phone.
  for (const picture of document.querySelectorAll("article img")) {
    if (picture.closest("a")) continue;
    const link = document.createElement("a");
    link.href = picture.src;
    link.setAttribute("aria-label", `Enlarge: ${picture.alt}`);
    picture.replaceWith(link);
    link.append(picture);
  }
});

// A line does not end between a formula and the bracket before it or the comma after it.
window.addEventListener("DOMContentLoaded", () => {
  for (const formula of document.querySelectorAll("article span.math")) {
    const before = formula.previousSibling?.nodeValue?.match(/[([“‘]+$/)?.[0] ?? "";
    const after = formula.nextSibling?.nodeValue?.match(/^[.,:;!?)\]”’]+/)?.[0] ?? "";
    if (!before && !after) continue;
    const { previousSibling, nextSibling } = formula;
    const whole = document.createElement("span");
    whole.className = "unbroken";
    formula.replaceWith(whole);
    whole.append(before, formula, after);
    if (before) previousSibling.nodeValue = previousSibling.nodeValue.slice(0, -before.length);
    if (after) nextSibling.nodeValue = nextSibling.nodeValue.slice(after.length);
  }
});

// Formulas, code and fields of the reference are tab stops only where they are too wide, so that
// keys can move them.
window.addEventListener("load", async () => {
  await window.MathJax?.startup?.promise;
  const reach = () => {
    // Not those in a line: the hidden copy for screen readers makes each look too wide.
    const wides = "div.math mjx-container, article pre, dl.py dl.field-list > dd";
    for (const wide of document.querySelectorAll(wides)) {
      if (wide.scrollWidth > wide.clientWidth) wide.tabIndex = 0;
      else wide.removeAttribute("tabindex");
    }
  };
  reach();
  window.addEventListener("resize", reach);
});

// The list of a page's sections marks the one that is read.  The theme marks the heading that came
// into sight last, which is another after scrolling up or a leap.
window.addEventListener("DOMContentLoaded", () => {
  const list = document.querySelector("#pst-page-toc-nav");
  const entries = [...(list?.querySelectorAll("a[href^='#']") ?? [])]
    .map((link) => [link, document.getElementById(decodeURIComponent(link.hash.slice(1)))])
    .filter(([, section]) => section);
  if (!entries.length) return;
  let asked = false;
  // At the end of a page, where short sections can't come to the top, one that was chosen counts.
  const chosen = () => {
    const ended = scrollY + innerHeight > document.documentElement.scrollHeight - 2;
    return ended && entries.find(([link, section]) => link.hash === location.hash
      && section.getBoundingClientRect().top > 0);
  };
  const mark = () => {
    asked = false;
    const reached = ([, section]) => section.getBoundingClientRect().top < 0.3 * innerHeight;
    const here = (chosen() || entries.filter(reached).pop() || entries[0])[0];
    for (const [link] of entries) {
      link.classList.toggle("active", link === here);
      if (link === here) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }
    for (const entry of list.querySelectorAll(".toc-entry")) {
      entry.classList.toggle("active", entry.contains(here));
    }
  };
  const ask = () => {
    if (!asked) requestAnimationFrame(mark);
    asked = true;
  };
  window.addEventListener("scroll", ask, { passive: true });
  window.addEventListener("hashchange", ask);
});

// Excerpts that a search finds have no room for long formulas, and none for TeX.
window.addEventListener("DOMContentLoaded", () => {
  if (typeof Search === "undefined") return;
  const plain = Search.htmlToText;
  const told = (formula) => {
    const bare = formula.replace(/<[^>]*>|\\[()[\]]|[\\{}]/g, "");
    return bare.length > 12 ? " … " : bare;
  };
  Search.htmlToText = (page, anchor) =>
    plain(page.replace(/<(span|div) class="math[\s\S]*?<\/\1>/g, told), anchor);
});

// Tables of the ledger can be filtered; without this script they are plain tables.
function filterLedger(table) {
  const rows = [...table.tBodies[0].rows];
  const cell = (row, name) => row.cells[heads.indexOf(name)]?.innerText.trim() ?? "";
  const heads = [...table.tHead.rows[0].cells].map((head) => head.innerText.trim().toLowerCase());
  // The thesis's place, such as 3.4.1, Table 3.1 or Appendix A, fact 1.
  const chapterOf = (row) => (cell(row, "where").match(/[A-C](?=[.,]|$)|\d+/) ?? [""])[0];
  const verdictOf = (row) => row.querySelector(".verdict")?.textContent ?? "";
  const form = document.createElement("form");
  form.className = "ledger-filter";
  form.setAttribute("aria-label", "Filter the table");
  const choices = (label, values) => {
    const select = document.createElement("select");
    select.setAttribute("aria-label", label);
    select.append(new Option(`${label}: all`, ""), ...values.map((v) => new Option(v, v)));
    form.append(select);
    return select;
  };
  const distinct = (of) => [...new Set(rows.map(of))].filter(Boolean);
  const chapter = choices("Chapter", distinct(chapterOf));
  const verdict = distinct(verdictOf).length ? choices("Verdict", distinct(verdictOf)) : null;
  let headline = null;
  if (rows.some((row) => row.querySelector(".mark")?.textContent === "headline")) {
    const label = document.createElement("label");
    headline = document.createElement("input");
    headline.type = "checkbox";
    // All claims are thirty screens of a phone.
    headline.checked = window.matchMedia("(max-width: 600px)").matches;
    label.append(headline, " headlines only");
    form.append(label);
  }
  const text = document.createElement("input");
  text.type = "search";
  text.placeholder = "Words";
  text.setAttribute("aria-label", "Words in the row");
  const count = document.createElement("output");
  form.append(text, count);
  const apply = () => {
    const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of rows) {
      const content = row.textContent.toLowerCase();
      row.hidden = !(
        (!chapter.value || chapterOf(row) === chapter.value) &&
        (!verdict?.value || verdictOf(row) === verdict.value) &&
        (!headline?.checked || /headline/.test(cell(row, "where"))) &&
        words.every((word) => content.includes(word))
      );
      shown += !row.hidden;
    }
    count.textContent = `${shown} of ${rows.length}`;
  };
  // A link to a row that is left out, or in a list that is folded, shows it.
  const arrive = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const folded = target?.closest("details:not([open])");
    if (folded) folded.open = true;
    else if (target?.closest("tr")?.hidden) {
      form.reset();
      apply();
    } else return;
    target.scrollIntoView();
  };
  form.addEventListener("input", apply);
  form.addEventListener("submit", (event) => event.preventDefault());
  window.addEventListener("hashchange", arrive);
  (table.closest(".pst-scrollable-table-container") ?? table).before(form);
  apply();
  arrive();
}

// The film of the front page moves by itself, unless its reader asked for stillness.
window.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("table.ledger").forEach(filterLedger);
  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  for (const video of document.querySelectorAll("figure.moving video")) {
    if (!still) video.play().catch(() => {});
  }
});

// A chart's picture gives way to the chart itself, whose script only pages with charts load.
function moveCharts() {
  for (const place of document.querySelectorAll("div.chart")) {
    const spec = JSON.parse(place.querySelector("script[type='application/json']").textContent);
    const picture = place.querySelector("img");
    const target = document.createElement("div");
    target.className = "moving-chart";
    place.append(target);
    window.vegaEmbed(target, spec, { actions: false, renderer: "svg" }).then(() => {
      // Vega measures its container when the window changes; a column may change by itself.
      const widened = new ResizeObserver(() => window.dispatchEvent(new Event("resize")));
      widened.observe(target.parentElement);
      const drawn = target.querySelector("svg");
      drawn.setAttribute("role", "img");
      drawn.setAttribute("aria-label", picture.alt);
      (picture.closest("p") ?? picture).hidden = true;
    });
  }
}

window.addEventListener("DOMContentLoaded", () => {
  if (!document.querySelector("div.chart")) return;
  const script = document.createElement("script");
  script.src = new URL("charts.js", here);
  script.addEventListener("load", moveCharts);
  document.head.append(script);
});
