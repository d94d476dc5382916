// The texts of the page in the language of its reader. A text is written in English where it is used, as `t("Start")`; the
// catalogue (german.js) has the others. Names and messages of the server are data: their elements have translate="no".

import { german } from "/page/german.js";

const KEPT = "language";
const MARKED = "qps"; // a language for tests: every text of the catalogue stands between ⟦ and ⟧

export const languages = { en: "English", de: "Deutsch" };
export const language = localStorage.getItem(KEPT) ?? (navigator.language.startsWith("de") ? "de" : "en");
document.documentElement.lang = language === MARKED ? "en" : language;

/** The text in the present language, with {name} replaced by values. */
export function t(text, values = {}) {
  const said = (language === "de" ? german[text] ?? text : text).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
  return language === MARKED ? `⟦${said}⟧` : said;
}

/** Show the page in another language. */
export function speak(other) {
  localStorage.setItem(KEPT, other);
  location.reload();
}
