// Give the keyboard focus to tables that are wider than the page, so that arrow keys scroll them.
const reach = () => {
  for (const box of document.querySelectorAll(".md-typeset__scrollwrap")) {
    const wide = box.scrollWidth > box.clientWidth + 1;
    if (!wide) { box.removeAttribute("tabindex"); box.removeAttribute("role"); continue; }
    box.tabIndex = 0;
    box.setAttribute("role", "region");
    box.setAttribute("aria-label", "table, scrolls sideways");
  }
};
document$.subscribe(reach);
addEventListener("resize", reach);
