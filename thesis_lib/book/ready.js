// What to wait for before a page is printed.
async () => {
  const folded = 'details.sd-dropdown, table details';
  document.querySelectorAll(folded).forEach((e) => { e.open = true; });
  document.querySelectorAll('img[loading=lazy]').forEach((e) => { e.loading = 'eager'; });
  const loaded = (e) => e.complete || new Promise((done) => { e.onload = e.onerror = done; });
  await Promise.all([...document.images].map(loaded));
  if (window.MathJax?.startup?.promise) await window.MathJax.startup.promise;
  await Promise.all([...document.fonts].map((font) => font.load().catch(() => {})));
}
