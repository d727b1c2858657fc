// What a page of the book needs before it is printed; thesis_lib/book/pdf.py calls it.

// Everything is open and loaded.
async function ready() {
  const folded = "details.sd-dropdown, table details";
  document.querySelectorAll(folded).forEach((e) => { e.open = true; });
  document.querySelectorAll("img[loading=lazy]").forEach((e) => { e.loading = "eager"; });
  const loaded = (e) => e.complete || new Promise((done) => { e.onload = e.onerror = done; });
  await Promise.all([...document.images].map(loaded));
  if (window.MathJax?.startup?.promise) await window.MathJax.startup.promise;
  await Promise.all([...document.fonts].map((font) => font.load().catch(() => {})));
}

// What is wider than a sheet becomes small.
function fit() {
  const boxes = "article .pst-scrollable-table-container, article .cell_output, article div.math";
  for (const box of document.querySelectorAll(boxes)) {
    const share = box.clientWidth / box.scrollWidth;
    if (share >= 1) continue;
    for (const wide of box.querySelectorAll("table, mjx-container")) wide.style.zoom = 0.99 * share;
  }
}

// Sections of the page: their ids and headings.
function headings() {
  return [...document.querySelectorAll("section[id] > h2")].map((heading) => {
    const words = heading.cloneNode(true);
    words.querySelectorAll("a.headerlink").forEach((e) => e.remove());
    return [heading.parentElement.id, words.textContent.trim()];
  });
}

// Chromium tells where a place of a page is printed if the page itself links to it.
function link(names) {
  const targets = document.createElement("div");
  targets.style.cssText = "position: absolute; bottom: 0; left: 0; font-size: 1px";
  for (const name of names.filter((n) => document.getElementById(n))) {
    const link = document.createElement("a");
    link.href = "#" + name;
    link.textContent = ".";
    link.style.cssText = "color: transparent; text-decoration: none";
    targets.append(link);
  }
  document.body.append(targets);
}

// Makes the page ready, with the places that others link to; returns its headings.
window.prepareForPrint = async (names) => {
  await ready();
  fit();
  const found = headings();
  link([...new Set([...names, ...found.map(([id]) => id)])]);
  return found;
};
