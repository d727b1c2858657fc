// The copy buttons that Sphinx adds have a tooltip but no name that a screen reader could read.
window.addEventListener("load", () => {
  for (const button of document.querySelectorAll("button.copybtn")) {
    button.setAttribute("aria-label", button.dataset.tooltip);
  }
});
