// The texts of the page in the language of its reader. A text is written in English where it is used, as `t("Start")`; the
// catalogue (german.json) has the others. What the server tells is looked up by `said`: titles and descriptions of scenes,
// steps of protocols, messages. Names and values are data: their elements have translate="no".

const KEPT = "language";
const MARKED = "qps"; // a language for tests: every text of the catalogue stands between ⟦ and ⟧

export const languages = { en: "English", de: "Deutsch" };
export const language = localStorage.getItem(KEPT) ?? (navigator.language.startsWith("de") ? "de" : "en");
document.documentElement.lang = language === MARKED ? "en" : language;

const sections = language === "en" ? {} : await fetch("/page/german.json").then((answer) => answer.json());
const { "words of keys": keys, ...others } = sections; // a scene is called belt too: what the server tells has names
const told = Object.assign({}, ...Object.values(others)), german = { ...keys, ...told };
const literal = ([text]) => text.replace(/\{\w+\}/g, "").length; // the pattern with the most words of its own is the right one
const patterns = Object.entries(sections.messages ?? {}).filter(([text]) => text.includes("{")).sort((one, other) => literal(other) - literal(one))
  .map(([text, other]) => [new RegExp(`^${text.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{(\w+)\}/g, "(?<$1>.+?)")}$`), text, other]);

/** A number with the decimal sign of the language. */
export const decimal = (text) => (language === "de" ? text.replace(".", ",") : text);
const DECIMAL = /(?<![\w.,])(\d+)\.(\d+(?:e[-+]?\d+)?)(?![\w.])/g; // in a text, and no version or name of a file

const filled = (text, values) => text.replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
const marked = (text) => (language === MARKED ? `⟦${text}⟧` : text);

/** The text in the present language, with {name} replaced by values. */
export function t(text, values = {}) { return marked(filled(language === "de" ? german[text] ?? text : text, values)); }

/** A text of the server in the present language: as a whole, by a pattern of the catalogue, or line by line; else as it is. */
export function said(text) {
  if (language === "en" || !text) return text;
  if (text in told) return t(text);
  for (const [shape, own, other] of patterns) {
    const values = text.match(shape)?.groups;
    if (!values) continue;
    if (language !== "de") return marked(filled(own, values));
    return filled(other, Object.fromEntries(Object.entries(values).map(([name, value]) => [name, said(value).replace(DECIMAL, "$1,$2")])));
  }
  return text.includes("\n") ? text.split("\n").map(said).join("\n") : text;
}

/** Show the page in another language. */
export function speak(other) {
  localStorage.setItem(KEPT, other);
  location.reload();
}
