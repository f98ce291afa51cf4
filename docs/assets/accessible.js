// Names for the theme's landmarks that have none, and none twice: screen readers list them by name.
"use strict";
(() => {
  const NAMES = { ".md-code__nav": "Code", ".md-search[role=dialog]": "Search", "nav.md-nav:not([aria-label])": "Menu" };
  function name() {
    for (const [selector, word] of Object.entries(NAMES)) {
      document.querySelectorAll(selector).forEach((element, k) => {
        if (element.dataset.named) return;
        element.dataset.named = "1";
        const label = document.getElementById(element.getAttribute("aria-labelledby"));
        const said = label ? label.textContent.trim() : word;
        element.removeAttribute("aria-labelledby");
        element.setAttribute("aria-label", k ? `${said} ${k + 1}` : said);
      });
    }
  }
  document.addEventListener("DOMContentLoaded", () => {
    name();
    new MutationObserver(name).observe(document.body, { childList: true, subtree: true });
  });
})();
// A browser breaks a line after a hyphen: "--" would stand alone before "scheduler". Short words of code stay whole, and long
// ones break after an underscore or a colon.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll(".md-content :not(pre) > code").forEach((code) => {
    if (/^(\S{1,30}|.{1,16})$/.test(code.textContent)) code.style.whiteSpace = "nowrap";
    else if (/^\S{31,}$/.test(code.textContent)) {
      const parts = code.textContent.split(/(?<=_|::)/);
      code.replaceChildren(...parts.flatMap((part) => [part, document.createElement("wbr")]));
    }
  });
});
