// Typeset the formulas that pymdownx.arithmatex marks, by the KaTeX 0.19.1 beside this file (MIT, see LICENSE).
document.addEventListener("DOMContentLoaded", () => {
  for (const formula of document.querySelectorAll(".arithmatex")) {
    const text = formula.textContent.trim();
    const source = text.slice(2, -2);
    katex.render(source, formula, { displayMode: text.startsWith("\\["), throwOnError: false });
  }
});
