import ts from "typescript";
import { expect, it } from "vitest";

/** All that may come to be on the page; the API's own page speaks English, as its contract does. */
const sources = import.meta.glob<string>(
  ["../src/**/*.{ts,tsx}", "!../src/strings/**", "!../src/gen/**", "!../src/docs.ts"],
  { query: "?raw", import: "default", eager: true },
);
/** Attributes whose text is read by people. */
const READ = ["title", "aria-label", "placeholder", "label", "alt", "question", "yes", "no"];
const WORDS = /\p{L}{2}/u;
/** Two words, as people put them beside one another; a media query begins with what it asks. */
const PHRASE = /^(?!\().*\p{L}{2}[,.;:!?…]? \p{L}{2}/su;
/** A figure's unit, which the modules of units and of numbers spell. */
const UNIT = /^(°|\s?(mm|µm|px|ms|s|min|h)\b)/;
const SPELLS_UNITS = /\/(units|format)\.ts$/;

/** Whether what is spelt is for the program: a class of CSS, a font, or why it fails for whoever mends it. */
function isAside(node: ts.Node): boolean {
  if (ts.isJsxAttribute(node)) return node.name.getText() === "class";
  if (ts.isBinaryExpression(node) && node.left.getText().endsWith(".font")) return true;
  return ts.isNewExpression(node) && node.expression.getText() === "Error";
}

/** What a file says in its own words, with where it does. */
function spoken([file, text]: [string, string]): string[] {
  const source = ts.createSourceFile(file, text, ts.ScriptTarget.Latest, true, ts.ScriptKind.TSX);
  const found: string[] = [];
  const say = (node: ts.Node, text: string) => {
    const { line } = source.getLineAndCharacterOfPosition(node.getStart());
    found.push(`${file}:${line + 1} ${text.trim()}`);
  };
  const visit = (node: ts.Node): void => {
    if (isAside(node)) return;
    if (ts.isJsxText(node) && WORDS.test(node.text)) say(node, node.text);
    if (ts.isJsxAttribute(node) && READ.includes(node.name.getText()) && node.initializer) {
      const value = node.initializer;
      if (ts.isStringLiteral(value) && WORDS.test(value.text)) say(value, value.text);
    }
    if ((ts.isStringLiteralLike(node) || ts.isTemplateHead(node)) && PHRASE.test(node.text)) {
      say(node, node.text);
    }
    if (ts.isTemplateSpan(node)) {
      const { text } = node.literal;
      const isUnit = UNIT.test(text) && text !== "px" && !SPELLS_UNITS.test(file);
      if (isUnit || PHRASE.test(text)) say(node, text);
    }
    ts.forEachChild(node, visit);
  };
  visit(source);
  return found;
}

it("the page's words are in one place, and so is how units are spelt", () => {
  const files = Object.entries(sources);
  expect(files.length).toBeGreaterThan(100);
  expect(files.flatMap(spoken)).toEqual([]);
});

it("words in other places are found", () => {
  const elsewhere =
    '<p title="Go" class="card old">Stop {x ? "not now" : `${x} ms`}</p>; new Error("no canvas")';
  expect(spoken(["a.tsx", elsewhere]).map((where) => where.slice("a.tsx:1 ".length))).toEqual([
    "Go",
    "Stop",
    "not now",
    "ms",
  ]);
});
